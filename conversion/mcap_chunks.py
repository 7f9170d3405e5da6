"""Chunks of an MCAP file: what their bytes hold, whole or cut."""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from typing import Final

import lz4.frame
import zstandard

CHUNK_HEAD: Final = struct.Struct("<QQQII")
"""start time, end time, uncompressed size, uncompressed crc, length of the compression's name."""

_LARGEST_CHUNK_BYTES: Final = 1 << 32  # writers make 1 to 100 MB; a larger claim is a damaged byte
_ZSTD_MAGIC: Final = b"\x28\xb5\x2f\xfd"
_LONGEST_NAME: Final = 32  # "zstd" and "lz4" are the names the specification knows


class ChunkError(ValueError):
    """A chunk cannot be read."""


class UnknownCompressionError(ChunkError):
    """A chunk is compressed in a way that is not known."""


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
    if size > _LARGEST_CHUNK_BYTES:
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
    try:
        records = _DECOMPRESSORS[chunk.compression](chunk)
    except (zstandard.ZstdError, RuntimeError, MemoryError, EOFError, ValueError) as error:
        raise ChunkError(f"it cannot be decompressed: {error}") from error
    if chunk.cut:
        return records
    if len(records) != chunk.uncompressed_size:
        raise ChunkError(f"it holds {len(records)} bytes, not {chunk.uncompressed_size}")
    if chunk.crc and zlib.crc32(records) != chunk.crc:
        raise ChunkError("its checksum does not hold")
    return records


def message_of(payload: memoryview, limit: int = -1) -> memoryview:
    """Return a message as its publisher wrote it.

    ``ros2 bag record --compression-mode message`` compresses every message by itself and tells
    only its metadata.yaml; no CDR payload starts like a zstd frame, so the bytes tell too.

    Args:
        payload: as recorded.
        limit: bytes wanted of a compressed one; -1 = all.

    Raises:
        ChunkError: it is compressed and damaged.
    """
    if bytes(payload[:4]) != _ZSTD_MAGIC:
        return payload
    limit = _LARGEST_CHUNK_BYTES if limit < 0 else limit
    try:
        size = zstandard.frame_content_size(payload)
        with zstandard.ZstdDecompressor().stream_reader(payload) as reader:
            return memoryview(reader.read(min(limit, size) if size >= 0 else limit))
    except (zstandard.ZstdError, MemoryError) as error:
        raise ChunkError(f"a message cannot be decompressed: {error}") from error


def _plain(chunk: ChunkRecord) -> memoryview:
    return chunk.stored


def _zstd(chunk: ChunkRecord) -> memoryview:
    if chunk.cut:
        return memoryview(zstandard.ZstdDecompressor().decompressobj().decompress(chunk.stored))
    # A reader rather than `decompress`: some writers use several frames, or leave out their size.
    with zstandard.ZstdDecompressor().stream_reader(
        chunk.stored, read_across_frames=True
    ) as reader:
        return memoryview(reader.read(chunk.uncompressed_size))


def _lz4(chunk: ChunkRecord) -> memoryview:
    if chunk.cut:
        return memoryview(lz4.frame.LZ4FrameDecompressor().decompress(chunk.stored))
    return memoryview(lz4.frame.decompress(chunk.stored))


_DECOMPRESSORS: Final = {"zstd": _zstd, "lz4": _lz4, "": _plain}
