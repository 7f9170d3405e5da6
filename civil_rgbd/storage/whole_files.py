"""Files that are whole or absent, on this machine or on object storage."""

from __future__ import annotations

import contextlib
import os
import secrets
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from civil_rgbd.errors import OutputError
from civil_rgbd.storage.places import Place
from civil_rgbd.storage.remote_path import RemotePath


@contextmanager
def writing(where: object) -> Iterator[None]:
    """Turn the system's refusals to write inside the block into OutputErrors.

    Args:
        where: the file or folder that is written, for the message.

    Raises:
        OutputError: the disk is full, the folder is not writable, or the like.
    """
    try:
        yield
    except OSError as error:
        raise OutputError(
            f"cannot write: {error.strerror or error}",
            where=where,
            fix="free some space, or make the folder writable, or write elsewhere",
        ) from error


def scratch_beside(path: Path) -> Path:
    """Return a name beside ``path`` that nobody else writes to, nor anything left by a kill has.

    Args:
        path: a file or folder on this machine, or on a disk that machines share.
    """
    # Not the process id: two containers that write to one file system may both be process 1.
    return path.with_name(f".{path.name}.{secrets.randbelow(10**12)}.partial")


@contextmanager
def whole_file(path: Place, *, sync: bool = True) -> Iterator[Path]:
    """Give a scratch path to write to; it becomes ``path`` only if the block succeeds.

    Args:
        path: the file to make; its folder exists. May lie on object storage.
        sync: bring the bytes to the disk before the rename; without it the caller syncs later.

    Raises:
        OutputError: the system refuses to write.
    """
    if isinstance(path, RemotePath):
        with writing(path), _whole_object(path) as scratch:
            yield scratch
        return
    scratch = scratch_beside(path)
    with writing(path):
        try:
            yield scratch
            if sync:
                sync_one(scratch)
            scratch.replace(path)
        except BaseException:
            with contextlib.suppress(OSError):
                scratch.unlink(missing_ok=True)
            raise
        if sync:
            sync_one(path.parent)


def sync_one(path: Path) -> None:
    """Bring a file or folder to the disk; folders only where the system lets one open them."""
    # Windows flushes only handles that may write, and opens no folders at all.
    flags = os.O_RDWR if os.name == "nt" else os.O_RDONLY
    if os.name == "nt" and path.is_dir():
        return
    handle = os.open(path, flags)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


@contextmanager
def _whole_object(path: RemotePath) -> Iterator[Path]:
    """Give a scratch file on this machine; it becomes the object only if the block succeeds.

    Raises:
        OutputError: the scratch file cannot be written.
        StorageError: the storage cannot be reached, or refuses.
    """
    try:
        with tempfile.TemporaryDirectory(prefix="civil_rgbd_") as folder:
            scratch = Path(folder) / path.name
            yield scratch
            data = scratch.read_bytes()
    except OSError as error:
        raise OutputError(
            f"cannot write a file on its way to {path}: {error.strerror or error}",
            where=tempfile.tempdir or "TMPDIR",
            fix="free some space there, or set TMPDIR to another folder of this machine",
        ) from error
    path.write_bytes(data)
