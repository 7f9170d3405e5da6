"""The files behind a recording: as they are said to be, closed, and refused when damaged."""

from __future__ import annotations

import hashlib
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final

from civil_rgbd.domain.folders import IMAGE_SUFFIXES, files_in_order, folder_source
from civil_rgbd.domain.recording import Recording, RecordingOptions, SourceFile
from civil_rgbd.errors import CivilRgbdError

_DESCRIPTORS: Final = Path("/proc/self/fd")  # only Linux tells; elsewhere the rule holds untold
_LARGEST_COPY_BYTES: Final = 1 << 26


def sources_as_they_are(
    recording: Recording, location: str | Path, options: RecordingOptions
) -> Iterator[str]:
    """Yield sources whose size or checksum is not that of a file at the location."""
    there = _files_of(location, options)
    if there and not recording.sources:
        yield "it was read from files, but names none"
    folders = _folders_of(location, options)
    for source in recording.sources:
        if source in options.trajectory_sources:
            continue  # read before it was opened
        if source.name in folders:
            if not _holds(folders[source.name], source):
                yield f"source {source.name!r} is not what folder_source says of its files"
            continue
        paths = [path for path in there if path.name == source.name]
        if there and not paths:
            yield f"source {source.name!r} is no file at {location}"
        if paths and not any(path.stat().st_size == source.size_bytes for path in paths):
            yield f"source {source.name!r} has {paths[0].stat().st_size} bytes, not " + str(
                source.size_bytes
            )
        elif paths and not any(_sha256(path) == source.sha256 for path in paths):
            yield f"the sha256 of source {source.name!r} is not that of its bytes"


def _files_of(location: str | Path, options: RecordingOptions) -> list[Path]:
    found: list[Path] = []
    for given in (location, *options.more_files, *([options.images] if options.images else [])):
        path = Path(str(given))  # of a URL nothing lies on this disk
        if path.is_dir():
            found += [inside for inside in path.rglob("*") if inside.is_file()]
        elif path.is_file():
            found += [inside for inside in path.parent.iterdir() if inside.is_file()]
    return found


def _folders_of(location: str | Path, options: RecordingOptions) -> dict[str, Path]:
    given = [Path(location), *([options.images] if options.images else [])]
    return {path.resolve().name: path for path in given if path.is_dir()}


def _holds(folder: Path, source: SourceFile) -> bool:
    """Tell whether a source stands for the files of one kind in a folder."""
    kinds = [(suffix,) for suffix in {path.suffix.lower() for path in folder.iterdir()}]
    return any(
        folder_source(folder, files_in_order(folder, kind), source.converter) == source
        for kind in [*kinds, IMAGE_SUFFIXES]
    )


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def open_files() -> set[str]:
    """Return the regular files that this process holds open; empty where nobody tells."""
    found: set[str] = set()
    if not _DESCRIPTORS.is_dir():
        return found
    for entry in _DESCRIPTORS.iterdir():
        try:
            target = str(entry.readlink())
        except OSError:  # the one that listed the folder
            continue
        if Path(target).is_file():
            found.add(target)
    return found


Open = Callable[[str | Path, RecordingOptions], Recording]


def missing_files(
    open_recording: Open, location: str | Path, options: RecordingOptions
) -> Iterator[str]:
    """Yield what happens at a place where no recording is, unless it is a CivilRgbdError."""
    path = Path(location)
    if not path.exists():
        return
    missing = path.with_name(f"no_such_recording{path.suffix}")
    yield from _refused(open_recording, missing, options, "a file that is not there", must=True)


def damaged_files(
    open_recording: Open, location: str | Path, options: RecordingOptions
) -> Iterator[str]:
    """Yield what happens with files that are empty, cut or something else.

    A cut file may open, where what is left is whole; errors other than CivilRgbdError may not.
    """
    path = Path(location)
    if not path.is_file() or path.stat().st_size > _LARGEST_COPY_BYTES:
        return
    data = path.read_bytes()
    third = len(data) // 3
    cases = {
        "an empty file": b"",
        "a file of other content": b"\x17 is no recording\n" * 40,
        "a file without its second half": data[: len(data) // 2],
        "a file without its last byte": data[:-1],
        "a file with a hole": data[:third] + bytes(third) + data[2 * third :],
    }
    with tempfile.TemporaryDirectory() as folder:
        for what, content in cases.items():
            damaged = Path(folder) / path.name
            damaged.write_bytes(content)
            must = content is cases["an empty file"] or content is cases["a file of other content"]
            yield from _refused(open_recording, damaged, options, what, must=must)


def _refused(
    open_recording: Open, path: Path, options: RecordingOptions, what: str, *, must: bool
) -> Iterator[str]:
    try:
        open_recording(path, options)
    except CivilRgbdError as error:
        if not (error.what and error.where and error.fix):
            yield f"{what}: its {type(error).__name__} does not say what, where and the fix"
    except Exception as error:  # noqa: BLE001 - whatever a converter raises is a finding
        yield f"{what}: raises {type(error).__name__}: {error}"
    else:
        if must:
            yield f"{what} opens as if it were a recording"
