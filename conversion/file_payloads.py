"""Single messages of one file, fetched by their place; the file is opened when first asked."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import OrderedDict
from typing import Any, BinaryIO, Final

from civil_rgbd.conversion.compression import ChunkError
from civil_rgbd.conversion.container import NO_CHUNK
from civil_rgbd.errors import RecordingError
from civil_rgbd.storage.places import Place

_KEPT_CHUNKS: Final = 8
_KEPT_BYTES: Final = 1 << 28


class ChunkedPayloads(ABC):
    """Random access to messages; opens its file when first asked, in whatever process that is.

    The last few decompressed chunks are kept, as neighbours are asked for together. Containers
    differ in how a chunk is found and what a stored message looks like.
    """

    def __init__(self, path: Place, size_bytes: int) -> None:
        self._path, self._size_bytes = path, size_bytes
        self._file: BinaryIO | None = None
        self._chunks: OrderedDict[int, memoryview] = OrderedDict()

    def __reduce__(self) -> tuple[Any, ...]:
        # Neither the open file nor what is kept in memory travels to a worker.
        return (type(self), (self._path, self._size_bytes))

    @abstractmethod
    def records_at(self, start: int) -> memoryview:
        """Return the decompressed records of the chunk that starts at a byte.

        Raises:
            ChunkError: there is no such chunk, or it cannot be read.
        """

    def message(self, stored: memoryview) -> memoryview:
        """Return a message as its publisher wrote it.

        Raises:
            ChunkError: it is compressed and damaged.
        """
        return stored

    def fetch(self, chunk_start: int, offset: int, length: int) -> memoryview:
        """Return one message's payload.

        Args:
            chunk_start: where its chunk record starts, or -1 outside of chunks.
            offset: where the payload starts, in the chunk's uncompressed bytes or in the file.
            length: of the payload.

        Raises:
            RecordingError: the file is gone, changed, or cannot be read.
        """
        try:
            if chunk_start == NO_CHUNK:
                payload = self.read(offset, length)
            else:
                payload = self._chunk(chunk_start)[offset : offset + length]
            if len(payload) != length:
                raise changed(self._path)
            return self.message(payload)
        except (OSError, ChunkError) as error:
            raise no_longer(self._path, error) from error

    def _chunk(self, start: int) -> memoryview:
        if start in self._chunks:
            self._chunks.move_to_end(start)
            return self._chunks[start]
        records = self.records_at(start)
        self._chunks[start] = records
        while len(self._chunks) > _KEPT_CHUNKS or (
            len(self._chunks) > 1 and sum(map(len, self._chunks.values())) > _KEPT_BYTES
        ):
            self._chunks.popitem(last=False)
        return records

    def read(self, at: int, length: int) -> memoryview:
        """Return bytes of the file, fewer at its end."""
        if self._file is None:
            self._file = self._path.open("rb")
            if self._file.seek(0, 2) != self._size_bytes:
                raise changed(self._path)
        self._file.seek(at)
        return memoryview(self._file.read(min(length, self._size_bytes)))

    def close(self) -> None:
        """Let go of the file and of the kept chunks; the next fetch opens it again."""
        if self._file is not None:
            self._file.close()
        self._file = None
        self._chunks.clear()

    def __del__(self) -> None:
        self.close()


def changed(path: Place) -> RecordingError:
    """Compose the error for a file that was exchanged or written to."""
    return RecordingError(
        "the file is not the one that was opened: its length or content changed",
        where=path,
        fix="wait until nothing writes to it, then start again",
    )


def no_longer(path: Place, error: Exception) -> RecordingError:
    """Compose the error for a message that was there when the file was walked."""
    return RecordingError(
        f"a message can no longer be read: {error}",
        where=path,
        fix="see that the disk is healthy and the file is not being written to",
    )
