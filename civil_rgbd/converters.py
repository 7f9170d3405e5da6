"""The only module that knows converters exist: finds the one that opens a recording."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import cast

from civil_rgbd.domain.inspection import RecordingSummary, TopicListing
from civil_rgbd.domain.motion import MotionRecording
from civil_rgbd.domain.recording import Recording, RecordingOptions
from civil_rgbd.errors import RecordingError, UsageError
from civil_rgbd.resources import nearest
from civil_rgbd.storage.places import Place, place_of
from civil_rgbd.storage.remote_path import RemotePath

ENTRY_POINT_GROUP = "civil_rgbd.converters"
"""A converter is ``open_recording(location, options) -> Recording`` under this group.

Its name is the file suffix that it opens (``mcap`` for ``scan.mcap``), or the word before the colon
of a location that is no file (``simulated:demo``). A folder goes to the converter that has the name
of a file inside (``metadata.yaml``), else to the one that opens the files inside. A module with
``open_motion`` beside it gives LiDAR and IMU to odometry as well, one with ``inspect_recording``
says what a recording lacks, and ``list_topics`` lists its topics without reading messages. One with
``READS_BY_RANGE`` is handed a :class:`civil_rgbd.storage.remote_path.RemotePath` for a URL.
"""


def converters() -> dict[str, EntryPoint]:
    """Return the installed converters by name."""
    return {point.name: point for point in entry_points(group=ENTRY_POINT_GROUP)}


def open_recording(location: str | Place, options: RecordingOptions | None = None) -> Recording:
    """Open a raw recording with the converter that its suffix names.

    Args:
        location: path of a recording, or ``name:...`` for a converter that reads no file.
        options: what the recording does not say itself.

    Returns:
        an indexed recording; nothing of it is decoded yet.

    Raises:
        UsageError: no converter goes by that suffix or name.
        RecordingError: the recording cannot be read or lacks something.
    """
    point, given = _converter_of(location)
    return cast("Recording", point.load()(given, options or RecordingOptions()))


def open_motion(location: str | Place, options: RecordingOptions | None = None) -> MotionRecording:
    """Open LiDAR and IMU of a raw recording, which needs neither camera nor poses.

    Args:
        location: path of a recording, or ``name:...`` for a converter that reads no file.
        options: what the recording does not say itself.

    Returns:
        an indexed recording; nothing of it is decoded yet.

    Raises:
        UsageError: no converter goes by that suffix or name, or it knows no IMU.
        RecordingError: the recording cannot be read or lacks something.
    """
    point, given = _converter_of(location)
    opener = getattr(import_module(point.module), "open_motion", None)
    if opener is None:
        raise UsageError(
            f"the converter {point.name!r} reads no IMU",
            where=location,
            fix="give a recording with LiDAR and IMU, such as a bag or an .mcap file",
        )
    return cast("MotionRecording", opener(given, options or RecordingOptions()))


def can_inspect(location: str | Place) -> bool:
    """Whether the converter of a recording looks at it without opening it.

    Raises:
        UsageError: no converter goes by that suffix or name.
        RecordingError: there is no such recording.
    """
    point, _ = _converter_of(location)
    return hasattr(import_module(point.module), "inspect_recording")


def inspect_recording(
    location: str | Place, options: RecordingOptions | None = None
) -> RecordingSummary:
    """Say what a raw recording holds, whether a build can use it or not.

    Args:
        location: path of a recording, or ``name:...`` for a converter that reads no file.
        options: what the recording does not say itself.

    Raises:
        UsageError: no converter goes by that suffix or name, or it cannot inspect.
        RecordingError: the recording cannot be read at all.
    """
    point, given = _converter_of(location)
    inspector = getattr(import_module(point.module), "inspect_recording", None)
    if inspector is None:
        raise UsageError(
            f"the converter {point.name!r} cannot inspect a recording without opening it",
            where=location,
            fix="start the build: it says what is missing",
        )
    return cast("RecordingSummary", inspector(given, options or RecordingOptions()))


def list_topics(location: str | Place, options: RecordingOptions | None = None) -> TopicListing:
    """List the topics of a raw recording, from its own index where that holds.

    Args:
        location: path of a recording.
        options: further files of a recording that was split.

    Raises:
        UsageError: no converter goes by that suffix or name, or its recordings have no topics.
        RecordingError: the recording cannot be read at all.
    """
    point, given = _converter_of(location)
    lister = getattr(import_module(point.module), "list_topics", None)
    if lister is None:
        raise UsageError(
            f"recordings that the converter {point.name!r} reads have no topics to list",
            where=location,
            fix="leave --topics out: the whole inspection says what there is",
        )
    return cast("TopicListing", lister(given, options or RecordingOptions()))


def _converter_of(location: str | Place) -> tuple[EntryPoint, str | Place]:
    known = converters()
    name, colon, _ = str(location).partition(":")
    if colon and name in known:
        return known[name], location
    path = place_of(location)
    if isinstance(path, RemotePath):
        return _converter_of_url(path, known), path
    found = _of_folder(path, known) if path.is_dir() else _of_file(path.name, known)
    if len(found) == 1:
        return known[found.pop()], path
    if not path.exists():
        raise RecordingError(
            f"there is no such recording: {str(location)!r}",
            where=path.absolute().parent,
            fix="check the path",
        )
    if found:
        raise UsageError(
            f"several converters open what lies in {path.name!r}: {', '.join(sorted(found))}",
            where=path,
            fix="name the recording inside",
        )
    suffix = path.suffix.removeprefix(".").lower()
    raise UsageError(
        f"no converter opens {path.name!r}",
        where=path,
        fix=nearest(suffix, known)
        + (" (a folder goes by its files)" if path.is_dir() else " (converters go by file suffix)"),
    )


def _converter_of_url(url: RemotePath, known: Mapping[str, EntryPoint]) -> EntryPoint:
    found = _of_file(url.name, known)
    if not found:
        raise UsageError(
            f"no converter opens {url.name!r}",
            where=url,
            fix=f"{nearest(url.suffix.removeprefix('.').lower(), known)} (converters go by file "
            "suffix; on object storage a recording is one file)",
        )
    point = known[found.pop()]
    if not getattr(import_module(point.module), "READS_BY_RANGE", False):
        raise UsageError(
            f".{point.name} files are read from this machine's disk only",
            where=url,
            fix=f"download it first (`aws s3 cp {url} .`), or convert it to MCAP, which is read by "
            "ranges",
        )
    return point


def _of_file(name: str, known: Iterable[str]) -> set[str]:
    """Return the name of the converter whose suffix fits, the longest of several."""
    fitting = [suffix for suffix in known if f".{name.lower()}".endswith(f".{suffix}")]
    return {max(fitting, key=len)} if fitting else set()


def _of_folder(folder: Path, known: Iterable[str]) -> set[str]:
    """Return the converters named after a file of the folder, else those of its files' suffixes."""
    inside = {path.name for path in folder.iterdir() if path.is_file()}
    named = inside & set(known)
    return named or set().union(*(_of_file(name, known) for name in inside))
