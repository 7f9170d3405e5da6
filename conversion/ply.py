"""PLY files: ascii, binary_little_endian and binary_big_endian; lists are stepped over."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numba
import numpy as np
from numpy.typing import NDArray

from civil_rgbd.conversion.point_table import LayoutError, PointTable, read_ascii_columns

_CODES: Final = {
    name: code
    for code, names in {
        "i1": ("char", "int8"),
        "u1": ("uchar", "uint8"),
        "i2": ("short", "int16"),
        "u2": ("ushort", "uint16"),
        "i4": ("int", "int32"),
        "u4": ("uint", "uint32"),
        "f4": ("float", "float32"),
        "f8": ("double", "float64"),
    }.items()
    for name in names
}
_ORDERS: Final = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_END: Final = b"end_header"
_HEADER_BYTES: Final = 1 << 20


@dataclass(frozen=True, slots=True)
class _Property:
    name: str
    code: str
    length_code: str = ""  # of a list: the type of its length

    @property
    def size(self) -> int:
        return np.dtype(self.code).itemsize

    @property
    def least_bytes(self) -> int:
        return np.dtype(self.length_code).itemsize if self.length_code else self.size


@dataclass(frozen=True, slots=True)
class _Element:
    name: str
    count: int
    properties: list[_Property]

    @property
    def has_lists(self) -> bool:
        return any(prop.length_code for prop in self.properties)

    @property
    def least_bytes(self) -> int:
        return sum(prop.least_bytes for prop in self.properties)


def read_ply(path: Path) -> PointTable:
    """Read the element ``vertex`` of a PLY file.

    Raises:
        LayoutError: it breaks the format, or has no vertices.
        OSError: it cannot be read.
    """
    data = np.fromfile(path, dtype=np.uint8)
    encoding, elements, data_at = _header(data[:_HEADER_BYTES].tobytes())
    names = [element.name for element in elements]
    if "vertex" not in names:
        raise LayoutError(f"it has no element 'vertex', only {', '.join(map(repr, names))}")
    before = elements[: names.index("vertex")]
    vertex = elements[names.index("vertex")]
    body = data[data_at:]
    if encoding == "ascii":
        return PointTable(vertex.count, _read_ascii(before, vertex, body.tobytes()))
    return PointTable(vertex.count, _read_binary(before, vertex, body, _ORDERS[encoding]))


def _header(start: bytes) -> tuple[str, list[_Element], int]:
    end = start.find(b"\n" + _END)
    if not start.startswith(b"ply") or end < 0:
        raise LayoutError("it is no PLY file: it does not begin with 'ply', or has no end_header")
    line_end = start.find(b"\n", end + 1)
    if line_end < 0:
        line_end = len(start) - 1
    encoding, elements = "", []
    for line in start[:end].decode("latin-1").splitlines()[1:]:
        words = line.split()
        if not words or words[0] in ("comment", "obj_info"):
            continue
        if words[0] == "format" and len(words) == 3:
            encoding = words[1]
        elif words[0] == "element" and len(words) == 3 and _is_count(words[2]):
            elements.append(_Element(words[1], int(words[2]), []))
        elif words[0] == "property" and elements:
            elements[-1].properties.append(_property(words))
        else:
            raise LayoutError(f"its header has a line {line.strip()!r}")
    if encoding not in _ORDERS:
        raise LayoutError(f"its format is {encoding!r}, none of {', '.join(_ORDERS)}")
    return encoding, elements, line_end + 1


def _is_count(word: str) -> bool:
    return word.isdecimal() and len(word) <= 12


def _property(words: list[str]) -> _Property:
    if len(words) == 3 and words[1] in _CODES:
        return _Property(words[2], _CODES[words[1]])
    if len(words) == 5 and words[1] == "list" and {words[2], words[3]} <= _CODES.keys():
        length_code = _CODES[words[2]]
        if length_code[0] != "f":
            return _Property(words[4], _CODES[words[3]], length_code)
    raise LayoutError(f"its header has a property {' '.join(words[1:])!r}")


def _read_ascii(
    before: list[_Element], vertex: _Element, body: bytes
) -> dict[str, NDArray[np.generic]]:
    at = 0
    for _ in range(sum(element.count for element in before)):
        at = body.find(b"\n", at) + 1
        if not at:
            raise LayoutError("it ends before its vertices")
    scalars: list[_Property] = []
    for prop in vertex.properties:
        if prop.length_code:
            break  # behind a list the columns are nobody's; those before it can be told
        scalars.append(prop)
    columns = read_ascii_columns(body[at:], [prop.code for prop in scalars], vertex.count)
    first: dict[str, NDArray[np.generic]] = {}
    for prop, values in zip(scalars, columns, strict=True):
        first.setdefault(prop.name, values)
    return first


def _read_binary(
    before: list[_Element], vertex: _Element, body: NDArray[np.uint8], order: str
) -> dict[str, NDArray[np.generic]]:
    at = 0
    for element in before:
        at = _step_over(element, body, at, order)
    _check_room(vertex, len(body) - at)
    if vertex.has_lists:
        step = sum(prop.size for prop in vertex.properties if not prop.length_code)
        packed = np.empty((vertex.count, step), dtype=np.uint8)
        _walk(vertex, body, at, order, packed)
        body, at = packed.reshape(-1), 0
    step = sum(prop.size for prop in vertex.properties if not prop.length_code)
    columns: dict[str, NDArray[np.generic]] = {}
    offset = at
    for prop in vertex.properties:
        if prop.length_code:
            continue
        if vertex.count:
            values: NDArray[np.generic] = np.ndarray(
                (vertex.count,), order + prop.code, body, offset, (step,)
            )
            columns.setdefault(prop.name, values)
        offset += prop.size
    return columns


def _step_over(element: _Element, body: NDArray[np.uint8], at: int, order: str) -> int:
    _check_room(element, len(body) - at)
    if element.has_lists:
        return _walk(element, body, at, order, np.empty((element.count, 0), dtype=np.uint8))
    return at + element.count * element.least_bytes


def _check_room(element: _Element, left: int) -> None:
    needed = element.count * element.least_bytes
    if needed > left:
        raise LayoutError(
            f"{element.count} of {element.name!r} need at least {needed} bytes, {left} are left"
        )


def _walk(
    element: _Element, body: NDArray[np.uint8], at: int, order: str, packed: NDArray[np.uint8]
) -> int:
    """Step over rows with lists, packing what is no list; return where they end."""
    sizes = np.array([prop.size for prop in element.properties], dtype=np.int64)
    lengths = np.array(
        [np.dtype(p.length_code).itemsize if p.length_code else 0 for p in element.properties],
        dtype=np.int64,
    )
    end = int(_walk_rows(body, at, sizes, lengths, order == ">", packed))
    if end < 0:
        raise LayoutError(f"row {-end - 1} of {element.name!r} reaches over the file's end")
    return end


@numba.njit(cache=True)
def _walk_rows(body, at, sizes, lengths, big, packed):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202, PLR0917  # a kernel: numba infers
    """Walk the rows of (R, step) ``packed``; return the end, or -1 - row where one is broken."""
    for row in range(len(packed)):
        filled = 0
        for column in range(len(sizes)):
            size = sizes[column]
            width = lengths[column]
            if at + max(width, 0 if width else size) > len(body):
                return -1 - row
            if width == 0:
                if packed.shape[1]:
                    for k in range(size):
                        packed[row, filled + k] = body[at + k]
                    filled += size
                at += size
                continue
            length = np.int64(0)
            for k in range(width):
                byte = np.int64(body[at + (k if big else width - 1 - k)])
                length = (length << 8) | byte
            at += width + length * size
            if at > len(body):
                return -1 - row
    return at
