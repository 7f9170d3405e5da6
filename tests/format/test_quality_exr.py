"""Quality planes on disk: what goes in comes out, and damage is said in words."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenEXR
import pytest

from civil_rgbd.errors import FormatError
from civil_rgbd.format.depth_exr import write_depth
from civil_rgbd.format.hashes import pixel_sha256
from civil_rgbd.format.quality_exr import Planes, quality_sha256, read_quality, write_quality


def planes() -> dict[str, np.ndarray[tuple[int, int], np.dtype[np.float16]]]:
    rng = np.random.default_rng(0)
    values = rng.integers(-1000, 1000, (3, 37, 50)) / 64
    return dict(zip(("sigma_m", "age_s", "returns"), values.astype(np.float16), strict=True))


def test_planes_come_back_bit_by_bit_in_the_order_of_their_names(tmp_path: Path) -> None:
    written = planes()

    data = write_quality(tmp_path / "a.exr", written)

    found = read_quality(tmp_path / "a.exr", size=(37, 50))
    assert list(found) == ["age_s", "returns", "sigma_m"]
    for name, plane in found.items():
        assert plane.dtype == np.float16
        np.testing.assert_array_equal(plane, written[name])
    assert (tmp_path / "a.exr").read_bytes() == data
    assert write_quality(tmp_path / "b.exr", dict(reversed(written.items()))) == data


def test_the_hash_is_of_the_planes_stacked_in_the_order_of_their_names() -> None:
    some = planes()

    stacked = np.stack([some["age_s"], some["returns"], some["sigma_m"]])

    assert quality_sha256(some) == pixel_sha256(stacked)
    assert quality_sha256(some | {"age_s": some["returns"]}) != quality_sha256(some)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"a": np.zeros((2, 3), np.float32)}, "float32"),
        ({"a": np.zeros((2, 3), np.float16), "b": np.zeros((3, 2), np.float16)}, r"\(3, 2\)"),
        ({"a": np.full((2, 3), np.nan, np.float16)}, "'a': 6 values are NaN"),
        ({"a": np.full((2, 3), -0.0, np.float16)}, "'a': 6 values are -0.0"),
        ({}, r"\[\]"),
    ],
)
def test_what_is_no_plane_is_not_written(tmp_path: Path, wrong: Planes, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        write_quality(tmp_path / "a.exr", wrong)
    assert not list(tmp_path.iterdir())


def test_other_files_are_refused_by_name(tmp_path: Path) -> None:
    path = tmp_path / "a.exr"
    write_depth(path, np.ones((4, 5), dtype=np.float32))
    with pytest.raises(FormatError, match="channel Z is float32; planes are half"):
        read_quality(path)
    data = write_quality(path, planes())
    with pytest.raises(FormatError, match="50 x 37 pixels; the camera has 51 x 37"):
        read_quality(path, size=(37, 51))
    path.write_bytes(data[: len(data) // 2])
    with pytest.raises(FormatError, match="not whole quality planes"):
        read_quality(path)
    with pytest.raises(FormatError, match="the file is missing"):
        read_quality(tmp_path / "none.exr")


def test_a_lossy_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.exr"
    header = {"compression": OpenEXR.B44_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, planes()).write(str(path))

    with pytest.raises(FormatError, match="B44 is not lossless"):
        read_quality(path)
