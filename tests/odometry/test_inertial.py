"""The IMU integrated from pose to pose, against motion known by formula."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from civil_rgbd.odometry.inertial import InertialSteps, inertial_steps

from .rides import GRAVITY, SECOND, imu, trajectory

BIAS = (0.004, -0.003, 0.006)


def steps(**biases: tuple[float, float, float]) -> InertialSteps:
    path = trajectory(5)
    return inertial_steps(path, imu(5, **biases), np.arange(51) <= 10)


def test_steps_are_those_of_the_ride() -> None:
    path, found = trajectory(5), steps()
    t = (np.arange(50) * 0.1 - 1.0).clip(min=0.0)
    v = np.stack([0.5 * (1 - np.cos(2 * t)), 0 * t, 0.06 * np.sin(6 * t)], axis=1)
    fall = np.array([0.0, 0.0, -GRAVITY])

    moved = v * 0.1 + found.moved_m + fall * 0.1**2 / 2
    gained = found.gained_m_s + fall * 0.1

    assert found.seconds == pytest.approx(0.1)
    assert moved == pytest.approx(np.diff(path.translations_m, axis=0), abs=1e-4)
    assert gained[:-1] == pytest.approx(np.diff(v, axis=0), abs=2e-3)
    assert np.abs(found.turn_off_rad).max() < 1e-3


def test_a_bias_of_the_forces_does_to_the_steps_what_they_say() -> None:
    true, biased = steps(), steps(force_bias=(0.1, -0.2, 0.3))
    b = np.array([0.1, -0.2, 0.3])

    assert biased.gained_m_s - biased.gained_by_bias @ b == pytest.approx(true.gained_m_s)
    assert biased.moved_m - biased.moved_by_bias @ b == pytest.approx(true.moved_m)
    assert true.moved_by_bias[0] == pytest.approx(np.eye(3) * 0.1**2 / 2)


def test_the_bias_of_the_gyroscope_is_seen_at_rest_or_else_from_the_poses() -> None:
    path, biased = trajectory(5), imu(5, rate_bias=BIAS)

    for still in (np.arange(51) <= 10, np.zeros(51, dtype=np.bool_)):
        assert np.abs(inertial_steps(path, biased, still).turn_off_rad).max() < 2e-3


def test_poses_that_turn_otherwise_than_the_gyroscope_are_off_by_that_much() -> None:
    path = trajectory(5)
    wrong = path.quaternions_xyzw.copy()
    wrong[30:] = path.quaternions_xyzw[30:] * [1, 1, -1, 1]  # turned the other way all at once

    found = inertial_steps(replace(path, quaternions_xyzw=wrong), imu(5), np.arange(51) <= 10)

    assert np.flatnonzero(np.abs(found.turn_off_rad).max(axis=1) > 0.05).tolist() == [29]


def test_steps_in_which_the_imu_is_silent_are_blind() -> None:
    whole = imu(5)
    kept = (whole.stamps_ns < whole.stamps_ns[0] + 2 * SECOND) | (
        whole.stamps_ns > whole.stamps_ns[0] + SECOND * 23 // 10
    )
    columns = (whole.stamps_ns[kept], whole.rates_rad_s[kept], whole.forces_m_s2[kept])
    holed = replace(whole, stamps_ns=columns[0], rates_rad_s=columns[1], forces_m_s2=columns[2])

    found = inertial_steps(trajectory(5), holed, np.arange(51) <= 10)

    assert np.flatnonzero(found.blind).tolist() == [19, 20, 21, 22, 23]
    assert not steps().blind.any()
