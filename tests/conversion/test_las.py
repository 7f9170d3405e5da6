"""LAS and LAZ: coordinates of a country's map, and what gps_time may mean."""

from __future__ import annotations

import builtins
import struct
from pathlib import Path

import laspy
import numpy as np
import pytest

from civil_rgbd.conversion.las import read_las
from civil_rgbd.conversion.point_table import LayoutError, reading_cloud, scan_from_table
from civil_rgbd.conversion.point_time import PointTime, point_time_of
from civil_rgbd.errors import MissingExtraError, RecordingError

from .cloud_writers import write_las

# 14 November 2023 22:13:20 UTC is second 252,818 of GPS week 2288 (18 s ahead of UTC).
STAMP_NS = 1_700_000_000 * 10**9
WEEK_S = 1_700_000_000 - 315_964_800 + 18 - 2288 * 604_800
ADJUSTED_S = 1_700_000_000 - 315_964_800 + 18 - 10**9


def utm(count: int = 100) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    return np.random.default_rng(3).normal(size=(count, 3)) * 20 + [540_000, 4_810_000, 330]


@pytest.mark.parametrize("suffix", ["las", "laz"])
def test_map_coordinates_keep_their_digits(tmp_path: Path, suffix: str) -> None:
    table = read_las(write_las(tmp_path / f"a.{suffix}", utm(), scale=1e-4))
    scan = scan_from_table(table, STAMP_NS, None, in_map=True)
    assert scan.points.dtype == np.float64
    np.testing.assert_allclose(scan.points, utm(), atol=0.51e-4, rtol=0)


@pytest.mark.parametrize(("version", "point_format"), [("1.2", 0), ("1.2", 3), ("1.4", 6)])
def test_every_version_is_read(tmp_path: Path, version: str, point_format: int) -> None:
    cloud = laspy.LasData(laspy.LasHeader(point_format=point_format, version=version))
    cloud.header.offsets = np.floor(utm().min(axis=0))
    cloud.x, cloud.y, cloud.z = utm().T
    cloud.write(str(tmp_path / "a.las"))
    table = read_las(tmp_path / "a.las")
    assert sorted(table.columns) == ["x", "y", "z"]  # a gps_time that is zero says nothing
    assert table.count == 100


@pytest.mark.parametrize(
    ("seconds", "option"),
    [
        (WEEK_S, "gps_time:s:gps-week"),
        (ADJUSTED_S, "gps_time:s:gps"),
        (1_700_000_000, "gps_time:s:epoch"),
        (0.001, "gps_time:s:header"),
    ],
)
def test_gps_time_is_read_as_the_option_says(tmp_path: Path, seconds: float, option: str) -> None:
    path = write_las(tmp_path / "a.las", utm(), seconds + np.arange(100) * 1e-3)
    table = read_las(path)
    rule = point_time_of(table.types, option, where=path)
    scan = scan_from_table(table, STAMP_NS, rule, in_map=False)
    assert scan.point_stamps_ns is not None
    first = 1_000_000 if option.endswith("header") else 0
    np.testing.assert_allclose(
        scan.point_stamps_ns - STAMP_NS, first + np.arange(100) * 10**6, atol=500
    )


def test_seconds_of_the_week_may_turn_over_within_a_scan() -> None:
    turn_ns = (2288 * 604_800 + 315_964_800 - 18) * 10**9
    rule = PointTime("gps_time", "s", "gps-week", unsigned=False)
    columns = {name: np.ones(2) for name in "xyz"} | {"gps_time": np.array([604_799.9, 0.1])}
    from civil_rgbd.conversion.point_table import PointTable

    for header_ns in (turn_ns - 10**8, turn_ns, turn_ns + 10**8):
        scan = scan_from_table(PointTable(2, columns), header_ns, rule, in_map=False)
        assert scan.point_stamps_ns is not None
        np.testing.assert_allclose(scan.point_stamps_ns - turn_ns, [-(10**8), 10**8], atol=50)


def test_gps_time_is_never_guessed(tmp_path: Path) -> None:
    path = write_las(tmp_path / "a.las", utm(), WEEK_S + np.arange(100) * 1e-3)
    with pytest.raises(RecordingError, match=r"gps_time.*unknown unit") as caught:
        point_time_of(read_las(path).types, None, where=path)
    assert "gps-week" in caught.value.fix
    rule = point_time_of(read_las(path).types, "gps_time:s:gps", where=path)
    with (
        pytest.raises(RecordingError, match="more than 1 s from their header"),
        reading_cloud(path),
    ):
        scan_from_table(read_las(path), STAMP_NS, rule, in_map=False)


@pytest.mark.parametrize(
    ("at", "layout", "value", "words"),
    [
        (0, "4s", b"LASX", "does not begin with 'LASF'"),
        (107, "<I", 101, "101 points of 28 bytes"),
        (107, "<I", 99, "laspy|claims"),
        (107, "<I", 4_000_000_000, "4000000000 points"),
        (100, "<I", 4_000_000_000, "records before the data"),
        (96, "<I", 4_000_000_000, "does not fit the file"),
        (94, "<H", 60_000, "does not fit the file"),
    ],
)
def test_a_header_that_lies_is_refused(
    tmp_path: Path, at: int, layout: str, value: bytes | int, words: str
) -> None:
    data = bytearray(write_las(tmp_path / "a.las", utm()).read_bytes())
    struct.pack_into(layout, data, at, value)
    (tmp_path / "a.las").write_bytes(data)
    if value == 99:
        assert read_las(tmp_path / "a.las").count == 99  # LAS allows more behind its points
        return
    with pytest.raises(LayoutError, match=words):
        read_las(tmp_path / "a.las")


@pytest.mark.parametrize("suffix", ["las", "laz"])
def test_a_cut_file_is_refused(tmp_path: Path, suffix: str) -> None:
    path = write_las(tmp_path / f"a.{suffix}", utm(3000))
    data = path.read_bytes()
    for share in (0.9, 0.5, 0.02):
        path.write_bytes(data[: int(len(data) * share)])
        with pytest.raises(LayoutError):
            read_las(path)


def test_without_laspy_the_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_las(tmp_path / "a.las", utm())
    real = builtins.__import__

    def no_laspy(name: str, *rest: object, **more: object) -> object:
        if name == "laspy":
            raise ImportError(name)
        return real(name, *rest, **more)  # type: ignore[arg-type]  # handed through

    monkeypatch.setattr(builtins, "__import__", no_laspy)
    with pytest.raises(MissingExtraError, match="need laspy") as caught:
        read_las(path)
    assert caught.value.fix == 'pip install "civil-rgbd[las]"'
