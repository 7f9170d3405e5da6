"""A build as people write it in a script: scipy moves, numpy or Open3D draws, OpenCV writes.

Used by ``whole_scan.py``. The script gets the same images and points as ours, read and unpacked by
our reader, which spares it the slow part of reading messages in Python. It keeps the last N points
in one array, undistorts by ``cv2.undistort``, resizes, and writes the same kinds of files; it
hashes nothing, checks nothing and cannot be stopped and gone on with.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import OpenEXR
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from civil_rgbd.builder.plan import plan_frames
from civil_rgbd.domain.recipe import Recipe
from civil_rgbd.domain.recording import Recording
from civil_rgbd.geometry.camera import PinholeCamera

Renderer = Callable[[NDArray[np.float32], NDArray[np.float64], PinholeCamera], NDArray[np.float32]]
"""(N, 3) points of the map, ``T_camera_map``, camera -> (H, W) metres, 0 where nothing fell."""

NEAR_M, FAR_M = 0.5, 200.0


def build_by_script(
    recording: Recording, recipe: Recipe, out: Path, render: Renderer, *, frames: int
) -> int:
    """Build the first ``frames`` frames into a folder; returns how many were made."""
    out.mkdir(parents=True)
    plan = plan_frames(recording, recipe).frames  # the same choice of images, for nothing
    T_body_lidar = recording.rig.T_body_lidar
    trajectory = recording.trajectory
    start_ns = trajectory.stamps_ns[0]
    seconds = (trajectory.stamps_ns - start_ns) / 1e9
    turn_at = Slerp(seconds, Rotation.from_quat(trajectory.quaternions_xyzw))
    lens = recording.rig.camera
    camera = lens.pinhole.scaled(recipe.image.scale)
    cloud = np.empty((0, 3), np.float32)
    stamps = np.empty(0, np.int64)
    scan, made, poses = 0, 0, []
    for planned in plan:
        while (
            scan < len(recording.scan_stamps_ns)
            and recording.scan_stamps_ns[scan] < planned.stamp_ns
        ):
            read = recording.read_scan(scan)
            scan += 1
            times = read.point_stamps_ns
            distance = np.linalg.norm(read.points, axis=1)
            keep = (distance > NEAR_M) & (distance < FAR_M) & (times <= trajectory.stamps_ns[-1])
            keep &= times >= start_ns
            times, points = times[keep], read.points[keep] @ T_body_lidar[:3, :3].T
            points = points + T_body_lidar[:3, 3]
            now = (times - start_ns) / 1e9
            moved = turn_at(now).apply(points)
            for axis in range(3):
                moved[:, axis] += np.interp(now, seconds, trajectory.translations_m[:, axis])
            cloud = np.concatenate([cloud, moved.astype(np.float32)])
            stamps = np.concatenate([stamps, times])
            surplus = max(0, len(cloud) - recipe.accumulate.points - 50_000)
            cloud, stamps = cloud[surplus:], stamps[surplus:]
        past = stamps < planned.stamp_ns
        seen = cloud[past][-recipe.accumulate.points :]
        if len(seen) < recipe.accumulate.points:
            continue
        T_camera_map = np.linalg.inv(planned.T_map_camera)
        depth_m = render(seen, T_camera_map, camera)
        raw = cv2.cvtColor(recording.read_image(planned.source_index).rgb, cv2.COLOR_RGB2BGR)
        raw = cv2.undistort(raw, lens.pinhole.matrix, np.array(lens.coefficients))
        rgb = cv2.resize(raw, (camera.width_px, camera.height_px), interpolation=cv2.INTER_LINEAR)
        name = f"{planned.source_index:06d}"
        cv2.imwrite(str(out / f"{name}.jpg"), rgb, [cv2.IMWRITE_JPEG_QUALITY, 95])
        header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
        OpenEXR.File(header, {"Z": depth_m}).write(str(out / f"{name}.exr"))
        poses.append({"id": name, "T_map_camera": planned.T_map_camera.tolist()})
        made += 1
        if made == frames:
            break
    (out / "poses.json").write_text(json.dumps(poses))
    return made


def by_numpy(
    points: NDArray[np.float32], T_camera_map: NDArray[np.float64], camera: PinholeCamera
) -> NDArray[np.float32]:
    """Draw by ``np.minimum.at``."""
    moved = points @ T_camera_map[:3, :3].T.astype(np.float32)
    moved += T_camera_map[:3, 3].astype(np.float32)
    moved = moved[(moved[:, 2] > NEAR_M) & (moved[:, 2] < FAR_M)]
    u = np.floor(camera.fx_px * moved[:, 0] / moved[:, 2] + camera.cx_px + 0.5).astype(np.int64)
    v = np.floor(camera.fy_px * moved[:, 1] / moved[:, 2] + camera.cy_px + 0.5).astype(np.int64)
    inside = (u >= 0) & (u < camera.width_px) & (v >= 0) & (v < camera.height_px)
    depth_m = np.full((camera.height_px, camera.width_px), np.inf, np.float32)
    np.minimum.at(depth_m, (v[inside], u[inside]), moved[inside, 2])
    depth_m[~np.isfinite(depth_m)] = 0
    return np.round(depth_m * 1024) / 1024


def by_open3d(
    points: NDArray[np.float32], T_camera_map: NDArray[np.float64], camera: PinholeCamera
) -> NDArray[np.float32]:
    """Draw by Open3D's ``project_to_depth_image`` (tensor interface, on the processor)."""
    import open3d as o3d

    image = o3d.t.geometry.PointCloud(o3d.core.Tensor(points)).project_to_depth_image(
        camera.width_px,
        camera.height_px,
        o3d.core.Tensor(camera.matrix),
        o3d.core.Tensor(T_camera_map),
        depth_scale=1.0,
        depth_max=FAR_M,
    )
    depth_m = image.as_tensor().numpy()[..., 0]
    return np.round(depth_m * np.float32(1024)) / np.float32(1024)


def valid_share(folder: Path) -> float:
    """The mean share of pixels with depth: a script that drew nothing would be fast."""
    shares = []
    for path in sorted(folder.glob("*.exr")):
        depth_m = OpenEXR.File(str(path), separate_channels=True).channels()["Z"].pixels
        shares.append(float(np.count_nonzero(depth_m)) / depth_m.size)
    return math.fsum(shares) / len(shares)
