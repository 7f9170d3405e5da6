"""Single messages of an MCAP file, fetched by their place."""

from __future__ import annotations

from collections import OrderedDict
from pathlib import Path
from typing import Any, BinaryIO, Final

from civil_rgbd.conversion.mcap_chunks import ChunkError, message_of, parse_chunk, records_of
from civil_rgbd.conversion.mcap_container import NO_CHUNK, RECORD
from civil_rgbd.errors import RecordingError

_KEPT_CHUNKS: Final = 8
_KEPT_BYTES: Final = 1 << 28


class McapPayloads:
    """Random access to messages; opens its file when first asked, in whatever process that is.

    The last few decompressed chunks are kept, as neighbours are asked for together.
    """

    def __init__(self, path: Path, size_bytes: int) -> None:
        self._path, self._size_bytes = path, size_bytes
        self._file: BinaryIO | None = None
        self._chunks: OrderedDict[int, memoryview] = OrderedDict()

    def __reduce__(self) -> tuple[Any, ...]:
        # Neither the open file nor what is kept in memory travels to a worker.
        return (McapPayloads, (self._path, self._size_bytes))

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
                payload = self._read(offset, length)
            else:
                payload = self._chunk(chunk_start)[offset : offset + length]
            if len(payload) != length:
                raise self._changed()
            return message_of(payload)
        except (OSError, ChunkError) as error:
            raise RecordingError(
                f"a message can no longer be read: {error}",
                where=self._path,
                fix="see that the disk is healthy and the file is not being written to",
            ) from error

    def _chunk(self, start: int) -> memoryview:
        if start in self._chunks:
            self._chunks.move_to_end(start)
            return self._chunks[start]
        head = self._read(start, RECORD.size)
        if len(head) < RECORD.size:
            raise self._changed()
        _, length = RECORD.unpack(head)
        body = self._read(start + RECORD.size, min(length, self._size_bytes))
        records = records_of(parse_chunk(body, cut=len(body) < length))
        self._chunks[start] = records
        while len(self._chunks) > _KEPT_CHUNKS or (
            len(self._chunks) > 1 and sum(map(len, self._chunks.values())) > _KEPT_BYTES
        ):
            self._chunks.popitem(last=False)
        return records

    def _read(self, at: int, length: int) -> memoryview:
        if self._file is None:
            self._file = self._path.open("rb")
            if self._file.seek(0, 2) != self._size_bytes:
                raise self._changed()
        self._file.seek(at)
        return memoryview(self._file.read(length))

    def _changed(self) -> RecordingError:
        return RecordingError(
            "the file is not the one that was opened: its length or content changed",
            where=self._path,
            fix="wait until nothing writes to it, then start again",
        )

    def close(self) -> None:
        """Let go of the file and of the kept chunks; the next fetch opens it again."""
        if self._file is not None:
            self._file.close()
        self._file = None
        self._chunks.clear()

    def __del__(self) -> None:
        self.close()
