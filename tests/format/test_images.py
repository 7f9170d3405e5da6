"""Colour keeps its order, and a cut file is never half grey."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from civil_rgbd.errors import FormatError
from civil_rgbd.format.images import decode_image, encode_image, read_image


def picture() -> NDArray[np.uint8]:
    rows, columns = np.mgrid[0:40, 0:60]
    return np.stack([4 * columns, 6 * rows, 120 + 0 * rows], axis=-1).astype(np.uint8)


def test_png_comes_back_bit_by_bit() -> None:
    assert np.array_equal(decode_image(encode_image(picture(), codec="png"), where=""), picture())


def test_jpeg_comes_back_nearly_and_red_stays_red() -> None:
    back = decode_image(encode_image(picture(), codec="jpeg"), where="")

    assert np.abs(back.astype(int) - picture()).max() <= 4


def test_the_same_pixels_give_the_same_bytes() -> None:
    for codec in ("jpeg", "png"):
        once = encode_image(picture(), codec=codec)
        assert encode_image(np.asfortranarray(picture()), codec=codec) == once


def test_quality_and_subsampling_reach_the_file() -> None:
    rng = np.random.default_rng(0)
    noise = rng.integers(0, 256, (64, 64, 3), dtype=np.uint8)

    sizes = [
        len(encode_image(noise, codec="jpeg", quality=quality, subsampling=subsampling))
        for quality, subsampling in [(95, "4:4:4"), (95, "4:2:2"), (95, "4:2:0"), (50, "4:2:0")]
    ]
    assert sizes == sorted(sizes, reverse=True)
    assert len(set(sizes)) == 4


def test_what_is_no_image_or_no_codec_is_refused() -> None:
    with pytest.raises(ValueError, match="not uint8"):
        encode_image(picture().astype(np.float32), codec="png")  # type: ignore[arg-type]  # on purpose
    with pytest.raises(ValueError, match="neither jpeg nor png"):
        encode_image(picture(), codec="webp")
    with pytest.raises(ValueError, match="'4:1:1' is none of"):
        encode_image(picture(), codec="jpeg", subsampling="4:1:1")


def test_exif_orientation_is_ignored() -> None:
    data = encode_image(picture(), codec="jpeg")
    # APP1 with one entry: orientation (0x0112) = 6, turn by 90 degrees.
    tiff = b"MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0\x06\0\0\0\0\0\0"
    exif = b"Exif\0\0" + tiff
    turned = data[:2] + b"\xff\xe1" + (len(exif) + 2).to_bytes(2, "big") + exif + data[2:]

    assert cv2.imdecode(np.frombuffer(turned, np.uint8), cv2.IMREAD_COLOR).shape == (60, 40, 3)
    assert np.array_equal(decode_image(turned, where=""), decode_image(data, where=""))


@pytest.mark.parametrize("codec", ["jpeg", "png"])
def test_a_file_cut_anywhere_is_refused(codec: str) -> None:
    data = encode_image(picture(), codec=codec)

    for length in range(len(data)):
        with pytest.raises(FormatError, match="not a whole image") as caught:
            decode_image(data[:length], where="rgb/000001.jpg")
        assert caught.value.where == "rgb/000001.jpg"


def test_a_cut_photograph_with_a_thumbnail_is_refused() -> None:
    data = encode_image(picture(), codec="jpeg")
    comment = b"\xff\xfe" + (len(data) + 2).to_bytes(2, "big") + data  # a JPEG inside the header
    whole = data[:2] + comment + data[2:]

    assert np.array_equal(decode_image(whole, where=""), decode_image(data, where=""))
    with pytest.raises(FormatError, match="end marker"):
        decode_image(whole[:-100], where="")


def test_bytes_after_the_end_do_no_harm() -> None:
    data = encode_image(picture(), codec="jpeg")

    assert np.array_equal(decode_image(data + bytes(200), where=""), decode_image(data, where=""))


def test_other_files_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a.jpg").write_text("words")

    with pytest.raises(FormatError, match="begins with b'word'"):
        read_image(tmp_path / "a.jpg")
    with pytest.raises(FormatError, match="the file is missing"):
        read_image(tmp_path / "b.jpg")
    with pytest.raises(FormatError, match="cannot be read"):
        read_image(tmp_path)
    with pytest.raises(FormatError, match="the file is empty"):
        decode_image(b"", where="")
