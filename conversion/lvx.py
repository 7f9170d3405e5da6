"""LVX files of Livox Viewer: version 1.1 (Avia, Horizon, Mid-70 ...) and 2 (Mid-360, HAP)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.conversion.beside import refuse_topics
from civil_rgbd.conversion.frame_tree import FrameTree
from civil_rgbd.conversion.lidar_only import LidarSource, assemble_lidar_only, tried
from civil_rgbd.conversion.lvx_file import read_lvx_header
from civil_rgbd.conversion.lvx_imu import read_imu
from civil_rgbd.conversion.lvx_scans import Index, LvxScans, index_scans
from civil_rgbd.conversion.lvx_summary import summarise_walk
from civil_rgbd.conversion.lvx_walk import Walk, walk_file
from civil_rgbd.domain.folders import file_source
from civil_rgbd.domain.inspection import RecordingSummary
from civil_rgbd.domain.motion import ImuReadings
from civil_rgbd.domain.recording import (
    Recording,
    RecordingNotes,
    RecordingOptions,
    SourceFile,
)
from civil_rgbd.domain.scan import LidarScan
from civil_rgbd.errors import RecordingError, UsageError

_HEADER_BYTES: Final = 29 + 255 * 63


@dataclass(frozen=True, slots=True, eq=False)
class LvxMotion:
    """LiDAR and IMU of a file; fits :class:`civil_rgbd.domain.motion.MotionRecording`.

    Attributes:
        name: the file's stem.
        sources: the file.
        notes: what is odd about it.
        scans: its scans.
        imu: everything that the IMU measured, forces in g.
        T_imu_lidar: (4, 4), as the rig file says; None when it does not.
    """

    name: str
    sources: tuple[SourceFile, ...]
    notes: RecordingNotes
    scans: LvxScans
    imu: ImuReadings
    T_imu_lidar: NDArray[np.float64] | None

    @property
    def scan_stamps_ns(self) -> NDArray[np.int64]:
        """(S,) stamps of all frames."""
        return self.scans.stamps_ns

    @property
    def is_livox(self) -> bool:
        """It is."""
        return True

    def read_scan(self, index: int) -> LidarScan:
        """Decode one frame.

        Raises:
            RecordingError: it cannot be read any more.
        """
        return self.scans.read(index)


def open_recording(location: str | Path, options: RecordingOptions | None = None) -> Recording:
    """Open an LVX file; camera, images and poses come from files beside it.

    Args:
        location: the file.
        options: what the user says about it; ``lidar_topic`` names the device where several are.

    Raises:
        RecordingError: it is no LVX file, damaged, or lacks what a build needs.
        UsageError: an option does not fit, or one is needed.
    """
    path, options = Path(location), options or RecordingOptions()
    return _assembled(_walked(path), options)


def _assembled(walk: Walk, options: RecordingOptions) -> Recording:
    path, (index, notes) = walk.path, _judged(walk, options)
    source = LidarSource(
        name=path.stem,
        scans=index.scans,
        sources=(file_source(path, "lvx"),),
        in_map=False,
        lidar_name=index.scans.device.name,
        notes=notes,
        where=path,
    )
    return assemble_lidar_only(source, options)


def open_motion(location: str | Path, options: RecordingOptions | None = None) -> LvxMotion:
    """Open LiDAR and IMU of an LVX file.

    Args:
        location: the file.
        options: what the user says about it.

    Raises:
        RecordingError: it is no LVX file, damaged, or has no IMU.
        UsageError: an option does not fit, or one is needed.
    """
    path, options = Path(location), options or RecordingOptions()
    walk = _walked(path)
    index, notes = _judged(walk, options)
    roles = FrameTree()
    for (a, b), T_a_b in options.rig.extrinsics.items():
        roles.link(a, b, T_a_b)
    return LvxMotion(
        name=path.stem,
        sources=(file_source(path, "lvx"),),
        notes=notes,
        scans=index.scans,
        imu=read_imu(path, walk.header, index.scans.device),
        T_imu_lidar=roles.find("imu", "lidar"),
    )


def inspect_recording(
    location: str | Path, options: RecordingOptions | None = None
) -> RecordingSummary:
    """Say what an LVX file holds, whether a build can use it or not.

    Args:
        location: the file.
        options: what the user says about it.

    Raises:
        RecordingError: it is not there, no LVX file, or its header is broken.
    """
    options = options or RecordingOptions()
    walk = _walked(Path(location))
    return tried(summarise_walk(walk), lambda: _assembled(walk, options))


def _walked(path: Path) -> Walk:
    """Read the header and walk the file once.

    Raises:
        RecordingError: it is no LVX file, or cannot be read.
    """
    try:
        with path.open("rb") as file:
            start = file.read(_HEADER_BYTES)
        return walk_file(path, read_lvx_header(start, where=path))
    except OSError as error:
        raise RecordingError(
            f"the recording cannot be read: {error.strerror or error}",
            where=path,
            fix="check the path, the disk and the file's permissions",
        ) from error


def _judged(walk: Walk, options: RecordingOptions) -> tuple[Index, RecordingNotes]:
    """Choose the device; what the file says of itself.

    Raises:
        RecordingError: it is damaged, or holds no points that can be used.
        UsageError: an option does not fit, or one is needed.
    """
    refuse_topics(options, "scan_times", "point_time", where=walk.path)
    if options.scans_in == "map":
        raise UsageError(
            "an LVX file holds what the LiDAR measured, in its own frame",
            where=walk.path,
            fix="leave --scans-in out",
        )
    index = index_scans(walk, options.lidar_topic, salvage=options.salvage)
    return index, RecordingNotes(
        salvage=index.salvage, warnings=index.warnings, counts=index.counts
    )
