"""Exposure and sharpness: of drawn pictures, and of samples by hand."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from civil_rgbd.health.checks import Figure
from civil_rgbd.health.pictures import PictureSamples, picture_figures, smear_of

SECONDS = np.arange(0, 10, 0.1)


def _picture() -> np.ndarray:
    rng = np.random.default_rng(3)
    coarse = rng.integers(0, 255, (12, 20)).astype(np.uint8)
    blocks = cv2.resize(coarse, (640, 384), interpolation=cv2.INTER_NEAREST)
    return cv2.GaussianBlur(blocks, (0, 0), 0.5)


def _samples(
    white: np.ndarray | float = 0.05,
    brightness: np.ndarray | float = 120.0,
    smear: np.ndarray | float = 0.2,
) -> PictureSamples:
    every = (np.broadcast_to(values, SECONDS.shape) for values in (white, brightness, smear))
    return PictureSamples(SECONDS, *every, broken=0)


def _figures(samples: PictureSamples) -> dict[str, Figure]:
    return {figure.code: figure for figure in picture_figures(samples)}


def test_a_sharp_picture_is_told_from_a_blurred_one() -> None:
    sharp = _picture()
    smears = [smear_of(sharp)] + [
        smear_of(cv2.GaussianBlur(sharp, (0, 0), sigma)) for sigma in (1.0, 2.0, 4.0)
    ]

    assert smears == sorted(smears)
    assert smears[0] < 0.3
    assert smears[2] > 0.6


@pytest.mark.parametrize("size", [(13, 1), (1, 13)])
def test_motion_along_one_axis_is_enough(size: tuple[int, int]) -> None:
    assert smear_of(cv2.blur(_picture(), size)) > 0.6


def test_a_flat_picture_shows_no_sharpness() -> None:
    assert np.isnan(smear_of(np.full((100, 100), 77, np.uint8)))


def test_a_sharp_recording_well_exposed_is_fit() -> None:
    assert not any(figure.found for figure in _figures(_samples()).values())


def test_the_white_start_says_where_to_cut() -> None:
    white = np.where(SECONDS < 0.75, 0.8, 0.05)

    found = _figures(_samples(white=white))

    assert found["overexposed-start"].value == pytest.approx(0.8)
    assert "leave the first 0.8 s out" in found["overexposed-start"].fix
    assert not found["overexposed"].found  # the start is counted once


def test_a_start_that_is_brighter_but_not_white_is_cut_too() -> None:
    early = SECONDS < 0.55
    samples = _samples(white=np.where(early, 0.2, 0.05), brightness=np.where(early, 180.0, 120.0))

    assert _figures(samples)["overexposed-start"].value == pytest.approx(0.6)


def test_a_bright_scene_at_the_start_is_no_exposure_fault() -> None:
    early = SECONDS < 0.55

    figures = _figures(_samples(brightness=np.where(early, 170.0, 120.0)))

    assert figures["overexposed-start"].value == 0.0


def test_white_images_in_the_middle_are_found() -> None:
    white = np.where((SECONDS > 5) & (SECONDS < 6), 0.5, 0.05)

    figure = _figures(_samples(white=white))["overexposed"]

    assert figure.found
    assert figure.value == pytest.approx(9.0)


def test_a_recording_that_is_white_all_along_is_no_matter_of_the_start() -> None:
    figures = _figures(_samples(white=0.6))

    assert figures["overexposed"].value == pytest.approx(100.0)


def test_blurred_images_are_counted() -> None:
    figure = _figures(_samples(smear=np.where(SECONDS > 8.95, 0.7, 0.2)))["blurred"]

    assert figure.value == pytest.approx(10.0)
    assert figure.found


def test_without_any_image_nothing_can_be_seen() -> None:
    nothing = np.zeros(0)

    figures = _figures(PictureSamples(nothing, nothing, nothing, nothing, broken=4))

    assert {figure.value for figure in figures.values()} == {None}
    assert figures["blurred"].detail == "none of 4 images could be decoded"
