"""PCD, PLY and LAS files as other programs write them, with every knob that differs."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Columns = Mapping[str, NDArray[np.generic]]
_KINDS = {"i": "I", "u": "U", "f": "F"}
_PLY = {
    "i1": "char",
    "u1": "uchar",
    "i2": "short",
    "u2": "ushort",
    "i4": "int",
    "u4": "uint",
    "f4": "float",
    "f8": "double",
}


def packed(columns: Columns, order: str = "<") -> NDArray[np.void]:
    """One row a point, no padding."""
    dtype = np.dtype([(name, order + c.dtype.str[1:]) for name, c in columns.items()])
    rows = np.empty(len(next(iter(columns.values()))), dtype=dtype)
    for name, column in columns.items():
        rows[name] = column
    return rows


def text_rows(columns: Columns) -> bytes:
    lines = zip(*(column.tolist() for column in columns.values()), strict=True)
    return "".join(" ".join(map(repr, row)) + "\n" for row in lines).encode()


def compressed(data: bytes) -> bytes:
    """LZF with literals and one kind of copy: runs of one byte, long and short, that overlap."""
    out, at = bytearray(), 0
    while at < len(data):
        run = 1
        while at + run < len(data) and data[at + run] == data[at] and run < 265:
            run += 1
        if run > 3:
            out += bytes([0, data[at]])
            length = run - 1 - 2
            out += (
                bytes([min(length, 7) << 5]) + (bytes([length - 7]) if length >= 7 else b"") + b"\0"
            )
            at += run
        else:
            piece = data[at : at + min(run, 32)]
            out += bytes([len(piece) - 1]) + piece
            at += len(piece)
    return bytes(out)


def pcd_bytes(columns: Columns, encoding: str = "binary", **header: str) -> bytes:
    count = len(next(iter(columns.values())))
    types = [column.dtype for column in columns.values()]
    lines = {
        "VERSION": "0.7",
        "FIELDS": " ".join(columns),
        "SIZE": " ".join(str(dtype.itemsize) for dtype in types),
        "TYPE": " ".join(_KINDS[dtype.kind] for dtype in types),
        "COUNT": " ".join("1" for _ in types),
        "WIDTH": str(count),
        "HEIGHT": "1",
        "VIEWPOINT": "0 0 0 1 0 0 0",
        "POINTS": str(count),
        "DATA": encoding,
    } | header
    text = "# .PCD v0.7 - Point Cloud Data file format\n"
    text += "".join(f"{name} {value}\n" for name, value in lines.items() if value)
    return text.encode() + pcd_body(columns, encoding)


def pcd_body(columns: Columns, encoding: str) -> bytes:
    if encoding == "ascii":
        return text_rows(columns)
    if encoding == "binary":
        return packed(columns).tobytes()
    plain = b"".join(np.ascontiguousarray(column).tobytes() for column in columns.values())
    data = compressed(plain)
    return struct.pack("<II", len(data), len(plain)) + data


def ply_bytes(columns: Columns, encoding: str = "binary_little_endian") -> bytes:
    count = len(next(iter(columns.values())))
    text = f"ply\nformat {encoding} 1.0\ncomment by a test\nelement vertex {count}\n"
    for name, column in columns.items():
        text += f"property {_PLY[column.dtype.str[1:]]} {name}\n"
    text += "end_header\n"
    if encoding == "ascii":
        return text.encode() + text_rows(columns)
    return text.encode() + packed(columns, ">" if "big" in encoding else "<").tobytes()


def write_las(
    path: Path,
    xyz: NDArray[np.floating],
    gps_time: NDArray[np.float64] | None = None,
    *,
    scale: float = 1e-4,
) -> Path:
    import laspy

    header = laspy.LasHeader(point_format=1, version="1.2")
    header.scales, header.offsets = np.full(3, scale), np.floor(xyz.min(axis=0))
    cloud = laspy.LasData(header)
    cloud.x, cloud.y, cloud.z = xyz.astype(np.float64).T
    if gps_time is not None:
        cloud.gps_time = gps_time
    cloud.write(str(path))
    return path
