"""MCAP files with ROS 2 messages."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

from civil_rgbd.conversion.inspection import Walked, WatchedTable, summarise
from civil_rgbd.conversion.mcap_container import MAGIC, Extent, walk
from civil_rgbd.conversion.mcap_payloads import McapPayloads
from civil_rgbd.conversion.ros_assembly import Opened, assemble
from civil_rgbd.conversion.ros_motion import MotionTable, assemble_motion
from civil_rgbd.conversion.topics import TopicTable
from civil_rgbd.domain.inspection import RecordingSummary
from civil_rgbd.domain.motion import MotionRecording
from civil_rgbd.domain.recording import (
    Recording,
    RecordingNotes,
    RecordingOptions,
    SourceFile,
)
from civil_rgbd.errors import RecordingError

_SAID_AT_MOST = 5


def open_recording(location: str | Path, options: RecordingOptions | None = None) -> Recording:
    """Open an MCAP file: read it once, keep stamps, places and poses.

    Args:
        location: the file.
        options: what the user says about it.

    Returns:
        an indexed recording; payloads are read when asked for.

    Raises:
        RecordingError: it is not there, no MCAP, damaged, or lacks what a build needs.
        UsageError: an option does not fit, or one is needed to choose.
    """
    options = options or RecordingOptions()
    with _walked(Path(location), options, TopicTable()) as opened:
        return assemble(opened, options)


def open_motion(location: str | Path, options: RecordingOptions | None = None) -> MotionRecording:
    """Open LiDAR and IMU of an MCAP file, for odometry; errors as :func:`open_recording`."""
    options = options or RecordingOptions()
    with _walked(Path(location), options, MotionTable()) as opened:
        return assemble_motion(opened, options)


def inspect_recording(
    location: str | Path, options: RecordingOptions | None = None
) -> RecordingSummary:
    """Say what an MCAP file holds, whether a build can use it or not.

    Args:
        location: the file.
        options: what the user says about it.

    Raises:
        RecordingError: it is not there, no MCAP, or cannot be read at all.
    """
    path, options, watched = Path(location), options or RecordingOptions(), WatchedTable()
    size_bytes = _checked_size(path)
    try:
        extent = walk(path, watched.sink_for, size_bytes=size_bytes)
    except OSError as error:
        raise _unreadable(path, error) from error
    refused = None
    try:
        _judge(extent, options, path)
    except RecordingError as error:
        refused = error
    payloads = McapPayloads(path.absolute(), size_bytes)
    source = SourceFile(path.name, size_bytes, "", "mcap")
    opened = Opened(watched.table, payloads, (source,), path.stem, path, RecordingNotes())
    remarks, damage = tuple(extent.remarks), tuple(extent.damage)
    walked = Walked("mcap", path.name, size_bytes, extent.messages, damage, remarks, refused)
    try:
        return summarise(watched, opened, walked, options)
    finally:
        payloads.close()


@contextmanager
def _walked(path: Path, options: RecordingOptions, table: TopicTable) -> Iterator[Opened]:
    size_bytes = _checked_size(path)
    try:
        with ThreadPoolExecutor(max_workers=1) as beside:
            sha256 = beside.submit(_sha256, path)
            extent = walk(path, table.sink_for, size_bytes=size_bytes)
        source = SourceFile(path.name, size_bytes, sha256.result(), "mcap")
    except OSError as error:
        raise _unreadable(path, error) from error
    salvage = _judge(extent, options, path)
    payloads = McapPayloads(path.absolute(), size_bytes)
    notes = RecordingNotes(
        salvage=salvage, simulated=extent.simulated, warnings=tuple(extent.remarks)
    )
    try:
        yield Opened(table, payloads, (source,), path.stem, path, notes)
    finally:
        payloads.close()


def _checked_size(path: Path) -> int:
    if path.is_dir():
        inside = sorted(entry.name for entry in path.glob("*.mcap"))
        raise RecordingError(
            "this is a folder, not an MCAP file",
            where=path,
            fix=f"name the file inside: {', '.join(inside)}" if inside else "name an .mcap file",
        )
    try:
        size_bytes = path.stat().st_size
        with path.open("rb") as file:
            start = file.read(len(MAGIC))
    except FileNotFoundError as error:
        raise RecordingError(
            f"there is no such recording: {str(path)!r}",
            where=path.absolute().parent,
            fix="check the path",
        ) from error
    except OSError as error:
        raise _unreadable(path, error) from error
    if start != MAGIC:
        raise RecordingError(
            f"this is no MCAP file: it is empty or starts with {start!r}",
            where=path,
            fix="give an .mcap file; other bags are converted first, e.g. with `rosbags-convert`",
        )
    return size_bytes


def _unreadable(path: Path, error: OSError) -> RecordingError:
    return RecordingError(
        f"the recording cannot be read: {error.strerror or error}",
        where=path,
        fix="check the disk and the file's permissions",
    )


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _judge(extent: Extent, options: RecordingOptions, path: Path) -> str | None:
    """Return what was lost, in words; None when nothing was.

    Raises:
        RecordingError: something was lost, and the user did not ask to go on without it.
    """
    if not extent.damage:
        return None
    said = "; ".join(extent.damage[:_SAID_AT_MOST])
    if len(extent.damage) > _SAID_AT_MOST:
        said += f"; and {len(extent.damage) - _SAID_AT_MOST} more"
    readable = f"{extent.messages} messages over {extent.duration_s:.3f} s are readable"
    if extent.unknown_compression:
        raise RecordingError(
            said,
            where=path,
            fix="compress it anew: `mcap convert --compression zstd`",
        )
    if not options.salvage:
        raise RecordingError(
            f"the recording is damaged: {said}; {readable}",
            where=path,
            fix="record or copy it again, or go on with what is readable: --salvage",
        )
    return f"{said}; {readable}"
