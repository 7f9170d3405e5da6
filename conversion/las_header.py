"""The header of LAS and LAZ files, checked before a library trusts it.

lazrs ends the whole process where a compressed file claims more chunks than memory holds, so that
what it allocates by is compared with the file first. Layouts: LAS 1.2 and 1.4 (ASPRS); LASzip's
record and chunk table (laszip.hpp, "laszip encoded", record 22204).
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Final

from civil_rgbd.conversion.point_table import LayoutError

_SIGNATURE: Final = b"LASF"
_HEADER: Final = struct.Struct("<HIIBHI")  # header, data, records before it, format, point, count
_HEADER_AT: Final = 94
_COUNT_14_AT: Final = 247
_HEADER_14_BYTES: Final = 375
_RECORD: Final = struct.Struct("<2x16sHH32x")  # user, number, length
_LASZIP: Final = (b"laszip encoded", 22204)
_LASZIP_ITEMS_AT: Final = 32
_COMPRESSED: Final = 0x80


@dataclass(frozen=True, slots=True)
class LasHeader:
    """What a header says of its points.

    Attributes:
        count: how many there are.
        point_bytes: of one of them, uncompressed.
        size_bytes: of the file.
    """

    count: int
    point_bytes: int
    size_bytes: int


def checked_las_header(path: Path) -> LasHeader:
    """Read the header and compare it with the file.

    Raises:
        LayoutError: it is no LAS file, or claims what the file cannot hold.
        OSError: it cannot be read.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        start = file.read(_HEADER_14_BYTES)
        if not start.startswith(_SIGNATURE) or len(start) < _HEADER_AT + _HEADER.size:
            raise LayoutError("it does not begin with 'LASF', or ends in its header: no LAS file")
        header, data_at, records, kind, point_bytes, count = _HEADER.unpack_from(start, _HEADER_AT)
        if start[24:26] >= b"\x01\x04" and header >= _HEADER_14_BYTES <= len(start):
            (count,) = struct.unpack_from("<Q", start, _COUNT_14_AT)
        if data_at > size or header > data_at or records * _RECORD.size > data_at - header:
            raise LayoutError(
                f"its header of {header} bytes with {records} records before the data at byte "
                f"{data_at} does not fit the file of {size} bytes"
            )
        if not point_bytes:
            raise LayoutError("its points have no bytes")
        if kind & _COMPRESSED:
            file.seek(header)
            _check_laszip(file.read(data_at - header), records, point_bytes)
            _check_chunks(file, data_at=data_at, size=size, point_bytes=point_bytes, count=count)
        elif count * point_bytes > size - data_at:
            raise LayoutError(
                f"{count} points of {point_bytes} bytes need {count * point_bytes} bytes, "
                f"{size - data_at} follow"
            )
    return LasHeader(int(count), point_bytes, size)


def _check_laszip(data: bytes, records: int, point_bytes: int) -> None:
    """Compare the items of a point with its length."""
    at = 0
    for _ in range(records):
        if at + _RECORD.size > len(data):
            break
        user, number, length = _RECORD.unpack_from(data, at)
        body = data[at + _RECORD.size : at + _RECORD.size + length]
        at += _RECORD.size + length
        if (user.rstrip(b"\0"), number) != _LASZIP:
            continue
        if len(body) < _LASZIP_ITEMS_AT + 2:
            break
        (items,) = struct.unpack_from("<H", body, _LASZIP_ITEMS_AT)
        rows = body[_LASZIP_ITEMS_AT + 2 :]
        if 6 * items > len(rows):
            break
        sizes = [struct.unpack_from("<H", rows, 6 * item + 2)[0] for item in range(items)]
        if sum(sizes) != point_bytes:
            raise LayoutError(f"its points have {point_bytes} bytes, compressed {sum(sizes)}")
        return
    raise LayoutError("it is compressed, but does not say how: its record of LASzip is broken")


def _check_chunks(file: BinaryIO, *, data_at: int, size: int, point_bytes: int, count: int) -> None:
    """Compare the chunk table's length with the file: each chunk begins with a whole point."""
    if not count:
        return
    table_at = _int64(file, data_at)
    if table_at == -1:  # written by a stream: the last bytes of the file hold it
        table_at = _int64(file, size - 8)
    if not data_at + 8 <= table_at <= size - 8:
        raise LayoutError(f"its chunk table should lie at byte {table_at} of {size}")
    file.seek(table_at + 4)
    (chunks,) = struct.unpack("<I", file.read(4))
    if chunks * point_bytes > table_at - data_at:
        raise LayoutError(f"{chunks} chunks do not fit {table_at - data_at} compressed bytes")


def _int64(file: BinaryIO, at: int) -> int:
    file.seek(at)
    data = file.read(8)
    if len(data) < 8:
        raise LayoutError("it ends before its chunk table")
    value: int = struct.unpack("<q", data)[0]
    return value
