"""Chunks of an MCAP file: what their bytes hold, whole or cut."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from civil_rgbd.conversion.compression import (
    LARGEST_CHUNK_BYTES,
    ChunkError,
    UnknownCompressionError,
    lz4_records,
    plain_records,
    zstd_records,
)

CHUNK_HEAD: Final = struct.Struct("<QQQII")
"""start time, end time, uncompressed size, uncompressed crc, length of the compression's name."""

_LONGEST_NAME: Final = 32  # "zstd" and "lz4" are the names the specification knows


@dataclass(frozen=True, slots=True)
class ChunkRecord:
    """A chunk as it lies in the file.

    Attributes:
        uncompressed_size: bytes of the records inside.
        crc: of the uncompressed bytes; 0 = not given.
        compression: its name; empty for none.
        stored: the bytes as stored.
        cut: the file ends before the chunk does.
    """

    uncompressed_size: int
    crc: int
    compression: str
    stored: memoryview
    cut: bool


def parse_chunk(body: memoryview, *, cut: bool) -> ChunkRecord:
    """Take a chunk record apart.

    Args:
        body: the record's content, as much as there is.
        cut: the file ends before the record does.

    Raises:
        ChunkError: its lengths do not fit together.
    """
    if len(body) < CHUNK_HEAD.size:
        raise ChunkError(f"it has {len(body)} bytes, less than its head")
    _, _, size, crc, name_length = CHUNK_HEAD.unpack_from(body)
    at = CHUNK_HEAD.size + name_length
    if name_length > _LONGEST_NAME or at + 8 > len(body):
        raise ChunkError("it ends inside its head")
    name = bytes(body[CHUNK_HEAD.size : at]).decode("utf-8", errors="replace")
    (stored_length,) = struct.unpack_from("<Q", body, at)
    stored = body[at + 8 : at + 8 + stored_length]
    if not cut and len(stored) != stored_length:
        raise ChunkError(f"{stored_length} bytes are claimed, {len(stored)} are there")
    if size > LARGEST_CHUNK_BYTES:
        raise ChunkError(f"it claims {size} bytes once decompressed")
    return ChunkRecord(size, crc, name, stored, cut)


def records_of(chunk: ChunkRecord) -> memoryview:
    """Decompress a chunk and check it.

    Args:
        chunk: whole, or cut: of a cut one as much as can be had.

    Returns:
        the records inside, one after another.

    Raises:
        UnknownCompressionError: neither zstd nor lz4 nor none.
        ChunkError: it cannot be decompressed, or its length or checksum does not hold.
    """
    if chunk.compression not in _DECOMPRESSORS:
        known = ", ".join(repr(name) for name in _DECOMPRESSORS if name)
        raise UnknownCompressionError(f"compression {chunk.compression!r} is none of {known}")
    decompress = _DECOMPRESSORS[chunk.compression]
    records = decompress(chunk.stored, chunk.uncompressed_size, cut=chunk.cut)
    if chunk.cut:
        return records
    if len(records) != chunk.uncompressed_size:
        raise ChunkError(f"it holds {len(records)} bytes, not {chunk.uncompressed_size}")
    if chunk.crc and zlib.crc32(records) != chunk.crc:
        raise ChunkError("its checksum does not hold")
    return records


def strings_in(record: memoryview, at: int, count: int = 1) -> Iterator[str]:
    """Yield strings of a record, each behind its length, from a position on.

    Raises:
        ValueError: one reaches over the record's end.
        struct.error: the record ends before.
    """
    for _ in range(count):
        (length,) = struct.unpack_from("<I", record, at)
        if at + 4 + length > len(record):
            raise ValueError("a string reaches over the record's end")
        yield bytes(record[at + 4 : at + 4 + length]).decode("utf-8", errors="replace")
        at += 4 + length


_DECOMPRESSORS: Final = {"zstd": zstd_records, "lz4": lz4_records, "": plain_records}
