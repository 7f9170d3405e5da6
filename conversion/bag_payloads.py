"""Single messages of a ROS 1 bag, fetched by their place."""

from __future__ import annotations

from civil_rgbd.conversion.bag_records import (
    CHUNK,
    CHUNK_HEAD_BYTES,
    LENGTH,
    BagError,
    Head,
    fields_of,
    is_unclosed,
    records_of,
)
from civil_rgbd.conversion.compression import ChunkError
from civil_rgbd.conversion.file_payloads import ChunkedPayloads


class BagPayloads(ChunkedPayloads):
    """Random access to the messages of one bag."""

    def records_at(self, start: int) -> memoryview:
        """Return the decompressed records of the chunk record at ``start``.

        Raises:
            ChunkError: there is no such chunk, or it cannot be read.
        """
        begins = self.read(start, 2 * CHUNK_HEAD_BYTES)
        try:
            (header_bytes,) = LENGTH.unpack_from(begins)
            at = LENGTH.size + header_bytes
            fields = fields_of(begins[LENGTH.size : at])
            (length,) = LENGTH.unpack_from(begins, at)
        except (ValueError, LookupError, ArithmeticError, BagError) as error:
            raise ChunkError(f"there is no chunk at byte {start}") from error
        head = Head(CHUNK, fields, start + at + LENGTH.size, length)
        return records_of(head, self.read(head.data, -1 if is_unclosed(head) else head.length))
