"""PLY files in every encoding, with lists before, inside and behind the vertices."""

from __future__ import annotations

import struct
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from civil_rgbd.conversion.ply import read_ply
from civil_rgbd.conversion.point_table import LayoutError

from .cloud_writers import ply_bytes

ENCODINGS = ["ascii", "binary_little_endian", "binary_big_endian"]


def columns(count: int = 40) -> dict[str, NDArray[np.generic]]:
    rng = np.random.default_rng(4)
    return {
        "red": rng.integers(0, 255, count).astype(np.uint8),
        "y": rng.normal(size=count) * 1e6,
        "x": rng.normal(size=count).astype(np.float32),
        "t": rng.integers(0, 2**32 - 1, count).astype(np.uint32),
        "z": rng.normal(size=count).astype(np.float32),
        "i": rng.integers(-(2**15), 2**15, count).astype(np.int16),
    }


def written(tmp_path: Path, data: bytes) -> Path:
    path = tmp_path / "a.ply"
    path.write_bytes(data)
    return path


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_every_property_comes_back_bit_for_bit(tmp_path: Path, encoding: str) -> None:
    table = read_ply(written(tmp_path, ply_bytes(columns(), encoding)))
    assert table.types == {name: values.dtype.str[1:] for name, values in columns().items()}
    for name, values in columns().items():
        np.testing.assert_array_equal(table.columns[name], values)


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_lists_are_stepped_over_wherever_they_are(tmp_path: Path, encoding: str) -> None:
    head = f"""ply
format {encoding} 1.0
obj_info by a test
element camera 2
property float focal
property list uchar short marks
element vertex 3
property float x
property double y
property float z
property list ushort int seen_by
property uint8 tag
element face 1
property list uchar int vertex_indices
end_header
"""
    order = ">" if "big" in encoding else "<"
    cameras = [(1.5, [1, 2, 3]), (2.5, [])]
    points = [(1.0, 10.0, 100.0, [7, 8], 3), (2.0, 20.0, 200.0, [], 4), (3.0, 30.0, 300.0, [9], 5)]
    if encoding == "ascii":
        body = "".join(f"{f} {len(m)} {' '.join(map(str, m))}\n" for f, m in cameras)
        body += "".join(
            f"{x} {y} {z} {len(s)} {' '.join(map(str, s))} {tag}\n" for x, y, z, s, tag in points
        )
        data = head.encode() + body.encode() + b"3 0 1 2\n"
    else:
        body_bytes = b"".join(
            struct.pack(f"{order}fB{len(m)}h", f, len(m), *m) for f, m in cameras
        ) + b"".join(
            struct.pack(f"{order}fdfH{len(s)}iB", x, y, z, len(s), *s, tag)
            for x, y, z, s, tag in points
        )
        data = head.encode() + body_bytes + struct.pack(f"{order}B3i", 3, 0, 1, 2)
    table = read_ply(written(tmp_path, data))
    assert table.columns["x"].tolist() == [1, 2, 3]
    assert table.columns["y"].tolist() == [10, 20, 30]
    assert table.columns["z"].tolist() == [100, 200, 300]
    if encoding != "ascii":
        assert table.columns["tag"].tolist() == [3, 4, 5]


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("count", [41, 4_000_000_000, 999_999_999_999])
def test_a_count_that_lies_is_refused_and_allocates_nothing(
    tmp_path: Path, encoding: str, count: int
) -> None:
    data = ply_bytes(columns(), encoding).replace(b"vertex 40", f"vertex {count}".encode())
    path = written(tmp_path, data)
    tracemalloc.start()
    with pytest.raises(LayoutError, match=r"are claimed|do not fit|need at least"):
        read_ply(path)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 300_000


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (b"ply\n", b"pyl\n", "no PLY file"),
        (b"end_header", b"end_heade_", "no PLY file"),
        (b"format binary", b"format hex", "its format is"),
        (b"vertex", b"vortex", "no element 'vertex', only 'vortex'"),
        (b"property float x", b"property string x", "property 'string x'"),
        (b"property float x", b"property list float int x", "property 'list float int x'"),
        (b"property float x", b"colour float x", "a line 'colour float x'"),
        (b"element vertex 40", b"element vertex -4", "a line 'element vertex -4'"),
    ],
)
def test_a_header_that_breaks_the_format_is_refused(
    tmp_path: Path, old: bytes, new: bytes, words: str
) -> None:
    with pytest.raises(LayoutError, match=words):
        read_ply(written(tmp_path, ply_bytes(columns()).replace(old, new, 1)))


def test_a_list_that_reaches_over_the_end_is_refused(tmp_path: Path) -> None:
    head = (
        "ply\nformat binary_little_endian 1.0\nelement vertex 2\nproperty float x\n"
        "property list uint double l\nend_header\n"
    )
    body = struct.pack("<fI", 1.0, 0) + struct.pack("<fI", 2.0, 4_000_000_000)
    with pytest.raises(LayoutError, match="row 1 of 'vertex' reaches over"):
        read_ply(written(tmp_path, head.encode() + body))
