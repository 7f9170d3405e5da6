"""Where files lie: a path of this machine, or a URL of object storage."""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Final, TypeGuard

from civil_rgbd.errors import UsageError
from civil_rgbd.storage.remote_path import RemotePath

Place = Path | RemotePath
"""Both have the same methods, as far as files are read here, and files and folders written."""

_URL: Final = re.compile(r"([a-z][a-z0-9+.-]+)://", re.IGNORECASE)
_FLATTENED: Final = re.compile(  # what pathlib makes of a URL; one letter alone is a drive
    r"([a-z][a-z0-9+.-]+):(?:[/\\](?![/\\])|$)", re.IGNORECASE
)


def place_of(location: str | os.PathLike[str] | RemotePath) -> Place:
    """Tell a URL from a path.

    Args:
        location: a path, or a URL such as ``s3://bucket/scans/one.mcap``.

    Raises:
        UsageError: a URL names no bucket, or a file of this machine.

    >>> place_of("s3://raw-scans/one.mcap")
    RemotePath('s3://raw-scans/one.mcap')
    >>> place_of(Path("s3://raw-scans/one.mcap"))
    RemotePath('s3://raw-scans/one.mcap')
    >>> place_of("scans/one.mcap") == Path("scans/one.mcap")
    True
    """
    if isinstance(location, RemotePath):
        return location
    text = os.fspath(location)
    if isinstance(location, Path):
        flattened = _FLATTENED.match(text)
        if flattened is None:
            return location
        text = f"{flattened[1]}://{text[flattened.end() :]}".replace("\\", "/")
    url = _URL.match(text)
    return _remote(url[1].lower(), text[url.end() :]) if url else Path(text)


def _remote(protocol: str, name: str) -> RemotePath:
    if protocol == "file" or not name.strip("/"):
        raise UsageError(
            "a file of this machine has no file://"
            if protocol == "file"
            else "the URL names no bucket",
            where=f"{protocol}://{name}",
            fix="give a path" if protocol == "file" else f"give {protocol}://BUCKET/KEY",
        )
    return RemotePath(f"{protocol}://{name}")


def is_remote(place: Place) -> TypeGuard[RemotePath]:
    """Tell whether a place lies on object storage."""
    return isinstance(place, RemotePath)


def entries_of(folder: Place) -> list[Place]:
    """Return what lies directly in a folder, by name; [] when there is no such folder."""
    if isinstance(folder, RemotePath):
        return list(folder.iterdir())
    return [*sorted(folder.iterdir())] if folder.is_dir() else []


def files_below(folder: Place) -> Mapping[str, int]:
    """Return the size in bytes of every file below a folder, by its path in the folder.

    Paths have forward slashes. A link to a folder is one entry, and is not followed.
    """
    if isinstance(folder, RemotePath):
        return folder.files_below()
    found: dict[str, int] = {}
    for root, folders, names in os.walk(folder):
        links = [name for name in folders if (Path(root) / name).is_symlink()]
        for name in names + links:
            path = Path(root) / name
            found[path.relative_to(folder).as_posix()] = path.lstat().st_size
    return found


def remove_tree(folder: Place) -> None:
    """Take a folder away with all that is in it; one that is not there is no error."""
    if isinstance(folder, RemotePath):
        folder.remove_tree()
    else:
        shutil.rmtree(folder, ignore_errors=True)
