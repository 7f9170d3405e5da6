"""PCD files (Point Cloud Library, version 0.6 and 0.7): ascii, binary and binary_compressed."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.conversion.lzf import decompress_lzf
from civil_rgbd.conversion.point_table import LayoutError, PointTable, read_ascii_columns

_CODES: Final = {
    (kind, size): f"{code}{size}"
    for kind, code, sizes in (
        ("I", "i", (1, 2, 4, 8)),
        ("U", "u", (1, 2, 4, 8)),
        ("F", "f", (4, 8)),
    )
    for size in sizes
}
_DATA_LINE: Final = re.compile(rb"^DATA[ \t]+(\w+)[ \t]*\r?(?:\n|\Z)", re.MULTILINE)
_HEADER_BYTES: Final = 1 << 16
_NO_MOVE: Final = ("0", "0", "0", "1", "0", "0", "0")
_PADDING: Final = "_"


@dataclass(frozen=True, slots=True)
class _Field:
    name: str
    code: str
    count: int
    offset: int

    @property
    def size(self) -> int:
        """Bytes a point."""
        return np.dtype(self.code).itemsize * self.count


@dataclass(frozen=True, slots=True)
class _Header:
    fields: tuple[_Field, ...]
    points: int
    encoding: str
    data_at: int
    viewpoint: tuple[str, ...]

    @property
    def step(self) -> int:
        """Bytes from point to point."""
        return sum(field.size for field in self.fields)


def read_pcd(path: Path) -> PointTable:
    """Read the points of a PCD file; fields of more than one value a point are left out.

    Raises:
        LayoutError: it breaks the format.
        OSError: it cannot be read.
    """
    data = np.fromfile(path, dtype=np.uint8)
    header = _header(data[:_HEADER_BYTES].tobytes())
    body = data[header.data_at :]
    remarks: tuple[str, ...] = ()
    if tuple(f"{float(value):g}" for value in header.viewpoint) != _NO_MOVE:
        pose = " ".join(header.viewpoint)
        remarks = (f"the PCD files have a VIEWPOINT ({pose}); their points are taken as stored",)
    columns = _READERS[header.encoding](header, body)
    return PointTable(header.points, columns, remarks)


def _header(start: bytes) -> _Header:
    found = _DATA_LINE.search(start)
    if found is None:
        raise LayoutError("it is no PCD file: its first 64 KiB have no DATA line")
    lines: dict[str, tuple[str, ...]] = {}
    for line in start[: found.start()].decode("latin-1").splitlines():
        words = line.split()
        if words and not words[0].startswith("#"):
            lines.setdefault(words[0].upper(), tuple(words[1:]))
    encoding = found.group(1).decode("latin-1").lower()
    if encoding not in _READERS:
        raise LayoutError(f"DATA is {encoding!r}, none of {', '.join(_READERS)}")
    fields = _fields(lines)
    width, height = (_whole(lines, name) for name in ("WIDTH", "HEIGHT"))
    points = _whole(lines, "POINTS")
    if points is None:
        if width is None or height is None:
            raise LayoutError("its header has neither POINTS nor WIDTH and HEIGHT")
        points = width * height
    elif width is not None and height is not None and width * height != points:
        raise LayoutError(f"POINTS is {points}, WIDTH x HEIGHT is {width} x {height}")
    viewpoint = lines.get("VIEWPOINT", _NO_MOVE)
    try:
        list(map(float, viewpoint))
    except ValueError as error:
        raise LayoutError(f"VIEWPOINT is no pose: {error}") from error
    return _Header(fields, points, encoding, found.end(), viewpoint)


def _whole(lines: dict[str, tuple[str, ...]], name: str) -> int | None:
    if name not in lines:
        return None
    words = lines[name]
    if len(words) != 1 or not words[0].isdecimal() or len(words[0]) > 12:
        raise LayoutError(f"{name} is {' '.join(words)!r}, not a count")
    return int(words[0])


def _fields(lines: dict[str, tuple[str, ...]]) -> tuple[_Field, ...]:
    names = lines.get("FIELDS", lines.get("COLUMNS", ()))
    sizes, kinds = lines.get("SIZE", ()), lines.get("TYPE", ())
    counts = lines.get("COUNT", ("1",) * len(names))
    if not names or not len(names) == len(sizes) == len(kinds) == len(counts):
        raise LayoutError(
            f"FIELDS, SIZE, TYPE and COUNT have {len(names)}, {len(sizes)}, {len(kinds)} and "
            f"{len(counts)} entries"
        )
    fields, offset = [], 0
    for name, size, kind, count in zip(names, sizes, kinds, counts, strict=True):
        short = size.isdecimal() and count.isdecimal() and max(len(size), len(count)) <= 6
        code = _CODES.get((kind.upper(), int(size))) if short else None
        if code is None:
            raise LayoutError(f"field {name!r} has TYPE {kind}, SIZE {size} and COUNT {count}")
        fields.append(_Field(name, code, int(count), offset))
        offset += fields[-1].size
    return tuple(fields)


def _named(header: _Header) -> list[_Field]:
    """Fields of one value a point; of equal names the first."""
    first: dict[str, _Field] = {}
    for field in header.fields:
        if field.name != _PADDING and field.count == 1:
            first.setdefault(field.name, field)
    return list(first.values())


def _read_ascii(header: _Header, body: NDArray[np.uint8]) -> dict[str, NDArray[np.generic]]:
    codes = [field.code for field in header.fields for _ in range(field.count)]
    if len(codes) > len(body) and header.points:
        raise LayoutError(f"{len(codes)} values a point do not fit {len(body)} bytes")
    text = body.tobytes()
    if text.strip().count(b"\n") >= header.points:
        lines = sum(1 for line in text.split(b"\n") if line.strip())
        if lines > header.points:
            raise LayoutError(f"{header.points} points are claimed, {lines} lines follow")
    columns = read_ascii_columns(text, codes, header.points)
    column_of, at = {}, 0
    for field in header.fields:
        column_of[field.offset, field.name] = at
        at += field.count
    return {field.name: columns[column_of[field.offset, field.name]] for field in _named(header)}


def _read_binary(header: _Header, body: NDArray[np.uint8]) -> dict[str, NDArray[np.generic]]:
    needed = header.points * header.step
    if len(body) < needed:
        raise LayoutError(
            f"{header.points} points of {header.step} bytes need {needed} bytes, {len(body)} follow"
        )
    if header.step and len(body) - needed >= header.step:
        raise LayoutError(
            f"{header.points} points are claimed, {len(body) - needed} bytes follow them"
        )
    return {
        field.name: np.ndarray(
            (header.points,), "<" + field.code, body, field.offset, (header.step,)
        )
        for field in _named(header)
        if header.points
    }


def _read_compressed(header: _Header, body: NDArray[np.uint8]) -> dict[str, NDArray[np.generic]]:
    """Decompress; the fields then lie one after the other, each for all points."""
    if len(body) < 8:
        if header.points:
            raise LayoutError("it ends before the sizes of its compressed data")
        return {}
    packed, size = body[:8].view("<u4").tolist()
    if size != header.points * header.step:
        raise LayoutError(
            f"{header.points} points of {header.step} bytes are claimed, its compressed data holds "
            f"{size} bytes"
        )
    if packed > len(body) - 8:
        raise LayoutError(f"{packed} compressed bytes are claimed, {len(body) - 8} follow")
    data = decompress_lzf(body[8 : 8 + packed], size)
    return {
        field.name: np.ndarray(
            (header.points,), "<" + field.code, data, field.offset * header.points
        )
        for field in _named(header)
        if header.points
    }


_READERS: Final = {
    "ascii": _read_ascii,
    "binary": _read_binary,
    "binary_compressed": _read_compressed,
}
