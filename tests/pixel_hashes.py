"""Run as a script: renders frames and prints their pixel hashes, for comparing processors.

A moving, turning sensor with points at their own times, a camera behind each kind of lens, at
scales with and without the area filter. Input comes from integers and products alone, so that it is
the same on every processor itself.
"""

from __future__ import annotations

import hashlib
import json
import sys

import numpy as np
from numpy.typing import NDArray
from recordings import MemoryRecording, trajectory_of  # a script finds its neighbours

from civil_rgbd.builder.plan import plan_frames
from civil_rgbd.domain.recipe import (
    AccumulateStage,
    ImageStage,
    QualityStage,
    Recipe,
    SelectStage,
    VisibilityStage,
)
from civil_rgbd.domain.rig import Rig
from civil_rgbd.domain.scan import LidarScan
from civil_rgbd.geometry.camera import LensCamera, PinholeCamera
from civil_rgbd.geometry.transforms import matrix_from_quaternion, transform_from, unit_quaternion
from civil_rgbd.pipeline.frames import FrameMaker

MS = 10**6
PINHOLE = PinholeCamera(640, 360, 318.26, 310.9, 317.6, 184.8)
LENSES = {
    "none": (),
    "plumb_bob": (-0.0545, 0.0636, 0.00016, -0.00099, -0.0203),
    "rational_polynomial": (0.1, -0.05, 0.003, -0.006, 0.01, 0.15, -0.03, 0.01),
    "fisheye": (0.05, -0.02, 0.004, -0.001),
}


def recording(lens: str) -> MemoryRecording:
    """Three seconds of a walk: 30 messages of 4,000 points, three images."""
    rng = np.random.default_rng(17)
    turns = unit_quaternion(np.c_[np.cumsum(rng.uniform(-0.02, 0.02, (31, 3)), axis=0), [1.0] * 31])
    path = np.array([540000.0, 4810000.0, 330.0]) + np.cumsum(rng.uniform(0, 0.2, (31, 3)), axis=0)
    x, y, z = rng.uniform([-1.2, -0.8, 2.0], [1.2, 0.8, 60.0], (120_000, 3)).T
    points = np.stack([x * z, y * z, z], axis=1).astype(np.float32)
    T_body_lidar = transform_from(
        matrix_from_quaternion(unit_quaternion([0.02, -0.01, 0.03, 1.0])), [0.04, 0.02, -0.03]
    )
    return MemoryRecording(
        rig=Rig(LensCamera(PINHOLE, lens, LENSES[lens]), np.eye(4), T_body_lidar, 0.013),
        trajectory=trajectory_of([i * 100 * MS for i in range(31)], path.tolist(), turns.tolist()),
        scans=[
            LidarScan(
                i * 100 * MS,
                points[i * 4000 : (i + 1) * 4000],
                i * 100 * MS + np.arange(4000, dtype=np.int64) * 24_999,
            )
            for i in range(30)
        ],
        image_stamps_ns=np.array([1500, 2100, 2900]) * MS,
        images=list(rng.integers(0, 256, (3, 360, 640, 3), dtype=np.uint8)),
    )


def digest(pixels: NDArray[np.generic]) -> str:
    """Hash an array with its type and shape."""
    head = f"{pixels.dtype.str}{pixels.shape}".encode()
    return hashlib.sha256(head + pixels.tobytes()).hexdigest()[:16]


def main() -> None:
    """Print the hashes as JSON."""
    hashes = {}
    for lens in LENSES:
        for scale in (0.3, 0.6, 1.0):
            recipe = Recipe(
                "hashes",
                select=SelectStage(0.0),
                accumulate=AccumulateStage(points=50_000),
                image=ImageStage(scale=scale),
                visibility=VisibilityStage(points=100_000),
                quality=QualityStage(),
            )
            source = recording(lens)
            plan = plan_frames(source, recipe)
            for outcome in FrameMaker(source, recipe).make(plan.frames):
                frame = outcome.frame
                if frame is None:
                    sys.exit(f"a frame was dropped: {outcome.dropped}")
                name = f"{lens} {scale} {frame.frame_id}"
                hashes[name] = [
                    digest(frame.rgb),
                    digest(frame.depth_m),
                    outcome.pixels_removed,
                    *map(digest, (frame.quality or {}).values()),
                    digest(frame.T_map_camera),
                    outcome.points_in_view,
                ]
    sys.stdout.write(json.dumps(hashes))


if __name__ == "__main__":
    main()
