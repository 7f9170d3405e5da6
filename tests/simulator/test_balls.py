"""Balls around what moves: every ray that may meet one is named."""

from __future__ import annotations

import numpy as np
import pytest

from civil_rgbd.simulator.balls import in_disc, projected, towards_ball


def _rays(count: int) -> np.ndarray:
    return np.random.default_rng(3).standard_normal((count, 3)).astype(np.float32)


def test_every_ray_that_passes_within_the_radius_is_named_and_no_other() -> None:
    directions, middle = _rays(2000), np.array([4.0, -3.0, 2.0])

    unit = directions / np.sqrt((directions * directions).sum(axis=1, keepdims=True))
    along = unit @ middle
    missed_by = np.sqrt(np.maximum(middle @ middle - along * along, 0))
    clear = np.abs(missed_by - 1.5) > 1e-4  # beyond the rounding of float32

    named = np.zeros(len(directions), dtype=bool)
    named[towards_ball(directions, middle, 1.5)] = True

    assert named[clear].tolist() == ((along > 0) & (missed_by < 1.5))[clear].tolist()
    assert 10 < named.sum() < 1000


def test_a_ball_behind_is_not_met() -> None:
    ahead = np.array([[1, 0, 0]], dtype=np.float32)

    assert towards_ball(ahead, np.array([5.0, 0.0, 0.0]), 1.0).tolist() == [0]
    assert towards_ball(ahead, np.array([-5.0, 0.0, 0.0]), 1.0).tolist() == []


@pytest.mark.parametrize(("middle", "named"), [((0, 0), [0]), ((3, 1), [2]), ((9, 9), [])])
def test_a_disc_names_the_points_inside(middle: tuple[float, float], named: list[int]) -> None:
    points = np.array([[0.5, 7, 0], [1.5, 7, 0], [3, 7, 1]], dtype=np.float32)
    axes = np.array([[1, 0, 0], [0, 0, 1]], dtype=np.float32)

    places, ends = projected(points, axes)

    assert ends.tolist() == [[0.5, 0], [3, 1]]
    assert in_disc(places, ends, np.array(middle, dtype=np.float32), 1.0).tolist() == named
