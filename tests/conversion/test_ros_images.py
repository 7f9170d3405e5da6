"""Images: every encoding by hand, every codec by another path."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from civil_rgbd.conversion.ros_images import is_photograph, rgb_from_compressed, rgb_from_image
from civil_rgbd.errors import ImageDecodeError, RecordingError

from . import messages

RED_BLUE = np.array([[[255, 0, 0], [0, 0, 255]]] * 2, dtype=np.uint8)  # RGB


def raw(pixels: NDArray[np.uint8], encoding: str, *, padding: int = 0) -> NDArray[np.uint8]:
    height, width, channels = pixels.shape
    rows = [row.tobytes() + b"\xee" * padding for row in pixels]
    step = width * channels + padding
    data = b"".join(rows)
    payload = messages.raw_image(0, data, width, height, encoding, step)
    return rgb_from_image(memoryview(payload), where="test")


def compressed(data: bytes, name: str = "jpeg") -> NDArray[np.uint8]:
    payload = messages.compressed_image(0, data, name=name)
    return rgb_from_compressed(memoryview(payload), where="test")


def encoded(pixels: NDArray[np.generic], suffix: str = ".png") -> bytes:
    return bytes(cv2.imencode(suffix, pixels)[1])


@pytest.mark.parametrize("padding", [0, 3])
@pytest.mark.parametrize(
    ("encoding", "order"),
    [("rgb8", [0, 1, 2]), ("bgr8", [2, 1, 0]), ("rgba8", [0, 1, 2, 1]), ("bgra8", [2, 1, 0, 1])],
)
def test_colour_orders(encoding: str, order: list[int], padding: int) -> None:
    assert np.array_equal(raw(RED_BLUE[:, :, order], encoding, padding=padding), RED_BLUE)


def test_grey_becomes_three_equal_channels() -> None:
    grey = np.array([[[0], [10]], [[200], [255]]], dtype=np.uint8)
    assert np.array_equal(raw(grey, "mono8", padding=2), np.repeat(grey, 3, axis=2))


@pytest.mark.parametrize(
    ("encoding", "luma_first"),
    [("yuyv", True), ("yuv422_yuy2", True), ("yuv422", False), ("uyvy", False)],
)
def test_both_orders_of_yuv_422(encoding: str, luma_first: bool) -> None:
    # BT.601, studio range: pure red is Y 81, U 90, V 240.
    pair = [[81, 90], [81, 240]] if luma_first else [[90, 81], [240, 81]]
    rgb = raw(np.array([pair * 2] * 2, dtype=np.uint8), encoding, padding=4)
    assert rgb.shape == (2, 4, 3)
    assert np.abs(rgb.astype(int) - [255, 0, 0]).max() <= 2


@pytest.mark.parametrize("encoding", ["16UC1", "bayer_rggb8", "8UC3", "mono16"])
def test_other_encodings_are_refused_with_the_list(encoding: str) -> None:
    with pytest.raises(RecordingError, match=encoding) as caught:
        raw(RED_BLUE, encoding)
    assert not isinstance(caught.value, ImageDecodeError)
    assert "rgb8, bgr8" in caught.value.fix


@pytest.mark.parametrize(
    ("size", "step", "data_bytes"),
    [((2, 2), 6, 11), ((2, 2), 5, 12), ((2, 2), 6, 13), ((0, 2), 6, 12), ((2, 2**32 - 1), 6, 12)],
)
def test_sizes_that_lie_are_a_damaged_image(
    size: tuple[int, int], step: int, data_bytes: int
) -> None:
    payload = messages.raw_image(0, bytes(data_bytes), *size, "rgb8", step)
    with pytest.raises(ImageDecodeError, match="do not fit"):
        rgb_from_image(memoryview(payload), where="test")


def test_png_is_lossless_and_in_rgb_order() -> None:
    assert np.array_equal(compressed(encoded(RED_BLUE[:, :, ::-1]), "png"), RED_BLUE)


def test_jpeg_comes_out_in_rgb_order() -> None:
    red = np.full((16, 16, 3), (0, 0, 250), dtype=np.uint8)  # BGR
    assert np.abs(compressed(encoded(red, ".jpg"))[8, 8].astype(int) - [250, 0, 0]).max() <= 3


def test_content_counts_not_the_format_string() -> None:
    assert np.array_equal(compressed(encoded(RED_BLUE[:, :, ::-1]), "jpeg"), RED_BLUE)


@pytest.mark.parametrize(
    ("name", "swapped"),
    [
        ("rgb8; jpeg compressed bgr8", False),
        ("bgr8; jpeg compressed bgr8", False),
        ("rgb8; jpeg compressed ", False),
        ("rgb8; png compressed rgb8", True),
        ("bgr8; png compressed rgb8", True),
    ],
)
def test_the_format_tells_in_which_order_pixels_were_compressed(name: str, swapped: bool) -> None:
    stored = RED_BLUE if swapped else RED_BLUE[:, :, ::-1]  # as OpenCV was given them
    assert np.array_equal(compressed(encoded(stored), name), RED_BLUE)


def test_grey_codecs_become_three_channels() -> None:
    grey = np.arange(64, dtype=np.uint8).reshape(8, 8)
    assert np.array_equal(compressed(encoded(grey)), np.repeat(grey[:, :, None], 3, axis=2))


def test_16_bit_png_is_refused() -> None:
    with pytest.raises(RecordingError, match="16-bit PNG") as caught:
        compressed(encoded(np.zeros((4, 4), dtype=np.uint16)))
    assert not isinstance(caught.value, ImageDecodeError)


def test_exif_orientation_is_ignored() -> None:
    jpeg = encoded(np.zeros((8, 24, 3), dtype=np.uint8), ".jpg")
    exif = b"Exif\0\0II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0\x06\0\0\0\0\0\0\0"
    turned = jpeg[:2] + b"\xff\xe1" + (len(exif) + 2).to_bytes(2, "big") + exif + jpeg[2:]
    assert cv2.imdecode(np.frombuffer(turned, np.uint8), cv2.IMREAD_COLOR).shape[:2] == (24, 8)
    assert compressed(turned).shape == (8, 24, 3)


@pytest.mark.parametrize("suffix", [".jpg", ".png"])
def test_a_cut_image_is_a_damaged_image(suffix: str) -> None:
    noise = np.random.default_rng(1).integers(0, 255, (64, 64, 3), np.uint8)
    data = encoded(noise, suffix)
    with pytest.raises(ImageDecodeError, match="cannot be decoded"):
        compressed(data[: len(data) // 2])


def test_padding_behind_a_jpeg_is_no_damage() -> None:
    assert compressed(encoded(RED_BLUE, ".jpg") + bytes(500)).shape == (2, 2, 3)


def test_other_content_is_damage_or_another_codec_as_the_format_says() -> None:
    with pytest.raises(ImageDecodeError, match="neither JPEG nor PNG"):
        compressed(b"\0" * 100)
    with pytest.raises(RecordingError, match="'h264'") as caught:
        compressed(b"\0\0\0\x01g" * 20, "h264")
    assert not isinstance(caught.value, ImageDecodeError)


def test_depth_images_are_no_photographs() -> None:
    depth = messages.raw_image(0, bytes(8), 2, 2, "16UC1", 4)
    colour = messages.raw_image(0, bytes(12), 2, 2, "rgb8", 6)
    packed = messages.compressed_image(0, b"", name="16UC1; compressedDepth png")
    assert not is_photograph(depth, compressed=False)
    assert is_photograph(colour, compressed=False)
    assert not is_photograph(packed, compressed=True)
