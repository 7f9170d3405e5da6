"""Drift: what is seen of it without knowing the truth, and when nobody can tell."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from civil_rgbd.geometry.trajectory import Trajectory
from civil_rgbd.odometry.drift import Drift, measure_drift
from civil_rgbd.odometry.inertial import inertial_steps

from .rides import FREE_X, HELD, imu, trajectory

SECONDS = 12
POSES = 10 * SECONDS + 1
AT_REST = np.arange(POSES) <= 10
NEVER = np.zeros(POSES, dtype=np.bool_)


def drift(
    path: Trajectory,
    held: NDArray[np.float64],
    still: NDArray[np.bool_] = AT_REST,
    **biases: tuple[float, float, float],
) -> Drift:
    readings = imu(SECONDS, **biases)
    return measure_drift(path, held, still, inertial_steps(path, readings, still))


def along_x(offsets_m: NDArray[np.float64]) -> Trajectory:
    """Return poses that are off along x."""
    path = trajectory(SECONDS)
    return replace(path, translations_m=path.translations_m + np.outer(offsets_m, [1, 0, 0]))


def held(*, free: slice | None = None) -> NDArray[np.float64]:
    information = np.tile(HELD, (POSES, 1, 1))
    if free is not None:
        information[free] = FREE_X
    return information


def test_right_poses_that_surfaces_hold_do_not_drift() -> None:
    found = drift(trajectory(SECONDS), held(), force_bias=(0.03, -0.04, 0.05))

    assert found.seen_m.max() < 0.01
    assert found.unsure_m.max() < 0.02
    assert found.turn_rad.max() < 0.003


def test_right_poses_stay_trusted_while_the_imu_carries_them_and_doubt_grows() -> None:
    found = drift(trajectory(SECONDS), held(free=slice(30, 100)), force_bias=(0.03, -0.04, 0.05))

    assert found.seen_m.max() < 0.02
    assert 1.5 * found.unsure_m[20] < found.unsure_m[64] < 0.05


@pytest.mark.parametrize("still", [AT_REST, NEVER])
def test_a_slide_along_the_free_direction_is_seen_in_metres_a_second(
    still: NDArray[np.bool_],
) -> None:
    k = np.arange(POSES)
    slide = 0.03 * (k - 40).clip(0, 30)  # 0.3 m/s from 4 s to 7 s

    found = drift(along_x(slide), held(free=slice(38, 73)), still)

    assert found.seen_m[47:64] == pytest.approx(0.3, abs=0.03)
    assert found.seen_m[:34].max() < 0.03
    assert found.seen_m[77:].max() < 0.03


def test_a_jump_is_seen_although_surfaces_hold() -> None:
    jump = np.where(np.arange(POSES) >= 50, 0.15, 0.0)

    found = drift(along_x(jump), held())

    assert found.seen_m[46:54] == pytest.approx(0.15, abs=0.03)
    assert np.delete(found.seen_m, np.s_[43:57]).max() < 0.03


def test_without_surfaces_and_without_rest_nobody_can_tell() -> None:
    nothing = np.zeros((POSES, 3, 3))

    assert drift(trajectory(SECONDS), nothing, NEVER).unsure_m.min() > 0.3
    assert drift(trajectory(SECONDS), nothing).unsure_m[:12].max() < 0.02


def test_one_plane_by_chance_holds_nothing() -> None:
    weak, strong = held(), held()
    weak[:, 0, 0], strong[:, 0, 0] = 0.4, 0.6

    assert (
        drift(trajectory(SECONDS), weak).unsure_m[-1]
        > 2 * (drift(trajectory(SECONDS), strong).unsure_m[-1])
    )


def test_two_poses_are_enough() -> None:
    path = trajectory(0.1)
    still = np.zeros(2, dtype=np.bool_)

    found = measure_drift(path, held()[:2], still, inertial_steps(path, imu(1), still))

    assert found.seen_m.shape == found.unsure_m.shape == found.turn_rad.shape == (2,)
    assert found.seen_m.max() < 0.1
