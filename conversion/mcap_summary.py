"""The summary at the end of an MCAP file: listed from, and asked where a walk fails."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import BinaryIO, Final

_RECORD: Final = struct.Struct("<BQ")
_FOOTER_BYTES: Final = 9 + 20 + 8  # record head, content, closing magic
_LARGEST_SUMMARY_BYTES: Final = 1 << 28
_SCHEMA, _CHANNEL, _CHUNK_INDEX, _STATISTICS = 0x03, 0x04, 0x08, 0x0B


@dataclass(frozen=True, slots=True)
class Summary:
    """What the end of a file says of its inside.

    Attributes:
        chunk_starts: byte at which each chunk record starts, ascending.
        schemas: content of the schema records.
        channels: content of the channel records.
        chunk_indexes: content of the chunk index records.
        statistics: content of the statistics record, where there is one.
    """

    chunk_starts: tuple[int, ...] = ()
    schemas: tuple[memoryview, ...] = ()
    channels: tuple[memoryview, ...] = ()
    chunk_indexes: tuple[memoryview, ...] = ()
    statistics: memoryview | None = None


def read_summary(file: BinaryIO, size_bytes: int) -> Summary:
    """Read what there is of a summary; an empty one when there is none or it is damaged.

    Args:
        file: an MCAP file, open for reading; its position moves.
        size_bytes: its length.
    """
    if size_bytes < _FOOTER_BYTES:
        return Summary()
    file.seek(size_bytes - _FOOTER_BYTES)
    footer = file.read(_FOOTER_BYTES)
    opcode, length, start = struct.unpack_from("<BQQ", footer)
    end = size_bytes - _FOOTER_BYTES
    if (opcode, length) != (0x02, 20) or not 0 < start <= end:
        return Summary()
    if end - start > _LARGEST_SUMMARY_BYTES:
        return Summary()
    file.seek(start)
    return _parse(memoryview(file.read(end - start)))


def _parse(section: memoryview) -> Summary:
    found: dict[int, list[memoryview]] = {
        opcode: [] for opcode in (_SCHEMA, _CHANNEL, _CHUNK_INDEX, _STATISTICS)
    }
    at = 0
    while at + _RECORD.size <= len(section):
        opcode, length = _RECORD.unpack_from(section, at)
        body = at + _RECORD.size
        at = body + length
        if opcode in found and at <= len(section) and length >= 4:
            found[opcode].append(section[body:at])
    starts = (
        struct.unpack_from("<Q", record, 16)[0]
        for record in found[_CHUNK_INDEX]
        if len(record) >= 24
    )
    return Summary(
        tuple(sorted(starts)),
        tuple(found[_SCHEMA]),
        tuple(found[_CHANNEL]),
        tuple(found[_CHUNK_INDEX]),
        found[_STATISTICS][0] if found[_STATISTICS] else None,
    )
