"""Any trajectory file to a trajectory: formats are told by content, and never by hope."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from civil_rgbd.domain.folders import IMAGE_SUFFIXES, file_source, files_in_order
from civil_rgbd.domain.recording import SourceFile
from civil_rgbd.domain.stamps import StampList, read_stamp_list, signed_seconds
from civil_rgbd.errors import RecordingError, UsageError
from civil_rgbd.geometry.trajectory import Trajectory
from civil_rgbd.resources import nearest
from civil_rgbd.trajectories.colmap import looks_like_colmap, read_colmap
from civil_rgbd.trajectories.euroc import looks_like_euroc, read_euroc
from civil_rgbd.trajectories.kitti import looks_like_kitti, read_kitti
from civil_rgbd.trajectories.lab_csv import looks_like_lab_csv, read_lab_csv
from civil_rgbd.trajectories.pose_table import (
    Beside,
    Poses,
    PoseTable,
    checked_trajectory,
    read_pose_table,
)
from civil_rgbd.trajectories.quality import quality_path, with_quality
from civil_rgbd.trajectories.r3live_log import looks_like_r3live_log, read_r3live_log
from civil_rgbd.trajectories.tum import looks_like_tum, read_tum


@dataclass(frozen=True, slots=True)
class TrajectoryFormat:
    """One format of trajectory files.

    Attributes:
        looks_like: tells a file of it by its first row.
        read: reads its poses.
        body: whose poses they are, where the format says so.
    """

    looks_like: Callable[[PoseTable], bool]
    read: Callable[[PoseTable, Beside], Poses]
    body: str | None = None


FORMATS: Final = {
    "tum": TrajectoryFormat(looks_like_tum, read_tum),
    "kitti": TrajectoryFormat(looks_like_kitti, read_kitti),
    "lab": TrajectoryFormat(looks_like_lab_csv, read_lab_csv, body="camera"),
    "r3live": TrajectoryFormat(looks_like_r3live_log, read_r3live_log, body="imu"),
    "euroc": TrajectoryFormat(looks_like_euroc, read_euroc),
    "colmap": TrajectoryFormat(looks_like_colmap, read_colmap, body="camera"),
}
"""Formats that are read, by the name that ``--trajectory-format`` gives them."""


@dataclass(frozen=True, slots=True, eq=False)
class TrajectoryFile:
    """A trajectory file, read.

    Attributes:
        trajectory: its poses, ``T_map_body``.
        format: key of :data:`FORMATS`.
        body: whose poses they are, where the format or the file's heading says so: camera, lidar
            or imu.
        sources: the file, the time list that gave it stamps, and the quality beside it.
        note: where the poses come from, in words, for the manifest.
    """

    trajectory: Trajectory
    format: str
    body: str | None
    sources: tuple[SourceFile, ...]
    note: str


def read_trajectory(
    path: Path,
    *,
    format: str | None = None,  # noqa: A002  # the word of the option
    times_path: Path | None = None,
    image_times: Path | None = None,
    metric_scale: float | None = None,
    time_offset_ns: int = 0,
    images: Path | None = None,
) -> Trajectory:
    """Read the poses of a trajectory file; see :func:`read_trajectory_file`."""
    return read_trajectory_file(
        path,
        format=format,
        times_path=times_path,
        image_times=image_times,
        metric_scale=metric_scale,
        time_offset_ns=time_offset_ns,
        images=images,
    ).trajectory


def read_trajectory_file(
    path: Path,
    *,
    format: str | None = None,  # noqa: A002  # the word of the option
    times_path: Path | None = None,
    image_times: Path | None = None,
    metric_scale: float | None = None,
    time_offset_ns: int = 0,
    images: Path | None = None,
) -> TrajectoryFile:
    """Read a trajectory file.

    Args:
        path: TUM, KITTI, the lab's poses.csv, R3LIVE's lic_lio.log, EuRoC CSV or COLMAP images.txt.
        format: key of :data:`FORMATS`; None tells it by the content.
        times_path: stamps of the poses of KITTI (one a line), the lab (one for each id) and COLMAP
            (by image name).
        image_times: stamps of images, taken for poses of images (COLMAP, the lab) when
            ``times_path`` is not given.
        metric_scale: metres in one unit of the file; needed for COLMAP.
        time_offset_ns: added to the file's stamps to reach the LiDAR's clock.
        images: the folder of COLMAP's images; it gives names to a time list without any.

    Raises:
        UsageError: the format is unknown or not clear, or something is to be given beside it.
        RecordingError: the file cannot be read, breaks its format, or holds no motion.
    """
    if metric_scale is not None and not 0 < metric_scale < math.inf:
        raise UsageError(
            f"--metric-scale is {metric_scale}",
            where="--metric-scale",
            fix="give metres per unit of the trajectory file, above 0",
        )
    table = read_pose_table(path)
    name = format or _detected(table)
    if name not in FORMATS:
        raise UsageError(
            f"no trajectory format goes by {name!r}",
            where="--trajectory-format",
            fix=nearest(name, FORMATS),
        )
    if times_path is None and FORMATS[name].body == "camera":
        times_path = image_times
    times = None
    if times_path is not None:
        times = read_stamp_list(times_path)
        if name == "colmap" and times.names is None and images is not None:
            times = _named(times, images)
    poses = FORMATS[name].read(table, Beside(times, metric_scale))
    trajectory = checked_trajectory(table, _moved(poses, metric_scale, time_offset_ns))
    sources = [file_source(path, f"trajectory-{name}")]
    if times_path is not None:
        sources.append(file_source(times_path, "times"))
    judged = quality_path(path)
    if judged.exists():
        trajectory = with_quality(trajectory, judged, time_offset_ns=time_offset_ns)
        sources.append(file_source(judged, "pose-quality"))
    return TrajectoryFile(
        trajectory,
        name,
        FORMATS[name].body or table.body,
        tuple(sources),
        _note(path.name, name, metric_scale, time_offset_ns),
    )


def _note(file: str, name: str, metric_scale: float | None, time_offset_ns: int) -> str:
    said = [f"{file} ({name})"]
    if time_offset_ns:
        said.append(f"its stamps moved by {signed_seconds(time_offset_ns)} s")
    if metric_scale is not None:
        said.append(f"{metric_scale:g} m a unit")
    return ", ".join(said)


def _moved(poses: Poses, metric_scale: float | None, time_offset_ns: int) -> Poses:
    return replace(
        poses,
        stamps_ns=[stamp + time_offset_ns for stamp in poses.stamps_ns],
        translations_m=poses.translations_m * (metric_scale or 1.0),
    )


def _detected(table: PoseTable) -> str:
    found = [name for name, form in FORMATS.items() if form.looks_like(table)]
    if len(found) == 1:
        return found[0]
    first = table.rows[0]
    separated = "commas" if table.commas else "spaces"
    what = (
        f"the trajectory's format is not clear: line {first.line} has {len(first.cells)} columns "
        f"separated by {separated} and begins with {first.cells[0]!r}"
    )
    raise UsageError(
        what + (f"; it may be {' or '.join(found)}" if found else ""),
        where=table.path,
        fix=f"name it with --trajectory-format: {', '.join(FORMATS)}; or export it as TUM, "
        "`stamp tx ty tz qx qy qz qw` in seconds and metres",
    )


def _named(times: StampList, images: Path) -> StampList:
    names = tuple(path.name for path in files_in_order(images, IMAGE_SUFFIXES))
    if len(names) != len(times.stamps_ns):
        raise RecordingError(
            f"{len(names)} images, but {len(times.stamps_ns)} stamps",
            where=times.where,
            fix=f"give one stamp for each image of {images.name}, or NAME,SECONDS a line",
        )
    return replace(times, names=names)
