"""Damaged cloud files and LVX files: our own errors only, and never more memory than they earn."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from civil_rgbd.conversion.lvx import _judged, _walked
from civil_rgbd.conversion.point_table import reading_cloud, scan_from_table
from civil_rgbd.conversion.scan_folder import READERS
from civil_rgbd.domain.recording import RecordingOptions
from civil_rgbd.errors import CivilRgbdError

from . import lvx_writer
from .cloud_writers import pcd_bytes, ply_bytes, write_las

COUNT = 400
_XYZ = np.random.default_rng(8).normal(size=(3, COUNT)).astype(np.float32)
COLUMNS = dict(zip("xyz", _XYZ, strict=True)) | {"t": np.arange(COUNT, dtype=np.uint32)}


def lvx_bytes(*, second: bool) -> bytes:
    kind, payload = 1 if second else 2, lvx_writer.cartesian(_XYZ.T[:96])
    stamps = 10**9 + np.arange(12).reshape(3, 4) * 400_000
    frames = [[lvx_writer.Packet(stamp, payload, kind) for stamp in row] for row in stamps.tolist()]
    return lvx_writer.file_bytes(frames, second=second)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    folder = tmp_path_factory.mktemp("clouds")
    files = {f"{at}.pcd": pcd_bytes(COLUMNS, e) for at, e in enumerate(("ascii", "binary"))}
    files["2.pcd"] = pcd_bytes(COLUMNS, "binary_compressed")
    for at, encoding in enumerate(("ascii", "binary_little_endian", "binary_big_endian")):
        files[f"{at}.ply"] = ply_bytes(COLUMNS, encoding)
    for suffix in ("las", "laz"):
        files[f"a.{suffix}"] = write_las(folder / f"a.{suffix}", _XYZ.T).read_bytes()
    return files | {"1.lvx": lvx_bytes(second=False), "2.lvx": lvx_bytes(second=True)}


def read(path: Path) -> int:
    """Read everything of a file; return how many points came out."""
    if path.suffix == ".lvx":
        scans = _judged(_walked(path), RecordingOptions(salvage=True))[0].scans
        return sum(len(scans.read(at).points) for at in range(len(scans.stamps_ns)))
    with reading_cloud(path):
        table = READERS[path.suffix](path)
        return len(scan_from_table(table, 0, None, in_map=False).points)


NAMES = ["0.pcd", "1.pcd", "2.pcd", "0.ply", "1.ply", "2.ply", "a.las", "a.laz", "1.lvx", "2.lvx"]


def assert_harmless(path: Path) -> None:
    tracemalloc.start()
    try:
        read(path)
    except CivilRgbdError:
        pass
    finally:
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
    assert peak < 2_000_000, f"{path.stat().st_size} bytes of {path.name} took {peak}"


@pytest.mark.parametrize("name", NAMES)
def test_whole_files_are_read_whole(tmp_path: Path, whole: dict[str, bytes], name: str) -> None:
    (tmp_path / name).write_bytes(whole[name])
    assert read(tmp_path / name) == (COUNT if ".lvx" not in name else 12 * 96)


@pytest.mark.parametrize("name", NAMES)
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    at=st.floats(0, 1, exclude_max=True),
    junk=st.binary(min_size=1, max_size=9),
    how=st.sampled_from(["flip", "cut", "insert", "drop"]),
)
def test_damage_anywhere_is_harmless(
    tmp_path: Path, whole: dict[str, bytes], name: str, at: float, junk: bytes, how: str
) -> None:
    data = whole[name]
    place = int(at * len(data))
    after: Callable[[int], bytes] = lambda skipped: data[place + skipped :]  # noqa: E731  # four ends
    path = tmp_path / name
    path.write_bytes(
        data[:place]
        + {
            "flip": junk + after(len(junk)),
            "cut": b"",
            "insert": junk + after(0),
            "drop": after(len(junk)),
        }[how]
    )
    assert_harmless(path)


@pytest.mark.parametrize("name", NAMES)
def test_every_byte_of_headers_and_ends_may_lie(
    tmp_path: Path, whole: dict[str, bytes], name: str
) -> None:
    data, path = whole[name], tmp_path / name
    places = [*range(0, 120, 1), *range(120, 350, 3), *range(len(data) - 16, len(data))]
    for at in places:
        path.write_bytes(data[:at] + bytes([data[at] ^ 0xFF]) + data[at + 1 :])
        assert_harmless(path)
