"""Broken, white, dark and blurred images: of drawn pictures, and of looks made by hand."""

from __future__ import annotations

from math import comb
from pathlib import Path

import cv2
import numpy as np
import pytest

from civil_rgbd.converters import open_recording
from civil_rgbd.domain.recording import RecordingOptions
from civil_rgbd.health.checks import CHECKS, Figure
from civil_rgbd.health.looks import Look, look_at, smear_of
from civil_rgbd.health.pictures import (
    PictureSamples,
    look_at_pictures,
    picture_figures,
    spread,
)
from civil_rgbd.health.views import viewer_of

from ..recording_faults import Edit, brighten, repaint, rewrite, scattered, truncate

SHARP = Look(white=0.05, seen=1.0, brightness=120.0, smear=0.2)
WHITE = Look(white=0.6, seen=1.0, brightness=220.0, smear=0.2)
SMEARED = Look(white=0.05, seen=1.0, brightness=120.0, smear=0.7)
DARK = Look(white=0.0, seen=0.0, brightness=4.0, smear=float("nan"))


def _picture() -> np.ndarray:
    rng = np.random.default_rng(3)
    coarse = rng.integers(0, 255, (12, 20)).astype(np.uint8)
    blocks = cv2.resize(coarse, (640, 384), interpolation=cv2.INTER_NEAREST)
    return cv2.GaussianBlur(blocks, (0, 0), 0.5)


def _figures(*looks: Look | None, start_s: float = 0.0) -> dict[str, Figure]:
    seconds = tuple(0.1 * number for number in range(len(looks)))
    return {f.code: f for f in picture_figures(PictureSamples(seconds, looks, start_s))}


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


def test_a_cap_on_the_lens_is_dark_and_its_noise_not_blurred() -> None:
    noise = np.random.default_rng(1).integers(0, 24, (100, 100)).astype(np.uint8)

    look = look_at(noise)

    assert look.dark
    assert not look.blurred
    assert not look.overexposed


def test_a_night_with_a_lamp_is_not_too_dark() -> None:
    night = np.full((100, 100), 5, np.uint8)
    night[40:60, 40:60] = 90

    assert not look_at(night).dark


def test_a_sharp_recording_well_exposed_is_fit() -> None:
    figures = _figures(*[SHARP] * 60)

    assert not any(figure.found for figure in figures.values())
    assert figures["blurred"].detail == "0 of 60 looked at; median smear 0.20"


@pytest.mark.parametrize(
    ("fault", "code"),
    [(None, "images-broken"), (WHITE, "overexposed"), (DARK, "too-dark"), (SMEARED, "blurred")],
)
def test_a_tenth_of_faulty_images_is_found_and_nothing_else(fault: Look | None, code: str) -> None:
    figures = _figures(*[SHARP] * 54, *[fault] * 6)

    assert {figure.code for figure in figures.values() if figure.found} == {code}
    assert figures[code].value == pytest.approx(10.0)
    assert figures[code].detail.startswith("6 of 60 looked at")


def test_the_white_start_says_where_to_cut_and_is_counted_once() -> None:
    figures = _figures(*[WHITE] * 8, *[SHARP] * 12, start_s=0.8)

    assert figures["overexposed-start"].value == 0.8
    assert "leave the first 0.8 s out" in figures["overexposed-start"].fix
    assert not figures["overexposed"].found


def test_images_that_are_all_black_are_a_finding() -> None:
    figures = _figures(*[DARK] * 60)

    assert figures["too-dark"].value == 100.0
    assert figures["too-dark"].found
    assert figures["blurred"].state == "not observable"


def test_images_that_are_all_broken_are_a_finding() -> None:
    figures = _figures(*[None] * 4)

    assert figures["images-broken"].value == 100.0
    assert {f.state for code, f in figures.items() if code != "images-broken"} == {"not observable"}
    assert figures["blurred"].detail == "none of 4 images could be decoded"


def test_without_any_image_nothing_can_be_seen() -> None:
    assert {figure.value for figure in _figures().values()} == {None}


@pytest.mark.parametrize(("images", "most"), [(61, 60), (301, 300), (450, 300), (5400, 60)])
def test_images_are_spread_evenly_none_of_them_twice(images: int, most: int) -> None:
    places = np.array(spread(images, most))

    assert len(np.unique(places)) == most
    assert places[-1] < images
    assert np.diff(places).max() < 2 * images / most + 1


def test_images_are_spread_out_of_step_with_every_tenth() -> None:
    places = np.array(spread(600, 60))

    assert all((places % 10 == phase).any() for phase in range(10))


def test_a_fault_of_twice_the_limit_is_found_but_for_few_in_1000() -> None:
    images, looked_at = 5400, 300
    share = 2 * CHECKS["blurred"].limit / 100
    faulty = round(share * images)

    none_of_60 = comb(images - faulty, 60) / comb(images, 60)
    found_at = int(CHECKS["blurred"].limit / 100 * looked_at)
    too_few = sum(
        comb(faulty, k) * comb(images - faulty, looked_at - k) for k in range(found_at + 1)
    ) / comb(images, looked_at)

    assert none_of_60 + too_few < 0.005


def _seen(walk: Path, out: Path, edit: Edit) -> PictureSamples:
    recording = open_recording(rewrite(walk, out, edit), RecordingOptions())
    return look_at_pictures(recording, viewer_of(recording.rig.camera))


def test_all_of_a_short_recording_is_looked_at_only_where_a_picture_is_at_fault(
    turning_walk: Path, tmp_path: Path
) -> None:
    some = scattered(0.1, np.random.default_rng(1))

    fit = _seen(turning_walk, tmp_path / "fit.mcap", lambda message: [message])
    cut = _seen(turning_walk, tmp_path / "cut.mcap", truncate(some, 200))

    assert len(fit.looks) == 60
    assert None not in fit.looks
    assert len(cut.looks) in {90, 91}
    assert cut.looks.count(None) in {9, 10}


def test_a_start_white_for_six_seconds_is_told_from_the_rest(
    turning_walk: Path, tmp_path: Path
) -> None:
    first_ns: list[int] = []

    def early(stamp_ns: int) -> bool:
        first_ns[:] = first_ns or [stamp_ns]
        return stamp_ns < first_ns[0] + 6_000_000_000

    edit = repaint(early, lambda pixels, _: brighten(pixels, 40))
    samples = _seen(turning_walk, tmp_path / "white.mcap", edit)

    assert samples.start_s == pytest.approx(6.0, abs=0.2)
    assert not {f.code: f for f in picture_figures(samples)}["overexposed"].found
