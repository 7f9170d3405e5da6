"""What becomes of laser pulses, against the LiDAR equation and numbers by hand."""

from __future__ import annotations

import numpy as np
import pytest

from civil_rgbd.simulator.returns import range_sigma_m, return_probability, signal


def _one(reflectivity: float, range_m: float, cosine: float) -> np.ndarray:
    return signal(np.array([reflectivity]), np.array([range_m]), np.array([cosine]))


def _sigma_m(reflectivity: float, range_m: float, cosine: float) -> float:
    strength = _one(reflectivity, range_m, cosine)
    sigma = range_sigma_m(strength, np.array([range_m]), np.array([cosine]), at_20_m=0.02)
    return float(sigma[0])


def test_an_echo_fades_with_the_square_of_its_range() -> None:
    assert _one(150, 2.0, 0.5)[0] == pytest.approx(0.125)
    assert _one(75, 10.0, 1.0)[0] == pytest.approx(0.005)


@pytest.mark.parametrize(
    ("reflectivity", "range_m", "cosine", "share"),
    [
        (15, 190.0, 1.0, 0.5),  # what the setting says
        (15, 95.0, 1.0, 256 / 257),
        (60, 190.0, 1.0, 256 / 257),  # four times as bright
        (60, 190.0, 0.25, 0.5),
        (15, 60.0, 0.05, 1 / 17),  # dark and grazing: most get lost
    ],
)
def test_dark_far_and_grazing_surfaces_lose_pulses(
    reflectivity: float, range_m: float, cosine: float, share: float
) -> None:
    strength = _one(reflectivity, range_m, cosine)

    probability = return_probability(strength, range_at_10_percent_m=190.0)[0]
    assert probability == pytest.approx(share, abs=0.005)


def test_the_range_of_concrete_at_20_m_errs_by_2_cm() -> None:
    assert _sigma_m(60, 20.0, 1.0) == pytest.approx(0.02, rel=1e-6)


def test_ranges_err_more_far_away_on_dark_things_and_at_a_slant() -> None:
    near = _sigma_m(60, 20.0, 1.0)

    assert near < _sigma_m(60, 100.0, 1.0) < 0.04
    assert near < _sigma_m(8, 20.0, 1.0)
    assert near * 1.05 < _sigma_m(60, 20.0, 0.3) < 0.04
    assert _sigma_m(60, 20.0, 1e-9) < 0.15  # and stay finite where nothing is met
    assert 0.019 < _sigma_m(60, 3.0, 1.0) < 0.02


def test_what_was_not_hit_makes_no_noise_of_its_own() -> None:
    with np.errstate(all="raise"):
        sigma = range_sigma_m(np.zeros(1), np.zeros(1), np.zeros(1), at_20_m=0.02)

    assert np.isfinite(sigma).all()
