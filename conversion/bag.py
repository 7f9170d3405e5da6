"""ROS 1 bags: chunks without compression, lz4 or bz2; with or without index."""

from __future__ import annotations

import re
from typing import Final

from civil_rgbd.conversion.bag_container import walk
from civil_rgbd.conversion.bag_index import read_index
from civil_rgbd.conversion.bag_payloads import BagPayloads
from civil_rgbd.conversion.bag_records import MAGIC
from civil_rgbd.conversion.container import Container
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

_VERSION: Final = re.compile(rb"#ROS(?:BAG|RECORD) V(\d+\.\d+)")
_ENCRYPTOR: Final = re.compile(rb"encryptor=([\w/:.-]{1,64})")

READS_BY_RANGE: Final = True
"""A recording may lie on object storage."""


def open_recording(location: str | Place, options: RecordingOptions | None = None) -> Recording:
    """Open a ROS 1 bag: read it once, keep stamps, places and poses.

    Args:
        location: the file, ``.bag`` or ``.bag.active``.
        options: what the user says about it; further files of a recording that was split.

    Returns:
        an indexed recording; payloads are read when asked for.

    Raises:
        RecordingError: it is not there, no bag, damaged, or lacks what a build needs.
        UsageError: an option does not fit, or one is needed to choose.
    """
    options = options or RecordingOptions()
    return open_files(files_of(BAG, location, options), options)


def open_motion(location: str | Place, options: RecordingOptions | None = None) -> MotionRecording:
    """Open LiDAR and IMU of a bag, for odometry; errors as :func:`open_recording`."""
    options = options or RecordingOptions()
    return open_files_for_motion(files_of(BAG, location, options), options)


def inspect_recording(
    location: str | Place, options: RecordingOptions | None = None
) -> RecordingSummary:
    """Say what a bag holds, whether a build can use it or not; errors as of a missing file."""
    options = options or RecordingOptions()
    return inspect_files(files_of(BAG, location, options), options)


def list_topics(location: str | Place, options: RecordingOptions | None = None) -> TopicListing:
    """List the topics, by the index where it holds; errors as of a missing file."""
    return list_files(files_of(BAG, location, options or RecordingOptions()))


def _refuse(path: Place, start: bytes) -> None:
    version = _VERSION.match(start)
    if version is None:
        raise RecordingError(
            f"this is no ROS 1 bag: it is empty or starts with {start[: len(MAGIC)]!r}",
            where=path,
            fix="give a .bag file; a file goes by its suffix: see that it has the right one",
        )
    if not start.startswith(MAGIC):
        raise RecordingError(
            f"this is a bag of version {version[1].decode()}; only version 2.0 is read",
            where=path,
            fix="convert it where ROS 1 is installed: `rosbag fix old.bag new.bag`",
        )
    encryptor = _ENCRYPTOR.search(start)
    if encryptor is not None:
        raise RecordingError(
            f"the bag is encrypted by {encryptor[1].decode('latin-1')!r}",
            where=path,
            fix="decrypt it where ROS 1 and the key are: `rosbag decrypt scan.bag`",
        )


BAG: Final = Container(
    name="bag",
    refuse=_refuse,
    walk=walk,
    payloads=BagPayloads,
    recompress="compress it anew where ROS 1 is installed: `rosbag compress --lz4 scan.bag`",
    index=read_index,
)
"""The only version of ROS 1's bags that is in use since 2010."""
