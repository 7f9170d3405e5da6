"""PCD files in every encoding, from every writer, whole and broken."""

from __future__ import annotations

import struct
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from civil_rgbd.conversion.lzf import decompress_lzf
from civil_rgbd.conversion.pcd import read_pcd
from civil_rgbd.conversion.point_table import LayoutError, scan_from_table
from civil_rgbd.conversion.point_time import PointTime

from .cloud_writers import compressed, pcd_bytes

ENCODINGS = ["ascii", "binary", "binary_compressed"]


def columns(count: int = 50) -> dict[str, NDArray[np.generic]]:
    rng = np.random.default_rng(2)
    xyz = rng.normal(size=(3, count)).astype(np.float32)
    xyz[0, 3:4] = np.nan
    return {
        "z": xyz[2],
        "ring": rng.integers(0, 64, count).astype(np.uint16),
        "x": xyz[0],
        "timestamp": 1_700_000_000 + np.arange(count) * 1e-6,
        "y": xyz[1],
        "ns": (1_700_000_000_000_000_001 + np.arange(count)).astype(np.uint64),
        "flags": rng.integers(-128, 127, count).astype(np.int8),
    }


def written(tmp_path: Path, data: bytes) -> Path:
    path = tmp_path / "a.pcd"
    path.write_bytes(data)
    return path


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_every_field_comes_back_bit_for_bit(tmp_path: Path, encoding: str) -> None:
    table = read_pcd(written(tmp_path, pcd_bytes(columns(), encoding)))
    assert table.count == 50
    assert table.types == {name: values.dtype.str[1:] for name, values in columns().items()}
    for name, values in columns().items():
        np.testing.assert_array_equal(table.columns[name], values)


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_an_empty_cloud_is_empty(tmp_path: Path, encoding: str) -> None:
    table = read_pcd(written(tmp_path, pcd_bytes(columns(0), encoding)))
    assert table.count == 0
    scan = scan_from_table(table, 5, PointTime("t", "ns", "header", unsigned=True), in_map=False)
    assert scan.points.shape == (0, 3)
    assert scan.point_stamps_ns is not None


def test_padding_and_fields_of_several_values_are_stepped_over(tmp_path: Path) -> None:
    """As PCL writes PointNormal types: unnamed padding between, a histogram behind."""
    dtype = np.dtype(
        [
            ("x", "<f4"),
            ("p", "<u1", 4),
            ("y", "<f4"),
            ("q", "<u1", 2),
            ("z", "<f4"),
            ("h", "<f4", 3),
        ]
    )
    rows = np.zeros(7, dtype=dtype)
    rows["x"], rows["y"], rows["z"], rows["p"] = np.arange(7), 2, 3, 9
    head = (
        "VERSION .7\nFIELDS x _ y _ z h\nSIZE 4 1 4 1 4 4\nTYPE F U F U F F\nCOUNT 1 4 1 2 1 3\n"
        "WIDTH 7\nHEIGHT 1\nPOINTS 7\nDATA "
    )
    plain = b"".join(np.ascontiguousarray(rows[name]).tobytes() for name in dtype.names or ())
    packed = struct.pack("<II", len(compressed(plain)), len(plain)) + compressed(plain)
    text = "".join(f"{at} 9 9 9 9 2 0 0 3 0 0 0\n" for at in range(7)).encode()
    for encoding, body in (
        ("binary", rows.tobytes()),
        ("binary_compressed", packed),
        ("ascii", text),
    ):
        table = read_pcd(written(tmp_path, f"{head}{encoding}\n".encode() + body))
        assert sorted(table.columns) == ["x", "y", "z"]
        assert table.columns["x"].tolist() == list(range(7))
        assert table.columns["z"].tolist() == [3] * 7


@pytest.mark.parametrize(
    "header",
    [
        {"COUNT": "", "VIEWPOINT": "", "VERSION": ".6"},
        {"POINTS": "", "WIDTH": "25", "HEIGHT": "2"},
        {"DATA": "BINARY"},
    ],
)
def test_optional_lines_may_be_missing(tmp_path: Path, header: dict[str, str]) -> None:
    table = read_pcd(written(tmp_path, pcd_bytes(columns(), "binary", **header)))
    assert table.count == 50


def test_dos_line_ends_are_read(tmp_path: Path) -> None:
    data = pcd_bytes(columns(), "ascii").replace(b"\n", b"\r\n")
    np.testing.assert_array_equal(read_pcd(written(tmp_path, data)).columns["x"], columns()["x"])


def test_text_that_does_not_keep_to_its_types_is_read(tmp_path: Path) -> None:
    head = "VERSION 0.7\nFIELDS x y z ring\nSIZE 4 4 4 2\nTYPE F F F U\nCOUNT 1 1 1 1\n"
    head += "WIDTH 2\nHEIGHT 1\nPOINTS 2\nDATA ascii\n"
    table = read_pcd(written(tmp_path, (head + "1 2 nan 3.0\n4 5 6 7\n").encode()))
    assert table.columns["ring"].tolist() == [3, 7]


def test_a_viewpoint_is_reported_and_not_applied(tmp_path: Path) -> None:
    data = pcd_bytes(columns(), "binary", VIEWPOINT="1 2 3 1 0 0 0")
    table = read_pcd(written(tmp_path, data))
    assert "VIEWPOINT (1 2 3 1 0 0 0)" in table.remarks[0]
    np.testing.assert_array_equal(table.columns["x"], columns()["x"])
    plain = pcd_bytes(columns(), "binary", VIEWPOINT="0.0 0.0 0.0 1.0 0.0 0.0 0.0")
    assert read_pcd(written(tmp_path, plain)).remarks == ()


@pytest.mark.parametrize(
    ("header", "words"),
    [
        ({"POINTS": "51", "WIDTH": "51"}, "51 points"),
        ({"POINTS": "49", "WIDTH": "49"}, "49 points"),
        ({"POINTS": "999999999999", "WIDTH": "999999999999"}, "999999999999 points|do not fit"),
        ({"POINTS": "-1"}, "POINTS is '-1'"),
        ({"WIDTH": "7"}, "POINTS is 50, WIDTH x HEIGHT is 7 x 1"),
        ({"FIELDS": "x y z"}, "FIELDS, SIZE, TYPE and COUNT have 3, 7, 7 and 7"),
        ({"TYPE": "F U F F F U X"}, "field 'flags' has TYPE X"),
        ({"SIZE": "4 2 4 8 4 8 3"}, "field 'flags' has TYPE I, SIZE 3"),
        ({"COUNT": "1 1 1 1 1 1 99999999"}, "COUNT 99999999"),
        ({"DATA": "zip"}, "DATA is 'zip'"),
        ({"VIEWPOINT": "here"}, "VIEWPOINT is no pose"),
    ],
)
@pytest.mark.parametrize("encoding", ENCODINGS)
def test_a_header_that_lies_is_refused_and_allocates_nothing(
    tmp_path: Path, header: dict[str, str], words: str, encoding: str
) -> None:
    path = written(tmp_path, pcd_bytes(columns(), **({"encoding": encoding} | header)))
    tracemalloc.start()
    with pytest.raises(LayoutError, match=words):
        read_pcd(path)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 300_000


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_a_cut_file_is_refused(tmp_path: Path, encoding: str) -> None:
    data = pcd_bytes(columns(), encoding)
    for length in (len(data) - 30, len(data) - 300, 200, 20, 0):
        with pytest.raises(LayoutError):
            read_pcd(written(tmp_path, data[:length]))


def test_compressed_sizes_that_lie_are_refused(tmp_path: Path) -> None:
    data = pcd_bytes(columns(), "binary_compressed")
    at = data.index(b"binary_compressed\n") + len(b"binary_compressed\n")
    size = struct.unpack_from("<II", data, at)
    for lie, words in (
        ((size[0] + 1, size[1]), "compressed bytes are claimed"),
        ((size[0] - 9, size[1]), "should give"),
        ((size[0], size[1] - 4), "its compressed data holds"),
        ((3, size[1]), "cannot hold"),
    ):
        broken = data[:at] + struct.pack("<II", *lie) + data[at + 8 :]
        with pytest.raises(LayoutError, match=words):
            read_pcd(written(tmp_path, broken))


class TestLzf:
    def test_copies_may_overlap_themselves(self) -> None:
        # Two literals, then six bytes from two back: liblzf, "lzf_d.c".
        source = np.frombuffer(bytes([1, 65, 66, (4 << 5) | 0, 1]), dtype=np.uint8)
        assert decompress_lzf(source, 8).tobytes() == b"ABABABAB"

    def test_long_copies_have_their_length_in_a_byte_of_its_own(self) -> None:
        source = np.frombuffer(bytes([0, 65, 7 << 5, 255, 0]), dtype=np.uint8)
        assert decompress_lzf(source, 265).tobytes() == b"A" * 265

    @pytest.mark.parametrize(
        "source", [b"\x05AB", b"\x20\x00", b"\x00A\xe0", b"\x00A\x20", b"\x00A\xe0\xff\x00\x00"]
    )
    def test_broken_data_is_refused(self, source: bytes) -> None:
        with pytest.raises(LayoutError, match=r"broken data|gives"):
            decompress_lzf(np.frombuffer(source, dtype=np.uint8), 5)


def test_a_real_scan_of_a_64_beam_lidar_is_read(shared_data: Path) -> None:
    path = shared_data / "pjlab_opencalib/lidar2camera/auto_calib/data/calib.pcd"
    table = read_pcd(path)
    assert table.count == 85546
    assert sorted(table.columns) == ["intensity", "ring", "timestamp", "x", "y", "z"]
    rule = PointTime("timestamp", None, "epoch", unsigned=False)
    scan = scan_from_table(table, 1_605_333_546_800_000_000, rule, in_map=False)
    assert scan.point_stamps_ns is not None
    assert 1_605_333_546_782_000_000 < scan.start_ns < scan.end_ns < 1_605_333_546_883_000_000
    assert np.unique(table.columns["ring"]).tolist() == list(range(64))
    assert float(np.abs(scan.points).max()) == pytest.approx(129.79668, abs=1e-4)
