"""rosbag2's SQLite files by themselves, without the folder's metadata.yaml."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from civil_rgbd.conversion.container import Container, Extent, SinkFor
from civil_rgbd.conversion.db3_container import MAGIC, walk
from civil_rgbd.conversion.db3_payloads import Db3Payloads
from civil_rgbd.conversion.ros_files import (
    files_of,
    inspect_files,
    open_files,
    open_files_for_motion,
)
from civil_rgbd.conversion.topic_listing import list_files
from civil_rgbd.domain.inspection import RecordingSummary, TopicListing
from civil_rgbd.domain.motion import MotionRecording
from civil_rgbd.domain.recording import Recording, RecordingOptions
from civil_rgbd.errors import RecordingError
from civil_rgbd.storage.places import Place


def open_recording(location: str | Path, options: RecordingOptions | None = None) -> Recording:
    """Open a rosbag2 SQLite file: read it once, keep stamps, rows and poses.

    Args:
        location: the file, or a folder of files that follow one another.
        options: what the user says about it; further files of a recording that was split.

    Returns:
        an indexed recording; payloads are read when asked for.

    Raises:
        RecordingError: it is not there, no SQLite, damaged, or lacks what a build needs.
        UsageError: an option does not fit, or one is needed to choose.
    """
    options = options or RecordingOptions()
    return open_files(files_of(DB3, location, options), options)


def open_motion(location: str | Path, options: RecordingOptions | None = None) -> MotionRecording:
    """Open LiDAR and IMU of a file, for odometry; errors as :func:`open_recording`."""
    options = options or RecordingOptions()
    return open_files_for_motion(files_of(DB3, location, options), options)


def inspect_recording(
    location: str | Path, options: RecordingOptions | None = None
) -> RecordingSummary:
    """Say what a file holds, whether a build can use it or not; errors as of a missing file."""
    options = options or RecordingOptions()
    return inspect_files(files_of(DB3, location, options), options)


def list_topics(location: str | Path, options: RecordingOptions | None = None) -> TopicListing:
    """List the topics, by their rows; errors as of a missing file."""
    return list_files(files_of(DB3, location, options or RecordingOptions()))


def _refuse(path: Place, start: bytes) -> None:
    if not start.startswith(MAGIC):
        raise RecordingError(
            f"this is no SQLite file: it is empty or starts with {start[: len(MAGIC)]!r}",
            where=path,
            fix="give a .db3 file; a file goes by its suffix: see that it has the right one",
        )


def _local(path: Place) -> Path:
    if isinstance(path, Path):
        return path
    raise RecordingError(
        "SQLite reads files of this machine only",
        where=path,
        fix="download it first, or convert it to MCAP, which is read by ranges",
    )


def _walk(path: Place, sink_for: SinkFor, size_bytes: int, base: int) -> Extent:
    return walk(_local(path), sink_for, size_bytes, base)


def _payloads(path: Place, size_bytes: int) -> Db3Payloads:
    return Db3Payloads(_local(path), size_bytes)


DB3: Final = Container(
    name="db3",
    refuse=_refuse,
    walk=_walk,
    payloads=_payloads,
    recompress="compress it anew: `ros2 bag convert` with compression_format zstd",
)
"""rosbag2's SQLite storage, alone or in a ROS 2 folder."""
