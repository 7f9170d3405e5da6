"""Files and folders that are whole or absent, and locks that die with their holder."""

from __future__ import annotations

import contextlib
import errno
import os
import platform
import random
import shutil
import time
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from civil_rgbd.errors import OutputError
from civil_rgbd.storage.lease import leased
from civil_rgbd.storage.places import Place
from civil_rgbd.storage.remote_path import RemotePath
from civil_rgbd.storage.whole_files import sync_one, whole_file, writing

__all__ = [
    "folder_lock",
    "publish_folder",
    "recover_folder",
    "sync_files",
    "sync_tree",
    "whole_file",  # of the storage room, which rooms beside this one know as well
    "writing",
]

_POLL_S: Final = 0.05
_SYNCED_AT_ONCE: Final = 16  # journals commit together what waits together: 3 to 4 times faster
_SHARERS: Final = 4096  # on Windows
_TRIES: Final = 100  # to open a file whose folder others take away when they end
_LOCKED_BYTE: Final = 1 << 30  # beyond the holder's note: Windows forbids reading a locked byte
_held: set[tuple[int, str]] = set()  # (process, lock file): POSIX locks do not bar their own holder


def _sync_all(files: Sequence[Path]) -> None:
    with ThreadPoolExecutor(max(1, min(_SYNCED_AT_ONCE, len(files)))) as pool:
        for _ in pool.map(sync_one, files):
            pass  # raises what one of them raised


def sync_tree(folder: Place) -> None:
    """Bring every file and folder below ``folder``, and itself, to the disk.

    Raises:
        OutputError: the system refuses.
    """
    if isinstance(folder, RemotePath):
        return  # an object that is there is safe
    with writing(folder):
        below = list(os.walk(folder, topdown=False))
        _sync_all([Path(root, name) for root, _, names in below for name in names])
        for root, _, _ in below:
            sync_one(Path(root))


def sync_files(folder: Place, paths: Iterable[str]) -> None:
    """Bring some files, and the folders they lie in, to the disk.

    Args:
        folder: what the paths are relative to.
        paths: of the files.

    Raises:
        OutputError: the system refuses.
    """
    if isinstance(folder, RemotePath):
        return  # an object that is there is safe
    files = [folder / path for path in paths]
    with writing(folder):
        _sync_all(files)
        for path in [*sorted({path.parent for path in files}), folder]:
            sync_one(path)


def _aside(destination: Path) -> Path:
    return destination.with_name(f".{destination.name}.replaced")


def recover_folder(destination: Place) -> None:
    """Undo what a kill in the middle of :func:`publish_folder` left behind.

    The old folder moves back when the new one did not arrive, and is deleted when it did. Call it
    under the lock, before looking at ``destination``.

    Raises:
        OutputError: the system refuses.
    """
    if isinstance(destination, RemotePath):
        return  # without its last object it counts as absent
    aside = _aside(destination)
    if not aside.exists():
        return
    with writing(destination):
        if destination.exists():
            shutil.rmtree(aside)
        else:
            aside.rename(destination)


def publish_folder(partial: Path, destination: Path, *, replace: bool) -> None:
    """Make a finished folder appear by one rename.

    An old folder is moved aside first and deleted afterwards: a kill leaves the old or the new one
    whole, in the gap between two renames under a name that :func:`recover_folder` knows.

    Args:
        partial: the finished folder, synced, on the same file system.
        destination: where it belongs.
        replace: take the place of an existing folder; without it one is an error.

    Raises:
        OutputError: ``destination`` exists, or the system refuses.
    """
    recover_folder(destination)
    if destination.exists() and not replace:
        raise OutputError(
            "the folder exists already", where=destination, fix="give --overwrite to replace it"
        )
    with writing(destination):
        destination.parent.mkdir(parents=True, exist_ok=True)
        aside = _aside(destination)
        if destination.exists():
            destination.rename(aside)
        try:
            partial.rename(destination)
        except OSError:
            if aside.exists():
                aside.rename(destination)
            raise
        sync_one(destination.parent)
        sync_one(partial.parent)
        if aside.exists():
            shutil.rmtree(aside)


@contextmanager
def folder_lock(path: Place, *, wait_s: float = 0.0, shared: bool = False) -> Iterator[None]:
    """Hold the only right to write a folder, or one right of many.

    The lock file ``.<name>.lock`` lies beside the folder, so that the folder can be renamed, and
    goes with the lock. Workers that the holder forked do not hold it.

    Args:
        path: the folder; it need not exist, its parent is made.
        wait_s: how long to wait for another holder.
        shared: hold it together with other sharers, who keep out of each other's files; nobody
            holds it alone meanwhile.

    Raises:
        OutputError: another process holds it, or the system refuses to write.
    """
    if isinstance(path, RemotePath):
        with leased(path, wait_s=wait_s, shared=shared):
            yield
        return
    lock_file = path.with_name(f".{path.name.lstrip('.')}.lock")
    with writing(lock_file):
        path.parent.mkdir(parents=True, exist_ok=True)
    key = (os.getpid(), str(lock_file.resolve()))
    deadline = time.monotonic() + wait_s
    handle = None
    while handle is None:
        handle = None if key in _held else _try(lock_file, shared=shared)
        if handle is None:
            if time.monotonic() >= deadline:
                raise OutputError(
                    f"{_holder(lock_file, key)} is writing here", where=path, fix=_fix(lock_file)
                )
            time.sleep(_POLL_S)
    _held.add(key)
    try:
        yield
    finally:
        _held.discard(key)
        _release(handle, lock_file, shared=shared)


def _fix(lock_file: Path) -> str:
    return f"wait for it to finish or end it; {lock_file.name} goes when its holder does"


def _try(lock_file: Path, *, shared: bool) -> int | None:
    handle = None
    while handle is None:
        handle = _opened(lock_file)
        try:
            _lock(handle, shared=shared)
        except OSError:
            os.close(handle)
            return None
        if os.name != "nt" and not _is_still(handle, lock_file):
            os.close(handle)  # its last holder deleted it between our opening and our locking
            handle = None
    with contextlib.suppress(OSError):  # the note is a courtesy; a full disk must not stop us here
        os.ftruncate(handle, 0)
        note = f"process {os.getpid()} on {platform.node()}"
        os.write(handle, (f"one of several parts, {note}," if shared else note).encode())
    return handle


def _opened(lock_file: Path) -> int:
    with writing(lock_file):
        for _ in range(_TRIES):
            with contextlib.suppress(FileNotFoundError):
                # The last build that ends takes the folder away, perhaps since we made it.
                lock_file.parent.mkdir(parents=True, exist_ok=True)
                return os.open(lock_file, os.O_RDWR | os.O_CREAT, 0o644)
        raise FileNotFoundError(errno.ENOENT, "its folder is taken away again and again")


def _is_still(handle: int, lock_file: Path) -> bool:
    try:
        there = lock_file.stat()
    except FileNotFoundError:
        return False
    here = os.fstat(handle)
    return (here.st_dev, here.st_ino) == (there.st_dev, there.st_ino)


def _release(handle: int, lock_file: Path, *, shared: bool) -> None:
    if shared:
        try:
            _lock(handle, shared=False)
        except OSError:
            os.close(handle)  # others share it: the last one deletes the file
            return
    if os.name != "nt":
        # Deleted while still held: whoever opened it meanwhile sees that it is no longer there.
        with contextlib.suppress(OSError):
            lock_file.unlink()
    os.close(handle)
    if os.name == "nt":
        with contextlib.suppress(OSError):
            lock_file.unlink()


def _holder(lock_file: Path, key: tuple[int, str]) -> str:
    if key in _held:
        return "this very process"
    try:
        return lock_file.read_text("utf-8") or "another process"
    except (OSError, ValueError):
        return "another process"


if os.name == "nt":
    import msvcrt  # only there on Windows

    def _lock(handle: int, *, shared: bool) -> None:
        # There is no shared lock: a sharer takes one byte of many, who wants it alone all of them.
        at, length = _LOCKED_BYTE, _SHARERS
        if shared:
            at, length = at + random.randrange(_SHARERS), 1  # noqa: S311  # no secret
        os.lseek(handle, at, os.SEEK_SET)
        msvcrt.locking(handle, msvcrt.LK_NBLCK, length)  # type: ignore[attr-defined,unused-ignore]  # Windows only
        os.lseek(handle, 0, os.SEEK_SET)

else:
    import fcntl

    def _lock(handle: int, *, shared: bool) -> None:
        # Not flock: that one survives in forked workers after their parent was killed.
        fcntl.lockf(handle, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
