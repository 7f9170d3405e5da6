"""The only module that knows converters exist: finds the one that opens a recording."""

from __future__ import annotations

from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import cast

from civil_rgbd.domain.recording import Recording, RecordingOptions
from civil_rgbd.errors import RecordingError, UsageError
from civil_rgbd.resources import nearest

ENTRY_POINT_GROUP = "civil_rgbd.converters"
"""A converter is ``open_recording(location, options) -> Recording`` under this group.

Its name is the file suffix that it opens (``mcap`` for ``scan.mcap``), or the word before the colon
of a location that is no file (``simulated:demo``).
"""


def converters() -> dict[str, EntryPoint]:
    """Return the installed converters by name."""
    return {point.name: point for point in entry_points(group=ENTRY_POINT_GROUP)}


def open_recording(location: str | Path, options: RecordingOptions | None = None) -> Recording:
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
    known = converters()
    name, colon, _ = str(location).partition(":")
    if colon and name in known:
        return _open(known[name], location, options)
    path = Path(location)
    suffix = path.suffix.removeprefix(".").lower()
    if suffix in known:
        return _open(known[suffix], path, options)
    if not path.exists():
        raise RecordingError(
            f"there is no such recording: {str(location)!r}",
            where=path.absolute().parent,
            fix="check the path",
        )
    raise UsageError(
        f"no converter opens {path.name!r}",
        where=path,
        fix=nearest(suffix, known) + " (converters go by file suffix)",
    )


def _open(point: EntryPoint, location: str | Path, options: RecordingOptions | None) -> Recording:
    return cast("Recording", point.load()(location, options or RecordingOptions()))
