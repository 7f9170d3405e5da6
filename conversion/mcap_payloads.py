"""Single messages of an MCAP file, fetched by their place."""

from __future__ import annotations

from civil_rgbd.conversion.compression import ChunkError, message_of
from civil_rgbd.conversion.file_payloads import ChunkedPayloads
from civil_rgbd.conversion.mcap_chunks import parse_chunk, records_of
from civil_rgbd.conversion.mcap_container import RECORD


class McapPayloads(ChunkedPayloads):
    """Random access to the messages of one MCAP file."""

    def records_at(self, start: int) -> memoryview:
        """Return the decompressed records of the chunk record at ``start``.

        Raises:
            ChunkError: there is no such chunk, or it cannot be read.
        """
        head = self.read(start, RECORD.size)
        if len(head) < RECORD.size:
            raise ChunkError(f"the file ends before byte {start}")
        _, length = RECORD.unpack(head)
        body = self.read(start + RECORD.size, length)
        return records_of(parse_chunk(body, cut=len(body) < length))

    def message(self, stored: memoryview) -> memoryview:
        """Return a message as its publisher wrote it.

        Raises:
            ChunkError: it is compressed and damaged.
        """
        return message_of(stored)
