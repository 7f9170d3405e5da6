"""Depth keeps every bit, and what is no depth image is refused in words."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from numpy.typing import NDArray

from civil_rgbd.errors import FormatError
from civil_rgbd.format.depth_exr import read_depth, write_depth

PLAIN = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}


def slope(height: int = 40, width: int = 30) -> NDArray[np.float32]:
    rows, columns = np.mgrid[0:height, 0:width]
    depth_m = (2 + rows / 7 + columns / 3).astype(np.float32)
    depth_m[(rows + columns) % 3 == 0] = 0
    return depth_m


def refusal(path: Path) -> str:
    with pytest.raises(FormatError) as caught:
        read_depth(path)
    assert caught.value.where == str(path)
    assert "validate" in caught.value.fix
    return caught.value.what


def whole_or_refused(path: Path) -> tuple[int, ...] | None:
    """The shape of what is read; None for a refusal. Anything else is a crash, and fails."""
    try:
        return read_depth(path).shape
    except FormatError:
        return None


@given(
    depth_m=arrays.arrays(
        np.float32,
        arrays.array_shapes(min_dims=2, max_dims=2, max_side=40),
        elements=st.floats(0, 2.0**100, width=32),
    )
)
def test_depth_comes_back_bit_by_bit(
    tmp_path_factory: pytest.TempPathFactory, depth_m: NDArray[np.float32]
) -> None:
    depth_m = np.abs(depth_m)  # no -0.0
    path = tmp_path_factory.getbasetemp() / "depth.exr"

    data = write_depth(path, depth_m, sync=False)

    back = read_depth(path, size=(depth_m.shape[0], depth_m.shape[1]))
    assert back.dtype == np.float32
    assert back.tobytes() == depth_m.tobytes()
    assert path.read_bytes() == data


def test_the_same_depth_gives_the_same_bytes(tmp_path: Path) -> None:
    once = write_depth(tmp_path / "a.exr", slope())

    assert write_depth(tmp_path / "b.exr", np.asfortranarray(slope())) == once


def test_the_package_openexr_reads_our_file(tmp_path: Path) -> None:
    write_depth(tmp_path / "a.exr", slope())

    part = OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True).parts[0]
    assert list(part.channels) == ["Z"]
    assert part.header["compression"] == OpenEXR.ZIP_COMPRESSION
    assert np.array_equal(part.channels["Z"].pixels, slope())


@pytest.mark.parametrize(
    ("value", "words"),
    [(np.nan, "NaN or Inf"), (np.inf, "NaN or Inf"), (-1.0, "negative"), (-0.0, r"-0\.0")],
)
def test_values_that_are_no_depth_are_not_written(tmp_path: Path, value: float, words: str) -> None:
    depth_m = slope()
    depth_m[3, 4] = value

    with pytest.raises(ValueError, match=words):
        write_depth(tmp_path / "a.exr", depth_m)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("kind", [np.float64, np.float16, np.uint16])
def test_other_types_are_not_written(tmp_path: Path, kind: type[np.generic]) -> None:
    with pytest.raises(ValueError, match="not float32"):
        write_depth(tmp_path / "a.exr", slope().astype(kind))  # type: ignore[arg-type]  # on purpose


def test_values_that_are_no_depth_are_not_read(tmp_path: Path) -> None:
    for number, value in enumerate((np.nan, np.inf, -np.inf, -2.0)):
        depth_m = slope()
        depth_m[3, 4] = value
        path = tmp_path / f"{number}.exr"
        OpenEXR.File(PLAIN, {"Z": depth_m}).write(str(path))

        assert ("negative" if value == -2.0 else "NaN or Inf") in refusal(path)


def test_another_size_than_the_cameras_is_refused(tmp_path: Path) -> None:
    write_depth(tmp_path / "a.exr", slope())

    with pytest.raises(FormatError, match="30 x 40 pixels; the camera has 40 x 30"):
        read_depth(tmp_path / "a.exr", size=(30, 40))


def test_a_file_cut_anywhere_is_refused(tmp_path: Path) -> None:
    data = write_depth(tmp_path / "a.exr", slope())
    cut = tmp_path / "cut.exr"

    for length in [*range(0, len(data), 23), *range(len(data) - 20, len(data))]:
        cut.write_bytes(data[:length])
        assert "whole depth image" in refusal(cut)


def test_a_hole_of_zeros_is_refused_or_changes_nothing(tmp_path: Path) -> None:
    data = write_depth(tmp_path / "a.exr", slope())
    holed = tmp_path / "holed.exr"

    for start in range(0, len(data) - 64, 16):
        holed.write_bytes(data[:start] + bytes(64) + data[start + 64 :])
        assert whole_or_refused(holed) in {slope().shape, None}


@given(st.data())
def test_flipped_bytes_never_crash(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    folder = tmp_path_factory.getbasetemp()
    whole = bytearray(write_depth(folder / "whole.exr", slope(), sync=False))
    for _ in range(data.draw(st.integers(1, 8))):
        whole[data.draw(st.integers(0, len(whole) - 1))] = data.draw(st.integers(0, 255))
    flipped = folder / "flipped.exr"
    flipped.write_bytes(whole)

    whole_or_refused(flipped)


@given(st.binary(max_size=400), st.booleans())
def test_garbage_is_refused(
    tmp_path_factory: pytest.TempPathFactory, garbage: bytes, magic: bool
) -> None:
    path = tmp_path_factory.getbasetemp() / "garbage.exr"
    path.write_bytes(b"v/1\x01\x02\x00\x00\x00" * magic + garbage)

    refusal(path)


def test_a_file_of_words_and_an_empty_one_are_refused(tmp_path: Path) -> None:
    (tmp_path / "words.exr").write_text("version https://git-lfs.github.com/spec/v1\n")
    (tmp_path / "empty.exr").touch()

    assert "this is no EXR file: it begins with b'vers'" in refusal(tmp_path / "words.exr")
    assert "the file is empty" in refusal(tmp_path / "empty.exr")
    assert refusal(tmp_path / "missing.exr") == "the file is missing"
    assert "cannot be read" in refusal(tmp_path)


def test_a_lie_about_the_size_is_refused_before_memory_is_taken(tmp_path: Path) -> None:
    data = bytearray(write_depth(tmp_path / "a.exr", slope()))
    for name in (b"dataWindow\0box2i\0", b"displayWindow\0box2i\0"):
        at = data.index(name) + len(name) + 4 + 8
        data[at : at + 8] = (100_000_000).to_bytes(4, "little") * 2
    (tmp_path / "bomb.exr").write_bytes(data)

    assert "100000001 x 100000001 pixels" in refusal(tmp_path / "bomb.exr")


def other_file(path: Path, channels: dict[str, NDArray[np.generic]], **header: object) -> Path:
    OpenEXR.File(PLAIN | header, channels).write(str(path))
    return path


def test_other_images_are_refused_by_name(tmp_path: Path) -> None:
    half, depth_m = slope().astype(np.float16), slope()
    box = (np.array([0, 0], np.int32), np.array([99, 99], np.int32))
    a = tmp_path / "a.exr"

    assert "channel Z is half" in refusal(other_file(a, {"Z": half}))
    assert "channel Z is uint32" in refusal(other_file(a, {"Z": depth_m.astype(np.uint32)}))
    assert "channels Y; depth has one, Z" in refusal(other_file(a, {"Y": depth_m}))
    assert "channels A, Z" in refusal(other_file(a, {"Z": depth_m, "A": depth_m}))
    assert "display window" in refusal(other_file(a, {"Z": depth_m}, displayWindow=box))
    for lossy in ("PXR24", "B44", "DWAA"):
        compression = getattr(OpenEXR, f"{lossy}_COMPRESSION")
        words = refusal(other_file(a, {"Z": depth_m}, compression=compression))
        assert f"compression {lossy} is not lossless" in words


def test_several_parts_are_refused(tmp_path: Path) -> None:
    parts = [OpenEXR.Part({"name": n}, {"Z": slope()}) for n in ("left", "right")]
    OpenEXR.File(parts).write(str(tmp_path / "a.exr"))

    assert "several parts" in refusal(tmp_path / "a.exr")


@pytest.mark.parametrize("name", ["NO", "RLE", "ZIPS", "ZIP", "PIZ"])
def test_every_lossless_compression_is_read(tmp_path: Path, name: str) -> None:
    path = tmp_path / "a.exr"
    other_file(path, {"Z": slope()}, compression=getattr(OpenEXR, f"{name}_COMPRESSION"))

    assert np.array_equal(read_depth(path), slope())


def test_tiles_are_read(tmp_path: Path) -> None:
    tiles = OpenEXR.TileDescription()
    tiles.xSize, tiles.ySize = 16, 12
    path = other_file(tmp_path / "a.exr", {"Z": slope()}, type=OpenEXR.tiledimage, tiles=tiles)

    assert np.array_equal(read_depth(path), slope())
    path.write_bytes(path.read_bytes()[:-1])
    assert "cut off by the file's end" in refusal(path)


def test_images_of_the_formats_authors_are_refused(shared_data: Path) -> None:
    words = {
        path.name: refusal(path)
        for folder in ("openexr_images", "cvml_project")
        for path in (shared_data / folder).rglob("*.exr")
    }

    assert len(words) == 10
    assert "channels Y; depth has one, Z" in words["depth.exr"]
    assert "deep image" in words["Trunks.exr"]
    assert "channels A, B, G, R, Z, disparityL.x" in words["singlepart.0001.exr"]
