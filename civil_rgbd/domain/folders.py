"""Folders of numbered files: what is in them, in which order."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from civil_rgbd.domain.recording import SourceFile
from civil_rgbd.errors import RecordingError

IMAGE_SUFFIXES: Final = (".jpg", ".jpeg", ".png")
"""Images that are read."""

TIME_LISTS: Final = ("timestamps.txt", "times.txt", "timestamps.csv", "times.csv")
"""Names of a time list that lies in the folder it belongs to, the first one found."""

_DIGITS: Final = re.compile(r"(\d+)", re.ASCII)


def numeric_order(name: str) -> tuple[tuple[tuple[int, int, str], ...], str]:
    """Return a key that sorts names by the numbers in them.

    >>> sorted(["10.pcd", "9.pcd", "1.pcd"], key=numeric_order)
    ['1.pcd', '9.pcd', '10.pcd']
    """
    parts = _DIGITS.split(name)
    key = tuple((0, int(part), "") if part.isdigit() else (1, 0, part) for part in parts if part)
    return key, name


def files_in_order(folder: Path, suffixes: Sequence[str]) -> tuple[Path, ...]:
    """List a folder's files of some kinds, in numeric order; hidden files are left out.

    Args:
        folder: looked at without its subfolders.
        suffixes: in lower case, with the dot.

    Raises:
        RecordingError: the folder is not there or cannot be read.
    """
    try:
        found = [
            path
            for path in folder.iterdir()
            if path.suffix.lower() in suffixes and not path.name.startswith(".") and path.is_file()
        ]
    except OSError as error:
        raise RecordingError(
            f"the folder cannot be read: {error.strerror or error}",
            where=folder,
            fix="check the path; give the folder that holds the files",
        ) from error
    return tuple(sorted(found, key=lambda path: numeric_order(path.name)))


def folder_source(folder: Path, files: Sequence[Path], converter: str) -> SourceFile:
    """Describe many files as one source.

    Args:
        folder: its name is the source's.
        files: what was read of it, in order.
        converter: what read them.

    Returns:
        the source; its sha256 is that of the lines ``SHA256  NAME`` of the files, as `sha256sum`
        prints them.

    Raises:
        RecordingError: a file cannot be read.
    """
    size_bytes, listing = 0, hashlib.sha256()
    for path in files:
        try:
            with path.open("rb") as file:
                digest = hashlib.file_digest(file, "sha256").hexdigest()
            size_bytes += path.stat().st_size
        except OSError as error:
            raise RecordingError(
                f"a file cannot be read: {error.strerror or error}",
                where=path,
                fix="check the disk and the file's permissions",
            ) from error
        listing.update(f"{digest}  {path.name}\n".encode())
    name = folder.name or folder.resolve().name
    return SourceFile(name, size_bytes, listing.hexdigest(), converter)


def file_source(path: Path, converter: str) -> SourceFile:
    """Describe one file as a source.

    Raises:
        RecordingError: it cannot be read.
    """
    try:
        with path.open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
        return SourceFile(path.name, path.stat().st_size, digest, converter)
    except OSError as error:
        raise RecordingError(
            f"a file cannot be read: {error.strerror or error}",
            where=path,
            fix="check the path, the disk and the file's permissions",
        ) from error
