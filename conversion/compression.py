"""Compressed chunks, messages and files: decompressed within bounds, whole or cut."""

from __future__ import annotations

import bz2
import shutil
import tempfile
from pathlib import Path
from typing import Final

import lz4.frame
import zstandard

from civil_rgbd.errors import RecordingError
from civil_rgbd.storage.places import Place

LARGEST_CHUNK_BYTES: Final = 1 << 32
"""Writers make chunks of 1 to 100 MB; a larger claim is a damaged byte."""

FILE_SUFFIXES: Final = (".zstd", ".zst")
"""What ``ros2 bag record --compression-mode file`` and the zstd tool append."""

_ZSTD_MAGIC: Final = b"\x28\xb5\x2f\xfd"
_LZ4_RATIO: Final = 256  # LZ4 cannot do better than 255: a greater claim is a damaged byte
_FILE_RATIO: Final = 2000  # of a recording; what unpacks further is a bomb
_SLACK_BYTES: Final = 1 << 20
_BZ2_STEP_BYTES: Final = 1 << 16
_COPY_BYTES: Final = 1 << 20


class ChunkError(ValueError):
    """A chunk cannot be read."""


class UnknownCompressionError(ChunkError):
    """A chunk is compressed in a way that is not known."""


def zstd_records(stored: memoryview, size: int, *, cut: bool) -> memoryview:
    """Decompress zstd; of a cut stream as much as can be had.

    Args:
        stored: the compressed bytes.
        size: how many bytes are claimed to come out.
        cut: the end is missing.

    Raises:
        ChunkError: it cannot be decompressed.
    """
    try:
        if cut:
            return memoryview(zstandard.ZstdDecompressor().decompressobj().decompress(stored))
        # A reader rather than `decompress`: some writers use several frames, or leave out sizes.
        with zstandard.ZstdDecompressor().stream_reader(stored, read_across_frames=True) as reader:
            return memoryview(reader.read(size))
    except (zstandard.ZstdError, MemoryError) as error:
        raise ChunkError(f"it cannot be decompressed: {error}") from error


def lz4_records(stored: memoryview, size: int, *, cut: bool) -> memoryview:
    """Decompress an LZ4 frame; of a cut one as much as can be had. As :func:`zstd_records`."""
    if not cut and size > _LZ4_RATIO * len(stored) + _SLACK_BYTES:
        raise ChunkError(f"it claims {size} bytes once decompressed, of {len(stored)}")
    try:
        if cut:
            return memoryview(lz4.frame.LZ4FrameDecompressor().decompress(stored))
        return memoryview(lz4.frame.decompress(stored))
    except (RuntimeError, MemoryError, EOFError, ValueError) as error:
        raise ChunkError(f"it cannot be decompressed: {error}") from error


def bz2_records(stored: memoryview, size: int, *, cut: bool) -> memoryview:
    """Decompress bzip2; of a cut stream as much as can be had. As :func:`zstd_records`."""
    if cut:
        return _bz2_as_far_as_it_goes(stored)
    found = bytearray()
    left: bytes | memoryview = stored
    try:
        while len(left):  # several streams one behind another are one file to bzip2
            stream = bz2.BZ2Decompressor()
            found += stream.decompress(left, max_length=size + 1 - len(found))
            if not stream.eof:
                break
            left = stream.unused_data
    except (OSError, ValueError, EOFError, MemoryError) as error:
        raise ChunkError(f"it cannot be decompressed: {error}") from error
    return memoryview(found)


def _bz2_as_far_as_it_goes(stored: memoryview) -> memoryview:
    found, stream = bytearray(), bz2.BZ2Decompressor()
    for at in range(0, len(stored), _BZ2_STEP_BYTES):
        try:
            found += stream.decompress(stored[at : at + _BZ2_STEP_BYTES])
        except (OSError, EOFError, MemoryError):
            break
    return memoryview(found)


def plain_records(stored: memoryview, size: int, *, cut: bool) -> memoryview:
    """Return what is not compressed."""
    del size, cut
    return stored


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
    limit = LARGEST_CHUNK_BYTES if limit < 0 else limit
    try:
        size = zstandard.frame_content_size(payload)
        with zstandard.ZstdDecompressor().stream_reader(payload) as reader:
            return memoryview(reader.read(min(limit, size) if size >= 0 else limit))
    except (zstandard.ZstdError, MemoryError) as error:
        raise ChunkError(f"a message cannot be decompressed: {error}") from error


def is_packed(path: Place) -> bool:
    """Tell whether a whole file is compressed, by its name.

    >>> is_packed(Path("scan_0.db3.zstd"))
    True
    """
    return path.suffix.lower() in FILE_SUFFIXES


def unpack_file(path: Path) -> Path:
    """Decompress a whole file into a temporary folder of its own.

    Returns:
        the unpacked file; its folder is the caller's to remove.

    Raises:
        RecordingError: it is damaged, or unpacks beyond all reason.
        OSError: it cannot be read, or the disk is full.
    """
    folder = Path(tempfile.mkdtemp(prefix="civil_rgbd_"))
    unpacked = folder / path.stem
    try:
        _unpack(path, unpacked, limit_bytes=_FILE_RATIO * path.stat().st_size + _SLACK_BYTES)
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise
    return unpacked


def _unpack(path: Path, unpacked: Path, *, limit_bytes: int) -> None:
    written = 0
    try:
        with (
            path.open("rb") as file,
            unpacked.open("wb") as out,
            zstandard.ZstdDecompressor().stream_reader(file, read_across_frames=True) as reader,
        ):
            while block := reader.read(_COPY_BYTES):
                written += len(block)
                if written > limit_bytes:
                    raise RecordingError(
                        f"the file unpacks to more than {limit_bytes} bytes",
                        where=path,
                        fix="see where it comes from: no recording compresses so well",
                    )
                out.write(block)
    except zstandard.ZstdError as error:
        raise RecordingError(
            f"the compressed file is damaged: {error}; {written} bytes could be unpacked",
            where=path,
            fix="copy it again; or unpack what can be had (`zstd -d`) and read that with --salvage",
        ) from error
