"""The stored picture: where its pixels come from, and what happens where there are none."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from civil_rgbd.domain.recipe import ImageStage
from civil_rgbd.geometry.camera import LensCamera, PinholeCamera
from civil_rgbd.pipeline.image import ImageMaker

PINHOLE = PinholeCamera(320, 180, 159.0, 158.0, 158.9, 91.5)
BARREL = (-0.054, 0.063, 0.0002, -0.001, -0.02)


def smooth(width: int, height: int) -> NDArray[np.uint8]:
    """Waves of some 40 pixels, another in each channel."""
    x, y = np.meshgrid(np.arange(width) / width, np.arange(height) / height)
    waves = [np.sin(12 * x + 5 * y + phase) * np.cos(7 * y - 3 * x) for phase in (0, 1, 2)]
    return np.round(127 + 120 * np.stack(waves, axis=-1)).astype(np.uint8)


def noise(width: int, height: int) -> NDArray[np.uint8]:
    return np.random.default_rng(0).integers(0, 256, size=(height, width, 3), dtype=np.uint8)


@pytest.mark.parametrize(
    "camera", [LensCamera(PINHOLE), LensCamera(PINHOLE, "plumb_bob", (0.0,) * 5)]
)
def test_without_distortion_at_scale_1_not_a_bit_changes(camera: LensCamera) -> None:
    raw = noise(320, 180)
    maker = ImageMaker(camera, ImageStage(scale=1.0))

    np.testing.assert_array_equal(maker.make(raw), raw)
    assert maker.camera == PINHOLE
    assert maker.missing_pixels == 0
    assert maker.exists.all()


@pytest.mark.parametrize("scale", [0.6, 0.5, 0.8, 1.0, 1.5])
def test_undistorted_and_resized_it_is_opencvs_within_a_grey_level(scale: float) -> None:
    raw = smooth(320, 180)
    maker = ImageMaker(LensCamera(PINHOLE, "plumb_bob", BARREL), ImageStage(scale=scale))
    undistorted = cv2.undistort(raw, PINHOLE.matrix, np.array(BARREL))
    size = (maker.camera.width_px, maker.camera.height_px)
    expected = cv2.resize(undistorted, size, interpolation=cv2.INTER_LINEAR)

    found = maker.make(raw)

    assert found.shape == (size[1], size[0], 3)
    # Rim pixels: cv2.undistort fills its rim with black, which the resizing then mixes in.
    inner = maker.exists.copy()
    inner[:4], inner[-4:], inner[:, :4], inner[:, -4:] = False, False, False, False
    assert inner.mean() > 0.8
    difference = np.abs(found.astype(int) - expected.astype(int))[inner]
    assert difference.max() <= 1


@pytest.mark.parametrize("scale", [0.6, 0.75, 2.0])
def test_without_distortion_it_is_opencvs_resize(scale: float) -> None:
    raw = smooth(320, 180)
    maker = ImageMaker(LensCamera(PINHOLE), ImageStage(scale=scale))
    size = (maker.camera.width_px, maker.camera.height_px)

    expected = cv2.resize(raw, size, interpolation=cv2.INTER_LINEAR)

    assert np.abs(maker.make(raw).astype(int) - expected).max() <= 1  # up to the very rim


@pytest.mark.parametrize("scale", [0.499, 0.25, 0.1])
def test_below_half_size_areas_are_averaged_and_no_raw_pixel_is_skipped(scale: float) -> None:
    raw = noise(320, 180)
    maker = ImageMaker(LensCamera(PINHOLE), ImageStage(scale=scale))
    size = (maker.camera.width_px, maker.camera.height_px)

    np.testing.assert_array_equal(
        maker.make(raw), cv2.resize(raw, size, interpolation=cv2.INTER_AREA)
    )


def test_at_half_size_the_lookup_itself_averages() -> None:
    # Stored pixel 0 looks at raw 0.5: the mean of 2 x 2 pixels. No area filter is needed yet.
    raw = np.zeros((4, 4, 3), dtype=np.uint8)
    raw[:2, :2] = [[[10] * 3, [20] * 3], [[30] * 3, [40] * 3]]
    camera = LensCamera(PinholeCamera(4, 4, 4.0, 4.0, 1.5, 1.5))

    made = ImageMaker(camera, ImageStage(scale=0.5)).make(raw)

    assert made[0, 0].tolist() == [25] * 3


def test_a_quarter_of_a_distorted_image_is_undistorted_as_well() -> None:
    raw = smooth(320, 180)
    strong = LensCamera(PINHOLE, "plumb_bob", (-0.2, 0.05, 0.0, 0.0, 0.0))
    maker = ImageMaker(strong, ImageStage(scale=0.25))
    undistorted = cv2.undistort(raw, PINHOLE.matrix, np.array(strong.coefficients))
    size = (maker.camera.width_px, maker.camera.height_px)
    expected = cv2.resize(undistorted, size, interpolation=cv2.INTER_AREA)

    inner = maker.exists.copy()
    inner[:2], inner[-2:], inner[:, :2], inner[:, -2:] = False, False, False, False
    assert np.abs(maker.make(raw).astype(int) - expected)[inner].max() <= 4  # two smoothings


def test_pixels_without_a_source_are_black_and_counted() -> None:
    # A pincushion lens: the undistorted image asks for pixels beyond the raw one's corners.
    pincushion = LensCamera(PINHOLE, "plumb_bob", (0.2, 0.0, 0.0, 0.0))
    maker = ImageMaker(pincushion, ImageStage(scale=1.0))
    raw = np.full((180, 320, 3), 200, dtype=np.uint8)

    made = maker.make(raw)

    assert maker.missing_pixels == (~maker.exists).sum() > 100
    assert not maker.exists[0, 0]
    assert (made[~maker.exists] == 0).all()
    # No shade of black leaks into a pixel that has a source, the rim included.
    assert (made[maker.exists] == 200).all()


def test_pixels_beyond_the_fold_of_a_barrel_lens_are_black() -> None:
    wide = PinholeCamera(101, 101, 20.0, 20.0, 50.0, 50.0)
    maker = ImageMaker(LensCamera(wide, "plumb_bob", (-0.3, 0.0, 0.0, 0.0)), ImageStage(scale=1.0))

    made = maker.make(np.full((101, 101, 3), 99, dtype=np.uint8))

    assert made[50, 50 + 36].tolist() == [0, 0, 0]
    assert made[50, 50 + 20].tolist() == [99, 99, 99]


def test_the_raw_image_is_left_alone() -> None:
    raw = np.full((180, 320, 3), 200, dtype=np.uint8)
    before = raw.copy()

    for scale in (0.3, 0.6, 1.0):
        for k in ((0.2, 0.0, 0.0, 0.0), (0.0,) * 4):
            ImageMaker(LensCamera(PINHOLE, "plumb_bob", k), ImageStage(scale=scale)).make(raw)

    np.testing.assert_array_equal(raw, before)


def test_a_read_only_image_is_taken() -> None:
    raw = smooth(320, 180)
    raw.flags.writeable = False

    for scale in (0.3, 0.6, 1.0):
        made = ImageMaker(LensCamera(PINHOLE, "plumb_bob", BARREL), ImageStage(scale=scale)).make(
            raw
        )
        assert made.dtype == np.uint8
