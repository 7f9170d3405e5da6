"""What the IMU says of the way from each pose to the next, in the map that the poses turn it to."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.constants import NS_PER_S
from civil_rgbd.geometry.angles import quaternions_from_rotation_vectors
from civil_rgbd.geometry.trajectory import Trajectory
from civil_rgbd.geometry.transforms import matrix_from_quaternion
from civil_rgbd.odometry.imu import SteadyImu

_LARGEST_BIAS_RAD_S: Final = 0.03
"""A MEMS gyroscope's zero is good to one degree a second; what is larger are poses that spin."""
_FEWEST_STILL: Final = 5
_LONGEST_GAP_S: Final = 0.05


@dataclass(frozen=True, slots=True, eq=False)
class InertialSteps:
    """The IMU between P poses: P - 1 steps. Forces are specific: gravity is still in them.

    With v the velocity at a step's first pose, b the accelerometer's bias and g gravity::

        v_next = v + gained_m_s - gained_by_bias @ b + g * seconds
        moved  = v * seconds + moved_m - moved_by_bias @ b + g * seconds**2 / 2

    Attributes:
        seconds: (P - 1,).
        gained_m_s: (P - 1, 3) integral of the force, map frame.
        moved_m: (P - 1, 3) twice integrated.
        gained_by_bias: (P - 1, 3, 3) integral of the rotation, body to map.
        moved_by_bias: (P - 1, 3, 3) twice integrated.
        turn_off_rad: (P - 1, 3) rotation vectors: how the poses turn beyond the gyroscope.
        blind: (P - 1,) bool, the IMU has a gap there.
    """

    seconds: NDArray[np.float64]
    gained_m_s: NDArray[np.float64]
    moved_m: NDArray[np.float64]
    gained_by_bias: NDArray[np.float64]
    moved_by_bias: NDArray[np.float64]
    turn_off_rad: NDArray[np.float64]
    blind: NDArray[np.bool_]


def inertial_steps(
    trajectory: Trajectory, imu: SteadyImu, still: NDArray[np.bool_]
) -> InertialSteps:
    """Integrate the IMU from pose to pose.

    Args:
        trajectory: two or more poses; it says which way the IMU looks.
        imu: its readings.
        still: (P,) bool, poses at which nothing turns: the gyroscope's bias is seen there.
    """
    poses = trajectory.stamps_ns
    inside = (imu.stamps_ns > poses[0]) & (imu.stamps_ns < poses[-1])
    stamps = np.union1d(imu.stamps_ns[inside], poses)
    instants_s, readings_s = ((of - poses[0]) / NS_PER_S for of in (stamps, imu.stamps_ns))
    force, rate = (
        np.stack([np.interp(instants_s, readings_s, column) for column in of.T], axis=1)
        for of in (imu.forces_m_s2, imu.rates_rad_s)
    )
    R = matrix_from_quaternion(trajectory.at(stamps)[1])
    accelerated = _between((R @ force[:, :, np.newaxis])[:, :, 0])
    turned = _between(R)
    dt = np.diff(instants_s)
    starts = np.searchsorted(stamps, poses[:-1])
    step = np.searchsorted(poses, stamps[:-1], side="right") - 1
    until_end_s = (poses[step + 1] - stamps[:-1]) / NS_PER_S - dt / 2

    def total(values: NDArray[np.float64], weights: NDArray[np.float64]) -> NDArray[np.float64]:
        shape = (-1,) + (1,) * (values.ndim - 1)
        summed: NDArray[np.float64] = np.add.reduceat(values * weights.reshape(shape), starts)
        return summed

    seconds = np.diff(poses) / NS_PER_S
    R_poses = R[np.searchsorted(stamps, poses)]
    by_poses = np.swapaxes(R_poses[:-1], 1, 2) @ R_poses[1:]
    steady = (still[:-1] & still[1:])[step]
    rates = _between(rate)
    bias = _bias(rates, dt, step, by_poses, steady)
    by_gyroscope = _chained((rates - bias) * dt[:, np.newaxis], step, len(seconds))
    return InertialSteps(
        seconds,
        total(accelerated, dt),
        total(accelerated, dt * until_end_s),
        total(turned, dt),
        total(turned, dt * until_end_s),
        _rotation_vectors(np.swapaxes(by_gyroscope, 1, 2) @ by_poses),
        _gaps(imu.stamps_ns, poses),
    )


def _between(values: NDArray[np.float64]) -> NDArray[np.float64]:
    middle: NDArray[np.float64] = (values[1:] + values[:-1]) / 2
    return middle


def _bias(
    rates_rad_s: NDArray[np.float64],
    dt: NDArray[np.float64],
    step: NDArray[np.intp],
    by_poses: NDArray[np.float64],
    steady: NDArray[np.bool_],
) -> NDArray[np.float64]:
    """Return the gyroscope's bias (3,), seen at rest or else from how the poses turn."""
    if steady.sum() > _FEWEST_STILL:
        # Not the mean: rest is noticed to have ended a moment after it has.
        bias: NDArray[np.float64] = np.median(rates_rad_s[steady], axis=0)
        return bias
    by_gyroscope = _chained(rates_rad_s * dt[:, np.newaxis], step, len(by_poses))
    off = _rotation_vectors(np.swapaxes(by_poses, 1, 2) @ by_gyroscope)
    seconds = np.bincount(step, dt)
    bias = np.median(off / seconds[:, np.newaxis], axis=0)
    return bias if np.abs(bias).max() < _LARGEST_BIAS_RAD_S else np.zeros(3)


def _chained(
    vectors_rad: NDArray[np.float64], step: NDArray[np.intp], count: int
) -> NDArray[np.float64]:
    """Chain small turns (M, 3) that follow each other in each of some steps: (count, 3, 3)."""
    turns = matrix_from_quaternion(quaternions_from_rotation_vectors(vectors_rad))
    first = np.searchsorted(step, np.arange(count))
    last = np.searchsorted(step, np.arange(count), side="right")
    chained = np.tile(np.eye(3), (count, 1, 1))
    for k in range(int((last - first).max())):
        on = np.flatnonzero(first + k < last)
        chained[on] = chained[on] @ turns[first[on] + k]
    return chained


def _rotation_vectors(R: NDArray[np.float64]) -> NDArray[np.float64]:
    """Turn rotation matrices (K, 3, 3) into rotation vectors (K, 3), radians."""
    angle = np.arccos(((np.trace(R, axis1=1, axis2=2) - 1) / 2).clip(-1.0, 1.0))
    axis = np.stack([R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]], 1)
    sine = np.sin(angle)
    # Half a turn between two poses leaves no axis, and is no walk: any axis will do.
    size = np.where(sine > 1e-9, angle / np.maximum(sine, 1e-9), 1.0)
    vectors: NDArray[np.float64] = axis / 2 * size[:, np.newaxis]
    return vectors


def _gaps(readings_ns: NDArray[np.int64], poses_ns: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Tell in which steps the IMU is silent for long, or not there at all: (P - 1,) bool."""
    long = np.flatnonzero(np.diff(readings_ns) > round(_LONGEST_GAP_S * NS_PER_S))
    blind: NDArray[np.bool_] = (poses_ns[:-1] < readings_ns[0]) | (poses_ns[1:] > readings_ns[-1])
    for k in long.tolist():
        blind |= (poses_ns[1:] > readings_ns[k]) & (poses_ns[:-1] < readings_ns[k + 1])
    return blind
