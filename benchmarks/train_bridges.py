"""Five bridges for benchmarks/train.py: girder bridges of different sizes, drawn, never scanned.

Images are painted and depths cast as the simulator does. What is measured is where the LiDAR's
beams fall in 0.4 s, some 35 % of the pixels, as accumulated scans leave them at full size. Views of
more sky than bridge are left out.
"""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.domain.bridge import BridgeInfo, Counts, Manifest, Software
from civil_rgbd.domain.frame import FrameRow, RgbdFrame
from civil_rgbd.domain.recipe import ImageStage
from civil_rgbd.format.datasets import refresh_dataset
from civil_rgbd.format.writer import finish_bridge, write_frame
from civil_rgbd.geometry.camera import PinholeCamera
from civil_rgbd.geometry.transforms import compose, transform_from
from civil_rgbd.simulator.bridge import GirderBridge, girder_bridge
from civil_rgbd.simulator.camera import D455, pinhole_rays, render_depth
from civil_rgbd.simulator.lidar import beam_directions
from civil_rgbd.simulator.scene import RayCaster
from civil_rgbd.simulator.shading import Painter
from civil_rgbd.simulator.spec import ScanSpec
from civil_rgbd.simulator.walk import START_NS, T_LIDAR_CAMERA, camera_poses

CAMERA = D455.pinhole.scaled(0.15).cropped(left_px=0, top_px=6, width_px=192, height_px=96)
WALK_S = 60  # there and back
MAX_SKY_SHARE = 0.45
BEAMS = 96_000  # 0.4 s of a Livox Avia
MAX_RANGE_M = 200.0


@dataclass(frozen=True, slots=True)
class Variant:
    """A bridge, and how it is walked past.

    Attributes:
        bridge: its dimensions.
        frames: how many.
        across_m: the walk lies so much further from the abutment than the demo's.
        turn_deg: and looks so much further to the left.
        rise_deg: and up.
        seed: of walk, grain and beams.
    """

    bridge: GirderBridge
    frames: int
    across_m: float
    turn_deg: float
    rise_deg: float
    seed: int


VARIANTS = {
    "B1": Variant(GirderBridge(), 40, 0.0, 0.0, 0.0, 1),
    "B2": Variant(
        GirderBridge(
            abutment_y_m=10.5,
            abutment_height_m=4.2,
            girder_count=5,
            girder_spacing_m=1.7,
            girder_depth_m=0.6,
            deck_width_m=8.5,
        ),
        40,
        1.2,
        -12.0,
        4.0,
        2,
    ),
    "B3": Variant(
        GirderBridge(
            abutment_y_m=9.6,
            abutment_height_m=5.8,
            girder_count=3,
            girder_spacing_m=3.4,
            girder_depth_m=1.2,
            deck_width_m=11.0,
            column_x_m=(-4.0, -1.3, 1.3, 4.0),
        ),
        40,
        0.6,
        10.0,
        -2.0,
        3,
    ),
    "B4": Variant(
        GirderBridge(
            abutment_y_m=12.0,
            abutment_height_m=6.6,
            girder_count=6,
            girder_spacing_m=2.2,
            girder_depth_m=1.0,
            deck_width_m=14.0,
            column_radius_m=0.6,
            column_x_m=(-5.0, 0.0, 5.0),
        ),
        40,
        2.2,
        20.0,
        3.0,
        4,
    ),
    "B5": Variant(
        GirderBridge(
            abutment_y_m=11.0,
            abutment_height_m=5.2,
            girder_count=5,
            girder_spacing_m=2.0,
            girder_depth_m=0.75,
            deck_width_m=10.0,
            column_radius_m=0.5,
            column_x_m=(-3.5, 3.5),
        ),
        180,
        1.7,
        -20.0,
        6.0,
        5,
    ),
}
"""B5 is the test bridge; the four others have 160 frames."""


def make_dataset(folder: Path, *, test_frames: int | None = None) -> Path:
    """Make the five bridges, once: those that are there are kept.

    Args:
        folder: of the dataset.
        test_frames: of B5, for a quick try; None for all.
    """
    for name, variant in VARIANTS.items():
        target = folder / "bridges" / name
        if target.exists():
            continue
        count = test_frames if name == "B5" and test_frames else variant.frames
        print(f"  draws {name}: {count} frames", flush=True)
        _make_bridge(target, variant, count)
    refresh_dataset(folder, name="five simulated bridges")
    return folder


def _make_bridge(target: Path, variant: Variant, count: int) -> None:
    partial = target.with_name(f".{target.name}.partial")
    shutil.rmtree(partial, ignore_errors=True)
    partial.mkdir(parents=True)
    caster = RayCaster(girder_bridge(variant.bridge, name=target.name))
    painter = Painter(caster)
    rows = [
        _frame_row(partial, number, stamp_ns, pose, scene=(caster, painter), seed=variant.seed)
        for number, (stamp_ns, pose) in enumerate(_views(variant, caster, count))
    ]
    finish_bridge(
        partial,
        target,
        manifest=Manifest(
            info=BridgeInfo(bridge_id=target.name, licence="CC0-1.0"),
            origin="imported",
            sources=(),
            software=Software(civil_rgbd="0", python="0", packages={}),
            counts=Counts(images_seen=count, frames_kept=count),
        ),
        camera=CAMERA,
        rows=rows,
        replace=False,
    )


def _views(
    variant: Variant, caster: RayCaster, count: int
) -> list[tuple[int, NDArray[np.float64]]]:
    """Choose stamps and poses, evenly among those of the walk that see enough of the bridge."""
    candidates = 4 * count
    stamps = START_NS + np.arange(candidates, dtype=np.int64) * (
        WALK_S * 1_000_000_000 // candidates
    )
    glance = CAMERA.scaled(0.25)
    seeing = [
        (int(stamp_ns), pose)
        for stamp_ns, pose in zip(stamps, _poses(variant, stamps), strict=True)
        if (render_depth(caster, glance, pose) == 0).mean() < MAX_SKY_SHARE
    ]
    chosen = np.linspace(0, len(seeing) - 1, count).round().astype(int).tolist()
    return [seeing[place] for place in chosen]


def _poses(variant: Variant, stamps: NDArray[np.int64]) -> NDArray[np.float64]:
    """The demo's walk, moved, and the camera turned: (N, 4, 4) T_map_camera."""
    walk = camera_poses(ScanSpec(seconds=3600, seed=variant.seed), stamps)
    walk[:, 1, 3] += variant.across_m
    # Optical axes: turning left is about -y, up about x.
    left, up = np.radians(-variant.turn_deg), np.radians(variant.rise_deg)
    about_y = [[np.cos(left), 0, np.sin(left)], [0, 1, 0], [-np.sin(left), 0, np.cos(left)]]
    about_x = [[1, 0, 0], [0, np.cos(up), -np.sin(up)], [0, np.sin(up), np.cos(up)]]
    turned = transform_from(np.array(about_y) @ np.array(about_x), np.zeros(3))
    return compose(walk, turned)


def _frame_row(
    partial: Path,
    number: int,
    stamp_ns: int,
    pose: NDArray[np.float64],
    *,
    scene: tuple[RayCaster, Painter],
    seed: int,
) -> FrameRow:
    caster, painter = scene
    rng = np.random.default_rng([seed, number])
    rgb = painter.paint(pinhole_rays(CAMERA), CAMERA.fx_px, pose, rng)
    exact = render_depth(caster, CAMERA, pose)
    there = measured(CAMERA, rng) & (exact > 0) & (exact < MAX_RANGE_M)
    depth_m = np.where(there, np.round(exact * 1024) / 1024, 0.0).astype(np.float32)
    frame = RgbdFrame(
        source_index=number,
        stamp_ns=stamp_ns,
        source_stamp_ns=stamp_ns,
        rgb=rgb,
        depth_m=depth_m,
        camera=CAMERA,
        T_map_camera=pose,
    )
    return write_frame(partial, frame, stage=ImageStage(codec="png"))


def measured(camera: PinholeCamera, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Where beams of a random instant fall: (H, W) bool."""
    since_ns = int(rng.integers(0, 3600)) * 1_000_000_000
    count = np.arange(BEAMS, dtype=np.int64)
    beams = beam_directions(since_ns + count * 4167, (count % 6).astype(np.uint8))
    x, y, z = (beams @ T_LIDAR_CAMERA[:3, :3]).T
    u = np.floor(camera.fx_px * x / z + camera.cx_px + 0.5).astype(int)
    v = np.floor(camera.fy_px * y / z + camera.cy_px + 0.5).astype(int)
    inside = (z > 0) & (u >= 0) & (u < camera.width_px) & (v >= 0) & (v < camera.height_px)
    hit = np.zeros((camera.height_px, camera.width_px), dtype=bool)
    hit[v[inside], u[inside]] = True
    return hit
