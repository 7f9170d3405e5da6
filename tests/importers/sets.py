"""A small scene whose depth is known, written in the layouts that people keep such sets in.

Nothing of ours computes it: three planes in the map, each pixel's ray cut with them by hand.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

WIDTH, HEIGHT = 64, 48
FX, FY, CX, CY = 50.0, 52.0, 31.0, 24.5
FRAMES = 12
FIRST_NS, STEP_NS = 1_700_000_000_123_456_789, 100_000_000
PLANES = [((0.0, 0.1, 1.0), 8.0), ((0.9, 0.0, 1.0), 6.5), ((0.0, -1.0, 0.3), 3.0)]
"""Normal n and distance d: n . X = d."""

Array = NDArray[np.float64]


def pose(frame: int) -> Array:
    """T_map_camera: a walk sideways and forwards, turning a little."""
    T = np.eye(4)
    T[:3, :3] = Rotation.from_euler("yx", [0.01 * frame, -0.02 * frame]).as_matrix()
    T[:3, 3] = [0.25 * frame, 0.03 * frame, 0.08 * frame]
    return T


def depth_m(frame: int, *, fy: float = FY, T: Array | None = None) -> Array:
    """(H, W) metres along the optical axis; 0 in a corner where nothing was measured."""
    T = pose(frame) if T is None else T
    v, u = np.mgrid[:HEIGHT, :WIDTH]
    rays = np.stack([(u - CX) / FX, (v - CY) / fy, np.ones_like(u, dtype=float)], axis=-1)
    turned = rays @ T[:3, :3].T
    cuts = [(d - np.dot(n, T[:3, 3])) / (turned @ np.array(n)) for n, d in PLANES]
    z = np.where(np.stack(cuts) > 0, np.stack(cuts), np.inf).min(axis=0)
    z[:6, :9] = 0.0
    return np.where(z < 60, z, 0.0)


def rgb(frame: int) -> NDArray[np.uint8]:
    """(H, W, 3) red first: a gradient that tells the channels and the frames apart."""
    v, u = np.mgrid[:HEIGHT, :WIDTH]
    return np.stack([u * 3, v * 4, np.full_like(u, 10 * frame)], axis=-1).astype(np.uint8)


def stamp_ns(frame: int) -> int:
    return FIRST_NS + frame * STEP_NS


def quaternion(T: Array) -> list[float]:
    """Order xyzw."""
    return [float(x) for x in Rotation.from_matrix(T[:3, :3]).as_quat(canonical=True)]


def write_png(path: Path, pixels: NDArray[np.generic]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), pixels)


def write_images(
    colour: Path,
    depth: Path,
    *,
    scale: float,
    name: Callable[[int], str] = "{:06d}".format,
    z: Callable[[int], Array] = depth_m,
) -> None:
    for frame in range(FRAMES):
        write_png(colour / f"{name(frame)}.png", cv2.cvtColor(rgb(frame), cv2.COLOR_RGB2BGR))
        codes = np.floor(z(frame) * scale + 0.5).astype(np.uint16)
        write_png(depth / f"{name(frame)}.png", codes)


def lab_intrinsics(folder: Path, dist: list[float] | None = None) -> None:
    document = {
        "camera_matrix": [[FX, 0, CX], [0, FY, CY], [0, 0, 1]],
        "dist_coeff": dist or [0, 0, 0, 0, 0],
        "height": HEIGHT,
        "width": WIDTH,
    }
    (folder / "intrinsics.json").write_text(json.dumps(document))


def lab_poses(folder: Path, *, first: int = 0, T: Callable[[int], Array] = pose) -> None:
    lines = [
        ",".join(map(repr, [i + first, *map(float, T(i)[:3, 3]), *quaternion(T(i))]))
        for i in range(FRAMES)
    ]
    (folder / "poses.csv").write_text("\n".join(lines) + "\n")


def stamps(folder: Path) -> None:
    words = [f"{stamp_ns(i) // 10**9}.{stamp_ns(i) % 10**9:09d}" for i in range(FRAMES)]
    (folder / "timestamps.txt").write_text("\n".join(words) + "\n")


def bridge_rgbd(folder: Path, *, scale: float = 256.0) -> Path:
    write_images(folder / "rgb", folder / "depth", scale=scale)
    lab_intrinsics(folder)
    lab_poses(folder)
    stamps(folder)
    return folder


def lab(folder: Path) -> Path:
    """Ids from 1 without zeros before them: 10 must not come before 2."""
    write_images(folder / "rgb", folder / "depth", scale=1000.0, name=lambda i: str(i + 1))
    lab_intrinsics(folder)
    lab_poses(folder, first=1)
    stamps(folder)
    return folder


def tum(folder: Path) -> Path:
    """Depth stamps 7 ms late, poses at 50 Hz that no image meets."""
    write_images(folder / "rgb", folder / "depth", scale=5000.0)
    lines: dict[str, list[str]] = {"rgb": ["# timestamp filename"], "depth": []}
    for frame in range(FRAMES):
        for kind, late_ns in (("rgb", 0), ("depth", 7_000_000)):
            at = stamp_ns(frame) + late_ns
            lines[kind].append(f"{at // 10**9}.{at % 10**9:09d} {kind}/{frame:06d}.png")
    for kind, words in lines.items():
        (folder / f"{kind}.txt").write_text("\n".join(words) + "\n")
    poses = ["# ground truth trajectory", "# timestamp tx ty tz qx qy qz qw"]
    for step in range(-1, 5 * FRAMES):
        at = FIRST_NS + step * 20_000_000 + 5_000_000
        T = pose_between((at - FIRST_NS) / STEP_NS)
        numbers = " ".join(map(repr, [*map(float, T[:3, 3]), *quaternion(T)]))
        poses.append(f"{at // 10**9}.{at % 10**9:09d} {numbers}")
    (folder / "groundtruth.txt").write_text("\n".join(poses) + "\n")
    lab_intrinsics(folder)
    return folder


def pose_between(frame: float) -> Array:
    T = np.eye(4)
    T[:3, :3] = Rotation.from_euler("yx", [0.01 * frame, -0.02 * frame]).as_matrix()
    T[:3, 3] = [0.25 * frame, 0.03 * frame, 0.08 * frame]
    return T


def kitti(folder: Path) -> Path:
    drive = folder / "2011_09_26_drive_0001_sync"
    write_images(
        drive / "image_02" / "data",
        drive / "proj_depth" / "groundtruth" / "image_02",
        scale=256.0,
        name="{:010d}".format,
    )
    P = f"P_rect_02: {FX} 0 {CX} 0 0 {FY} {CY} 0 0 0 1 0"
    (folder / "calib_cam_to_cam.txt").write_text(f"calib_time: 09-Jan-2012 13:57:47\n{P}\n")
    rows = [" ".join(map(repr, map(float, pose(i)[:3].ravel()))) for i in range(FRAMES)]
    (drive / "poses.txt").write_text("\n".join(rows) + "\n")
    seconds = [divmod(stamp_ns(i) - FIRST_NS + 123_456_789, 10**9) for i in range(FRAMES)]
    dates = [f"2023-11-14 22:13:{20 + whole}.{rest:09d}" for whole, rest in seconds]
    (drive / "image_02" / "timestamps.txt").write_text("\n".join(dates) + "\n")
    return folder


def scannet(folder: Path) -> Path:
    write_images(folder / "color", folder / "depth", scale=1000.0, name=str)
    (folder / "intrinsic").mkdir()
    K = f"{FX} 0 {CX} 0\n0 {FY} {CY} 0\n0 0 1 0\n0 0 0 1\n"
    (folder / "intrinsic" / "intrinsic_depth.txt").write_text(K)
    # Colour was resized to the depth's size by the exporter: its own camera no longer holds.
    (folder / "intrinsic" / "intrinsic_color.txt").write_text(K.replace("5", "9"))
    (folder / "pose").mkdir()
    for frame in range(FRAMES):
        T = pose(frame) if frame != 4 else np.full((4, 4), -np.inf)
        np.savetxt(folder / "pose" / f"{frame}.txt", T, fmt="%.6f")
    return folder


M = np.diag([1.0, -1.0, 1.0, 1.0])


def upside_down(folder: Path) -> Path:
    """As ICL-NUIM: the camera's y axis points up, so fy is negative; rows ``tx .. qw`` in order."""
    write_images(folder / "rgb", folder / "depth", scale=5000.0, z=lambda i: depth_m(i, fy=-FY))
    rows = [
        " ".join(map(repr, [*map(float, pose(i)[:3, 3]), *quaternion(pose(i))]))
        for i in range(FRAMES)
    ]
    (folder / "pose.txt").write_text("\n".join(rows))
    (folder / "intrinsics.txt").write_text(f"{FX} {-FY} {CX} {CY}\n")
    return folder


def redwood(folder: Path) -> Path:
    write_images(folder / "image", folder / "depth", scale=1000.0, name="{:05d}".format)
    rows = []
    for frame in range(FRAMES):
        rows.append(f"{frame} {frame} {frame + 1}")
        rows += [" ".join(f"{x:.8f}" for x in row) for row in pose(frame)]
    (folder / "trajectory.log").write_text("\n".join(rows) + "\n")
    (folder / "intrinsic.json").write_text(
        json.dumps(
            {
                "width": WIDTH,
                "height": HEIGHT,
                "intrinsic_matrix": [FX, 0, 0, 0, FY, 0, CX, CY, 1],  # by columns, as Open3D does
            }
        )
    )
    return folder
