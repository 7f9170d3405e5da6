"""Motion by formula, with the IMU that belongs to it: rest for a second, then a winding ride."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.domain.motion import ImuReadings
from civil_rgbd.geometry.trajectory import Trajectory
from civil_rgbd.odometry.imu import SteadyImu, steady_imu

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
GRAVITY = 9.80665
FREE_X, HELD = np.diag([0.0, 20.0, 20.0]), np.diag([20.0, 20.0, 20.0])


def ridden(stamps_ns: NDArray[np.int64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return places (N, 3) and yaw (N,) at some instants."""
    t = ((stamps_ns - START) / SECOND - 1.0).clip(min=0.0)
    x, z = 0.5 * (t - np.sin(2 * t) / 2), 0.01 * (1 - np.cos(6 * t))
    return np.stack([x, np.zeros_like(x), z], axis=1), 0.2 * (1 - np.cos(t))


def trajectory(seconds: float) -> Trajectory:
    """Return the true poses, ten a second."""
    stamps = START + np.arange(round(seconds * 10) + 1, dtype=np.int64) * (SECOND // 10)
    places, yaw = ridden(stamps)
    turns = np.stack([0 * yaw, 0 * yaw, np.sin(yaw / 2), np.cos(yaw / 2)], axis=1)
    return Trajectory(stamps, places, turns)


def imu(
    seconds: float,
    *,
    rate_bias: tuple[float, float, float] = (0.0, 0.0, 0.0),
    force_bias: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> SteadyImu:
    """Return the readings, 200 a second, without noise."""
    stamps = START + np.arange(round(seconds * 200) + 1, dtype=np.int64) * (SECOND // 200)
    t = (stamps - START) / SECOND - 1.0
    moves, t = t > 0, t.clip(min=0.0)
    x, z = moves * np.sin(2 * t), moves * 0.36 * np.cos(6 * t) + GRAVITY
    _, yaw = ridden(stamps)
    forces = np.stack([np.cos(yaw) * x, -np.sin(yaw) * x, z], axis=1)
    rates = np.stack([0 * t, 0 * t, 0.2 * np.sin(t)], axis=1)
    readings = ImuReadings(stamps, rates + rate_bias, forces + force_bias, "imu")
    return steady_imu(readings, where="here")
