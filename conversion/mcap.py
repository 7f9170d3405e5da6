"""MCAP files with ROS 2 or ROS 1 messages."""

from __future__ import annotations

from typing import Final

from civil_rgbd.conversion.container import Container, Extent, SinkFor
from civil_rgbd.conversion.mcap_container import MAGIC, walk
from civil_rgbd.conversion.mcap_index import read_index
from civil_rgbd.conversion.mcap_payloads import McapPayloads
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

READS_BY_RANGE: Final = True
"""A recording may lie on object storage."""


def open_recording(location: str | Place, options: RecordingOptions | None = None) -> Recording:
    """Open an MCAP file: read it once, keep stamps, places and poses.

    Args:
        location: the file, or a folder of files that follow one another.
        options: what the user says about it; further files of a recording that was split.

    Returns:
        an indexed recording; payloads are read when asked for.

    Raises:
        RecordingError: it is not there, no MCAP, damaged, or lacks what a build needs.
        UsageError: an option does not fit, or one is needed to choose.
    """
    options = options or RecordingOptions()
    return open_files(files_of(MCAP, location, options), options)


def open_motion(location: str | Place, options: RecordingOptions | None = None) -> MotionRecording:
    """Open LiDAR and IMU of an MCAP file, for odometry; errors as :func:`open_recording`."""
    options = options or RecordingOptions()
    return open_files_for_motion(files_of(MCAP, location, options), options)


def inspect_recording(
    location: str | Place, options: RecordingOptions | None = None
) -> RecordingSummary:
    """Say what an MCAP file holds, whether a build can use it or not.

    Args:
        location: the file.
        options: what the user says about it.

    Raises:
        RecordingError: it is not there, no MCAP, or cannot be read at all.
    """
    options = options or RecordingOptions()
    return inspect_files(files_of(MCAP, location, options), options)


def list_topics(location: str | Place, options: RecordingOptions | None = None) -> TopicListing:
    """List the topics, by the index where it holds; errors as of a missing file."""
    return list_files(files_of(MCAP, location, options or RecordingOptions()))


def _refuse(path: Place, start: bytes) -> None:
    if not start.startswith(MAGIC):
        raise RecordingError(
            f"this is no MCAP file: it is empty or starts with {start[: len(MAGIC)]!r}",
            where=path,
            fix="give an .mcap file; a file goes by its suffix: see that it has the right one",
        )


def _walk(path: Place, sink_for: SinkFor, size_bytes: int, base: int) -> Extent:
    return walk(path, sink_for, size_bytes=size_bytes, base=base)


MCAP: Final = Container(
    name="mcap",
    refuse=_refuse,
    walk=_walk,
    payloads=McapPayloads,
    recompress="compress it anew: `mcap convert --compression zstd`",
    index=read_index,
)
"""MCAP, alone or as the storage of a ROS 2 folder."""
