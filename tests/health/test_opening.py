"""The over-exposed start: where it ends, by looks made by hand."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from civil_rgbd.health.looks import Look
from civil_rgbd.health.opening import overexposed_until

SECONDS = np.arange(300) / 15


def _until(
    white: Callable[[float], float], brightness: Callable[[float], float] = lambda _: 120.0
) -> tuple[float, int]:
    """Return the end of the start, and how many images were looked at."""
    taken: dict[int, Look] = {}

    def look(place: int) -> Look:
        second = float(SECONDS[place])
        return taken.setdefault(place, Look(white(second), 1.0, brightness(second), 0.2))

    return overexposed_until(SECONDS, look), len(taken)


def test_of_a_fit_recording_few_images_are_looked_at() -> None:
    until_s, looks = _until(lambda _: 0.05)

    assert until_s == 0.0
    assert looks < 14


@pytest.mark.parametrize("seconds", [0.2, 0.75, 2.9, 6.0, 13.0])
def test_a_white_start_ends_with_the_first_image_that_is_not(seconds: float) -> None:
    until_s, _ = _until(lambda second: 0.8 if second < seconds - 1e-9 else 0.05)

    assert seconds - 1e-9 <= until_s < seconds + 0.2
    assert seconds > 1 or until_s < seconds + 0.067  # at once, where a cut costs most


def test_a_start_that_is_brighter_but_not_white_is_cut_too() -> None:
    until_s, _ = _until(
        lambda second: 0.2 if second < 0.55 else 0.05,
        lambda second: 180.0 if second < 0.55 else 120.0,
    )

    assert until_s == pytest.approx(9 / 15)


def test_what_fades_after_a_long_white_start_is_cut_too() -> None:
    until_s, _ = _until(
        lambda second: 0.8 if second < 6 else 0.2 if second < 8 else 0.05,
        lambda second: 180.0 if second < 8 else 120.0,
    )

    assert 8 <= until_s < 8.2


def test_a_bright_scene_at_the_start_is_no_exposure_fault() -> None:
    assert _until(lambda _: 0.05, lambda second: 170.0 if second < 0.55 else 120.0)[0] == 0.0


def test_a_recording_that_is_white_all_along_is_no_matter_of_the_start() -> None:
    assert _until(lambda _: 0.6)[0] == 0.0
    assert _until(lambda second: 0.3 if abs(second - 3) < 0.2 else 0.6)[0] == 0.0


def test_what_is_dark_later_says_nothing_of_the_start() -> None:
    def look(place: int) -> Look:
        dark = 2 < SECONDS[place] < 6
        return Look(0.0, 0.0, 3.0, np.nan) if dark else Look(0.05, 1.0, 120.0, 0.2)

    assert overexposed_until(SECONDS, look) == 0.0


def test_broken_images_at_the_start_are_passed_over() -> None:
    white, fine = Look(0.8, 1.0, 220.0, 0.2), Look(0.05, 1.0, 120.0, 0.2)

    def look(place: int) -> Look | None:
        return None if place in {0, 1} else white if place < 6 else fine

    assert overexposed_until(SECONDS, look) == pytest.approx(6 / 15)
    assert overexposed_until(SECONDS, lambda _: None) == 0.0
