"""When nothing moves: rest by the IMU, unless poses that surfaces hold deny it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from civil_rgbd.odometry.rest import begins_in_motion, still_poses

from .rides import FREE_X, HELD, SECOND, START, imu

STAMPS = START + np.arange(31, dtype=np.int64) * (SECOND // 10)


def still(speed_m_s: float, held: NDArray[np.float64]) -> NDArray[np.bool_]:
    velocities = np.tile([speed_m_s, 0.0, 0.0], (31, 1))
    return still_poses(imu(3), STAMPS, velocities, np.zeros(31), np.tile(held, (31, 1, 1)))


@pytest.mark.parametrize("held", [HELD, FREE_X, np.zeros((3, 3))])
def test_the_imu_rests_for_the_first_second(held: NDArray[np.float64]) -> None:
    assert np.flatnonzero(~still(0.0, held))[0] in {11, 12}


def test_at_first_poses_that_slide_along_a_free_direction_are_not_believed() -> None:
    assert still(0.5, FREE_X)[:11].all()


def test_poses_that_surfaces_hold_deny_rest() -> None:
    assert not still(0.5, HELD).any()


def test_an_engine_that_settles_during_the_rest_does_not_deny_it() -> None:
    velocities = np.zeros((31, 3))
    velocities[:5, 0] = 1.0
    held = np.tile(HELD, (31, 1, 1))

    assert still_poses(imu(3), STAMPS, velocities, np.zeros(31), held)[:11].all()


def test_later_rest_asks_the_poses_too() -> None:
    readings = imu(8)
    forces = readings.forces_m_s2.copy()
    forces[1000:] = forces[0]  # quiet again after five seconds
    rates = readings.rates_rad_s.copy()
    rates[1000:] = 0.0
    quiet = replace(readings, forces_m_s2=forces, rates_rad_s=rates)
    stamps = START + np.arange(80, dtype=np.int64) * (SECOND // 10)
    nothing_holds = np.zeros((80, 3, 3))

    def asked(speed_m_s: float, turn_rad_s: float) -> NDArray[np.bool_]:
        velocities = np.tile([0.0, speed_m_s, 0.0], (80, 1))
        return still_poses(quiet, stamps, velocities, np.full(80, turn_rad_s), nothing_holds)

    assert asked(0.02, 0.01)[60:].all()
    assert not asked(0.2, 0.01)[60:].any()
    assert not asked(0.02, 0.2)[60:].any()


def test_a_start_that_shakes_is_a_start_in_motion() -> None:
    readings = imu(3)
    shaken = readings.forces_m_s2.copy()
    shaken[::2, 2] += 1.0

    assert begins_in_motion(replace(readings, forces_m_s2=shaken))
    assert not begins_in_motion(readings)
