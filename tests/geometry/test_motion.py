"""The kernels that move points: bit for bit what the source says, whatever the compiler may do."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from civil_rgbd.geometry.motion import move_points, poses_between

from ..strategies import rigid_transforms, seeds

IDENTITY = np.array([[0.0, 0.0, 0.0, 1.0]])


@given(rigid_transforms(), seeds)
def test_points_go_through_mounting_and_pose_and_lose_the_origin(
    T_body_points: NDArray[np.float64], seed: int
) -> None:
    rng = np.random.default_rng(seed)
    points = rng.uniform(-50, 50, size=(5, 3))
    turns = Rotation.random(5, rng=rng)
    translations, origin = rng.uniform(-9, 9, size=(5, 3)), np.array([3.0, -2.0, 1.0])
    out = np.empty((3, 5), dtype=np.float32)

    move_points(points, T_body_points, translations, turns.as_quat(), origin, out)

    in_body = (T_body_points @ np.c_[points, np.ones(5)].T)[:3].T
    expected = turns.apply(in_body) + translations - origin
    np.testing.assert_allclose(out.T, expected, rtol=0, atol=2e-5)


@given(rigid_transforms(), seeds)
def test_one_pose_may_serve_all_points(T_body_points: NDArray[np.float64], seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = rng.uniform(-50, 50, size=(5, 3)).astype(np.float32)
    turn, translation = Rotation.random(rng=rng), rng.uniform(-9, 9, size=3)
    one, each = np.empty((3, 5), dtype=np.float32), np.empty((3, 5), dtype=np.float32)
    q, origin = turn.as_quat(), np.zeros(3)

    move_points(points, T_body_points, translation[None], q[None], origin, one)
    move_points(
        points, T_body_points, np.tile(translation, (5, 1)), np.tile(q, (5, 1)), origin, each
    )

    np.testing.assert_array_equal(one, each)


def test_products_and_sums_are_rounded_one_by_one() -> None:
    # As in test_render: the second product rounds by up to an eighth; fused, that would show.
    y = 1.1
    big_y = (2.0**50 + 1) / 3
    T_body_points = np.zeros((4, 4))
    T_body_points[0, :2] = 5.0 - big_y * y, big_y
    assert Fraction(big_y) * Fraction(y) != Fraction(big_y * y)
    points = np.tile([1.0, y, 0.0], (64, 1))
    out = np.empty((3, 64), dtype=np.float32)

    move_points(points, T_body_points, np.zeros((1, 3)), IDENTITY, np.zeros(3), out)

    assert set(out[0].tolist()) == {5.0}


@pytest.mark.parametrize("order", ["ascending", "descending", "shuffled"])
def test_instants_may_come_in_any_order(order: str) -> None:
    rng = np.random.default_rng(2)
    stamps = np.cumsum(rng.integers(1, 50, size=30))
    translations = rng.normal(size=(30, 3))
    quaternions = Rotation.random(30, rng=rng).as_quat()
    instants = np.arange(stamps[0], stamps[-1] + 1)
    places = {
        "ascending": np.arange(len(instants)),
        "descending": np.arange(len(instants))[::-1].copy(),
        "shuffled": rng.permutation(len(instants)),
    }[order]

    def poses(asked: NDArray[np.int64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        out = np.empty((len(asked), 3)), np.empty((len(asked), 4))
        poses_between(asked, stamps, translations, quaternions, *out)
        return out

    alone = [poses(instants[place : place + 1]) for place in places]

    found = poses(instants[places])

    np.testing.assert_array_equal(found[0], np.concatenate([t for t, _ in alone]))
    np.testing.assert_array_equal(found[1], np.concatenate([q for _, q in alone]))
