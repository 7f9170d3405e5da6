"""The displacement gate, by hand."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from civil_rgbd.pipeline.select import far_enough

from ..strategies import finite


def along_x(*x: float) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    return np.array([[value, 0.0, 0.0] for value in x]).reshape(-1, 3)


@pytest.mark.parametrize(
    ("x", "kept"),
    [
        ((), []),
        ((5.0,), [0]),
        ((0.0, 0.125, 0.25), [0, 2]),  # exactly the limit is not enough
        ((0.0, 0.1250001), [0, 1]),
        ((0.0, 0.1, 0.2, 0.3, 0.4), [0, 2, 4]),  # from the last kept one, not from the last
        ((0.0, 0.2, 0.0), [0, 1, 2]),  # and back again
        ((0.0, 0.0, 0.0), [0]),
    ],
)
def test_an_image_is_kept_when_the_camera_moved_strictly_more(
    x: tuple[float, ...], kept: list[int]
) -> None:
    assert far_enough(along_x(*x), min_displacement_m=0.125).tolist() == kept


def test_zero_keeps_every_image_even_of_a_camera_that_stands_still() -> None:
    assert far_enough(along_x(1, 1, 1, 2), min_displacement_m=0.0).tolist() == [0, 1, 2, 3]


def test_displacement_is_euclidean_over_all_three_axes() -> None:
    # sqrt(1 + 4 + 4) = 3.
    positions = np.array([[0.0, 0.0, 0.0], [1.0, -2.0, 2.0]])

    assert far_enough(positions, min_displacement_m=2.9999).tolist() == [0, 1]
    assert far_enough(positions, min_displacement_m=3.0).tolist() == [0]


def test_a_step_along_one_axis_is_its_own_length() -> None:
    # 0.3 - 0.2 is just below 0.1 in float64, 0.1 - 0 just 0.1: neither is more than 0.1.
    assert far_enough(along_x(0.2, 0.3), min_displacement_m=0.1).tolist() == [0]
    assert far_enough(along_x(0.0, 0.1), min_displacement_m=0.1).tolist() == [0]
    assert far_enough(along_x(0.0, np.nextafter(0.1, 1)), min_displacement_m=0.1).tolist() == [0, 1]


@given(st.lists(st.tuples(*[finite(-1, 1)] * 3), max_size=30), finite(0.01, 1.5))
def test_what_is_kept_is_apart_and_what_is_not_is_near(
    positions: list[tuple[float, float, float]], limit_m: float
) -> None:
    xyz = np.array(positions).reshape(-1, 3)

    kept = far_enough(xyz, min_displacement_m=limit_m).tolist()

    for index in range(len(xyz)):
        before = [k for k in kept if k < index]
        step = np.square(xyz[index] - xyz[before[-1]]) if before else np.array([np.inf] * 3)
        assert (index in kept) == (np.sqrt(step[0] + step[1] + step[2]) > limit_m)
