"""A remote object, open for reading: bytes come by range, and recent ones are kept."""

from __future__ import annotations

import io
import threading
from collections import OrderedDict
from collections.abc import Callable
from typing import TYPE_CHECKING, Final

from civil_rgbd.errors import RecordingError
from civil_rgbd.storage.client import ask, shown

if TYPE_CHECKING:
    from _typeshed import WriteableBuffer as Buffer

BLOCK_BYTES: Final = 1 << 22
"""Bytes come in blocks of this size: smaller ones cost a journey each, larger ones are wasted."""

KEPT_BLOCKS: Final = 24
"""How many blocks a process keeps, of all objects together: 96 MiB."""

_AHEAD_BLOCKS: Final = 4  # in one request, when blocks are asked for one after another

_Key = tuple[str, str | None, int]
_kept: OrderedDict[_Key, bytes] = OrderedDict()
_guard = threading.Lock()


class RangeFile(io.RawIOBase):
    """An object of known size and ETag, read by range, each range once while it is kept.

    Attributes:
        on_block: called with number and bytes of each block that is read from.
    """

    def __init__(self, url: str, size_bytes: int, etag: str | None) -> None:
        super().__init__()
        self.on_block: Callable[[int, bytes], object] | None = None
        self._url, self._size, self._etag = url, size_bytes, etag
        self._at, self._last_block = 0, -1

    def readable(self) -> bool:
        """Say yes."""
        return True

    def seekable(self) -> bool:
        """Say yes."""
        return True

    def tell(self) -> int:
        """Return the position."""
        return self._at

    def seek(self, offset: int, whence: int = 0) -> int:
        """Move the position; return it."""
        start = (0, self._at, self._size)[whence]
        self._at = max(0, start + offset)
        return self._at

    def readinto(self, buffer: Buffer) -> int:
        """Fill a buffer from the position on; return how many bytes it holds now."""
        view = memoryview(buffer).cast("B")
        data = self.read(len(view))
        view[: len(data)] = data
        return len(data)

    def read(self, length: int = -1) -> bytes:
        """Return bytes from the position on, fewer at the end.

        Raises:
            RecordingError: the object is not the one that was opened.
            StorageError: the storage cannot be reached, or refuses.
        """
        end = self._size if length < 0 else min(self._at + length, self._size)
        start, self._at = self._at, max(self._at, end)
        if start >= end:
            return b""
        first, last = start // BLOCK_BYTES, (end - 1) // BLOCK_BYTES
        blocks = self._blocks(first, last)
        skipped = start - first * BLOCK_BYTES
        if first == last:
            return blocks[0][skipped : skipped + end - start]
        blocks[0] = blocks[0][skipped:]
        blocks[-1] = blocks[-1][: end - last * BLOCK_BYTES]
        return b"".join(blocks)

    def _blocks(self, first: int, last: int) -> list[bytes]:
        found = {number: self._kept_block(number) for number in range(first, last + 1)}
        missing = [number for number, block in found.items() if block is None]
        if missing:
            until = missing[-1] + 1
            if missing[0] == self._last_block + 1:
                until = max(until, missing[0] + _AHEAD_BLOCKS)
            fetched = self._fetch(missing[0], until)
            found |= {n: block for n, block in fetched.items() if n in found}
        blocks = [found[number] or b"" for number in range(first, last + 1)]
        if self.on_block is not None:
            for number, block in enumerate(blocks, start=first):
                self.on_block(number, block)
        return blocks

    def _kept_block(self, number: int) -> bytes | None:
        key = self._url, self._etag, number
        with _guard:
            if key in _kept:
                _kept.move_to_end(key)
            return _kept.get(key)

    def _fetch(self, first: int, until: int) -> dict[int, bytes]:
        start, end = first * BLOCK_BYTES, min(until * BLOCK_BYTES, self._size)
        data = ask("read", self._url, start, end, self._etag)
        if data is None or len(data) != end - start:
            raise RecordingError(
                "the object is not the one that was opened: it was deleted or written anew",
                where=shown(self._url),
                fix="wait until nothing writes to it, then start again",
            )
        view = memoryview(data)
        fetched = {
            start // BLOCK_BYTES + place: bytes(view[at : at + BLOCK_BYTES])
            for place, at in enumerate(range(0, len(data), BLOCK_BYTES))
        }
        self._last_block = max(fetched)
        with _guard:
            _kept.update({(self._url, self._etag, n): block for n, block in fetched.items()})
            while len(_kept) > KEPT_BLOCKS:
                _kept.popitem(last=False)
        return fetched


def forget_ranges() -> None:
    """Let go of all that is kept."""
    with _guard:
        _kept.clear()
