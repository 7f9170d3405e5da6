"""A walk's path against numbers by hand and scipy's own B-spline."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import BSpline

from civil_rgbd.simulator.catalogue import SITES, site_of
from civil_rgbd.simulator.path import WalkPath

OVAL = WalkPath(((-10.0, 0.0, 0.0), (10.0, 0.0, 0.0), (10.0, 2.0, 0.5), (-10.0, 2.0, 0.5)))


def test_it_is_a_closed_cubic_b_spline() -> None:
    way = np.linspace(0.0, 2 * OVAL.length_m, 997)
    knots, spacing = OVAL._knots_m, OVAL.length_m / len(OVAL._knots_m)
    wrapped = np.concatenate([knots[-1:], *[knots] * 3])
    spline = BSpline(np.arange(len(wrapped) + 4) - 3.0, wrapped, 3)

    places, slopes = OVAL.ground(way)

    np.testing.assert_allclose(places, spline(way / spacing), rtol=0, atol=1e-12)
    np.testing.assert_allclose(
        slopes, spline.derivative()(way / spacing) / spacing, rtol=0, atol=1e-12
    )


def test_it_stays_inside_its_corners_and_comes_round() -> None:
    places, slopes = OVAL.ground(np.linspace(0.0, OVAL.length_m, 2000))

    assert (places.min(axis=0) > [-10.0, -1e-9, -1e-9]).all()
    assert (places.max(axis=0) < [10.0, 2.0 + 1e-9, 0.5 + 1e-9]).all()
    np.testing.assert_allclose(places[0], places[-1], rtol=0, atol=1e-12)
    speed = np.sqrt((slopes**2).sum(axis=1))
    assert 0.3 < speed.min() < speed.max() < 1.05


def test_straight_on_the_way_is_as_long_as_it_says() -> None:
    places, _ = OVAL.ground(np.array([5.0, 15.0]))

    assert places[1, 0] - places[0, 0] == pytest.approx(10.0, abs=0.02)


def test_two_corners_are_no_way() -> None:
    with pytest.raises(ValueError, match="a way of 2 corners leads nowhere"):
        WalkPath(((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)))


@pytest.mark.parametrize("bridge", sorted(set(SITES) - {"demo"}))
def test_every_bridge_is_walked_past_with_bends_that_can_be_walked(bridge: str) -> None:
    path = site_of(bridge).path

    assert path is not None
    way = np.arange(0.0, path.length_m, 0.01)
    _, slopes = path.ground(way)
    assert np.sqrt((slopes[:, :2] ** 2).sum(axis=1)).min() > 0.2
    assert 1.0 < path.chest_m < 1.7
