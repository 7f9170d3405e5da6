"""A simulated walk as a LiDAR alone would leave it: scans here, images, poses and rig there."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from civil_rgbd.domain.recording import RecordingOptions
from civil_rgbd.domain.scan import LidarScan
from civil_rgbd.simulator.camera import raw_camera, simulate_jpeg
from civil_rgbd.simulator.recording import SimulatedRecording
from civil_rgbd.trajectories.files import read_trajectory_file
from civil_rgbd.trajectories.rig import read_rig

from . import cloud_writers, lvx_writer

PCD_COLUMNS = ("x", "y", "z", "t", "tag")


def seconds(stamp_ns: int) -> str:
    return f"{stamp_ns // 10**9}.{stamp_ns % 10**9:09d}"


def write_beside(folder: Path, recording: SimulatedRecording) -> None:
    """Write images with times, poses (TUM, of the IMU) and a rig file."""
    images = folder / "images"
    images.mkdir(parents=True)
    stamps = recording.image_stamps_ns.tolist()
    for index in range(len(stamps)):
        (images / f"{index + 1}.jpg").write_bytes(simulate_jpeg(recording.spec, index))
    (images / "timestamps.txt").write_text("".join(seconds(stamp) + "\n" for stamp in stamps))
    poses = recording.trajectory
    rows = np.concatenate([poses.translations_m, poses.quaternions_xyzw], axis=1).tolist()
    (folder / "poses.tum").write_text(
        "".join(
            f"{seconds(stamp)} {' '.join(map(repr, row))}\n"
            for stamp, row in zip(poses.stamps_ns.tolist(), rows, strict=True)
        )
    )
    (folder / "rig.toml").write_text(rig_text(recording))


def rig_text(recording: SimulatedRecording) -> str:
    camera = raw_camera(recording.spec.image_scale)
    hole, rig = camera.pinhole, recording.rig
    return f"""
[camera]
width_px = {hole.width_px}
height_px = {hole.height_px}
fx_px = {hole.fx_px!r}
fy_px = {hole.fy_px!r}
cx_px = {hole.cx_px!r}
cy_px = {hole.cy_px!r}
lens = "{camera.lens}"
coefficients = {list(camera.coefficients)!r}

[extrinsics]
T_imu_lidar = {rig.T_body_lidar.tolist()!r}
T_imu_camera = {rig.T_body_camera.tolist()!r}
"""


def options_beside(folder: Path, **more: object) -> RecordingOptions:
    read = read_trajectory_file(folder / "poses.tum")
    given = {
        "rig": read_rig(folder / "rig.toml"),
        "trajectory": read.trajectory,
        "trajectory_sources": read.sources,
        "trajectory_note": read.note,
        "pose_of": "imu",
        "images": folder / "images",
    }
    return RecordingOptions(**given | more)  # type: ignore[arg-type]  # by name


def columns_of(scan: LidarScan) -> dict[str, np.ndarray[tuple[int], np.dtype[np.generic]]]:
    """The columns of PCD and PLY files: nothing of a scan is lost."""
    assert scan.point_stamps_ns is not None
    assert scan.noise is not None
    x, y, z = scan.points.T
    offsets = (scan.point_stamps_ns - scan.stamp_ns).astype(np.uint32)
    return {"x": x, "y": y, "z": z, "t": offsets, "tag": (scan.noise * 2).astype(np.uint8)}


def write_scans(folder: Path, recording: SimulatedRecording, kind: str) -> Path:
    """Write all scans as ``pcd``, ``ply``, ``las`` or ``lvx``; return the recording's location."""
    folder.mkdir(parents=True)
    scans = [recording.read_scan(i) for i in range(len(recording.scan_stamps_ns))]
    if kind == "lvx":
        frames = []
        for scan in scans:
            assert scan.point_stamps_ns is not None
            frames += lvx_writer.frames_of_scan(scan.points, scan.point_stamps_ns, per_frame=125)
        (folder / "walk.lvx").write_bytes(lvx_writer.file_bytes(frames))
        return folder / "walk.lvx"
    for number, scan in enumerate(scans, start=1):
        path, columns = folder / f"{number}.{kind}", columns_of(scan)
        if kind == "pcd":
            encoding = ("ascii", "binary", "binary_compressed")[number % 3]
            path.write_bytes(cloud_writers.pcd_bytes(columns, encoding))
        elif kind == "ply":
            encoding = ("ascii", "binary_little_endian", "binary_big_endian")[number % 3]
            path.write_bytes(cloud_writers.ply_bytes(columns, encoding))
        else:
            assert scan.point_stamps_ns is not None
            cloud_writers.write_las(path, scan.points, scan.point_stamps_ns / 1e9)
    stamps = recording.scan_stamps_ns.tolist()
    (folder / "timestamps.txt").write_text("".join(seconds(stamp) + "\n" for stamp in stamps))
    return folder
