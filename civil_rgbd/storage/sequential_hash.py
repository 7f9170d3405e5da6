"""The hash of a remote object, taken from the bytes that somebody else reads: no second journey."""

from __future__ import annotations

import hashlib
import io
from dataclasses import dataclass, field

from civil_rgbd.storage import range_file
from civil_rgbd.storage.range_file import RangeFile
from civil_rgbd.storage.remote_path import RemotePath


class SequentialHash:
    """SHA-256 of an object, fed by the blocks that a reader comes by; gaps are fetched.

    Args:
        path: the object, pinned.
    """

    def __init__(self, path: RemotePath) -> None:
        size_bytes, etag = path.pinned or (0, None)
        self._digest, self._next = hashlib.sha256(), 0
        self._last = -(-size_bytes // range_file.BLOCK_BYTES)
        self._file = RangeFile(path.url, size_bytes, etag)

    def take(self, number: int, block: bytes) -> None:
        """Take a block that was read; one that was taken before is let pass."""
        if number < self._next:
            return
        self._catch_up(number)
        self._digest.update(block)
        self._next = number + 1

    def finish(self) -> str:
        """Read what nobody has read, and return the hash, lower-case hex."""
        self._catch_up(self._last)
        return self._digest.hexdigest()

    def _catch_up(self, until: int) -> None:
        self._file.seek(self._next * range_file.BLOCK_BYTES)
        for _ in range(self._next, until):
            self._digest.update(self._file.read(range_file.BLOCK_BYTES))
        self._next = max(self._next, until)


@dataclass(frozen=True, slots=True)
class HashedPath(RemotePath):
    """An object whose hash is taken while it is read.

    Attributes:
        hash: is fed.
    """

    hash: SequentialHash | None = field(default=None, compare=False)

    def open(self, mode: str = "rb", buffering: int = -1) -> io.BufferedReader:
        """Open the object for reading by ranges; as :meth:`RemotePath.open`."""
        if mode != "rb":
            raise ValueError(f"mode {mode!r}: objects are written whole, by write_bytes")
        size_bytes, etag = self.pinned or (0, None)
        raw = RangeFile(self.url, size_bytes, etag)
        if self.hash is not None:
            raw.on_block = self.hash.take
        return io.BufferedReader(raw, max(buffering, 1 << 14))
