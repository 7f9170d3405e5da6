"""Which file a recording is: its SHA-256, taken while it is read, or known already.

A file of this machine is hashed by a thread beside the walk. An object on object storage is hashed
from the very bytes that the walk reads; not even that when somebody wrote its hash down, when the
storage has it, or when it was taken before.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from civil_rgbd.domain.recording import RecordingOptions, SourceFile
from civil_rgbd.errors import RecordingError
from civil_rgbd.storage.hash_cache import cached_sha256, keep_sha256
from civil_rgbd.storage.places import Place
from civil_rgbd.storage.remote_path import RemotePath
from civil_rgbd.storage.sequential_hash import HashedPath, SequentialHash
from civil_rgbd.storage.stored_checksum import stored_sha256


@dataclass(frozen=True, slots=True)
class HashWanted:
    """Whether a file's hash is wanted, and what is known of it.

    Attributes:
        wanted: take it when it is not known.
        stated: written down by somebody.
    """

    wanted: bool = True
    stated: str | None = None


NOT_WANTED = HashWanted(wanted=False)


def hashes_wanted(options: RecordingOptions, files: int) -> list[HashWanted]:
    """Return what is wanted of each of some files, in order."""
    stated = [*options.sha256, *[None] * files][:files]
    return [HashWanted(options.source_hash, sha256) for sha256 in stated]


class BeingRead(Protocol):
    """A file that is read, and hashed meanwhile."""

    @property
    def path(self) -> Place:
        """Open this one to read it."""

    @property
    def size_bytes(self) -> int:
        """Its length."""

    def described(self, converter: str) -> SourceFile:
        """Return what a manifest says of it; call it after the file was read."""


@contextmanager
def being_read(path: Place, wanted: HashWanted) -> Iterator[BeingRead]:
    """Have a file hashed while it is read inside the block.

    Raises:
        OSError: it is not there, or cannot be read.
        RecordingError: the storage has another hash of it than was written down.
        StorageError: the storage cannot be reached, or refuses.
    """
    if isinstance(path, RemotePath):
        yield _Remote(path.pin(), wanted)
        return
    with ThreadPoolExecutor(max_workers=1) as beside:
        yield _Local(path, wanted, beside)


class _Local:
    def __init__(self, path: Path, wanted: HashWanted, beside: ThreadPoolExecutor) -> None:
        self.path, self.size_bytes = path, path.stat().st_size
        self._sha256 = beside.submit(_sha256, path) if wanted.wanted else None

    def described(self, converter: str) -> SourceFile:
        sha256 = self._sha256.result() if self._sha256 else None
        return SourceFile(self.path.name, self.size_bytes, sha256, converter)


class _Remote:
    def __init__(self, pinned: RemotePath, wanted: HashWanted) -> None:
        self.size_bytes, self._etag = pinned.pinned or (0, None)
        self.path, self._hash = pinned, None
        self._sha256 = _known(pinned, wanted) if wanted.wanted or wanted.stated else None
        if wanted.wanted and self._sha256 is None:
            self._hash = SequentialHash(pinned)
            self.path = HashedPath(pinned.url, pinned.pinned, self._hash)

    def described(self, converter: str) -> SourceFile:
        sha256, name = self._sha256, self.path.name
        if self._hash is not None:
            sha256 = self._hash.finish()
            keep_sha256(self.path, sha256)
        etag = self._etag.strip('"') if self._etag and sha256 is None else None
        return SourceFile(name, self.size_bytes, sha256, converter, etag)


def _known(pinned: RemotePath, wanted: HashWanted) -> str | None:
    found = stored_sha256(pinned) or cached_sha256(pinned)
    if wanted.stated and found and found != wanted.stated:
        raise RecordingError(
            f"the object has sha256 {found}, written down is {wanted.stated}",
            where=pinned,
            fix="upload the right file; if it was replaced on purpose, write the new sha256",
        )
    return wanted.stated or found


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
