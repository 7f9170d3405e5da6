"""How far poses drift over a second: what surfaces hold of the way, and what the IMU says of it.

An engine's own covariances stay at millimetres while it slides through a smooth tunnel. So the
velocity is estimated anew from what can be trusted: the engine's steps along the directions that
surfaces hold, rest where nothing moves, and the IMU in between, forwards and backwards in time (a
Kalman filter and the smoother of Rauch, Tung and Striebel 1965). Where the engine's steps differ
from it the engine drifts; where the estimate itself is uncertain, nobody can tell.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.geometry.trajectory import Trajectory
from civil_rgbd.odometry.imu import STANDARD_GRAVITY_M_S2
from civil_rgbd.odometry.inertial import InertialSteps

_Array = NDArray[np.float64]

# Of the steps, along a direction that one plane holds, and however many do.
_PLANE_M, _STEP_M = 0.01, 0.006
FEWEST_PLANES: Final = 0.5
"""Fewer oppose a slide only by chance: noise tilts the planes of a smooth tunnel a little."""
_RESTS_M_S: Final = 0.003
# Three times the noise of a BMI088's data sheet; and the slow tilt of an engine's map.
_IMU_NOISE, _TILT_NOISE, _BIAS_NOISE = 0.005, 0.0002, 0.0001
_BLIND_M_S2: Final = 1.0  # a walk's accelerations, where the IMU is silent
_STEADY_TURN_RAD: Final = 0.002  # the poses' turns are as noisy as this, step by step
_AT_FIRST: Final = (1.5, 0.05, 0.3)  # velocity m/s, bias m/s2, gravity m/s2
_ROUNDS, _OUTLIER = 3, 2.5
_UNKNOWN_M2: Final = 1e6
_HALF_WINDOW_S: Final = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class Drift:
    """How far off the poses are over a second around each.

    Attributes:
        seen_m: (P,) how far the engine's steps differ from the estimated ones.
        unsure_m: (P,) standard deviation of the estimate.
        turn_rad: (P,) how far the engine's turns differ from the gyroscope's.
    """

    seen_m: _Array
    unsure_m: _Array
    turn_rad: _Array


def measure_drift(
    trajectory: Trajectory,
    held: _Array,
    still: NDArray[np.bool_],
    steps: InertialSteps,
) -> Drift:
    """Compare poses with what surfaces and IMU together say of the way.

    Args:
        trajectory: ``T_map_imu``, two or more poses.
        held: (P, 3, 3) sum of n n^T over the normals of the planes that each pose's scan meets.
        still: (P,) bool, nothing moves.
        steps: the IMU between the poses.
    """
    moved = np.diff(trajectory.translations_m, axis=0)
    planes, axes = np.linalg.eigh(held[1:])
    opposed = np.where(planes > FEWEST_PLANES, planes, 0.0)
    variance = np.full(planes.shape, _UNKNOWN_M2)
    np.divide(_PLANE_M**2, opposed, out=variance, where=opposed > 0)
    variance += _STEP_M**2
    trust = np.ones(len(moved))
    for _ in range(_ROUNDS):
        states, covariances = _smoothed(moved, axes, variance * trust[:, np.newaxis], still, steps)
        off = moved - _predicted(states[:-1], steps)
        # Steps that jump although surfaces hold them weigh less: Huber's weights, axis by axis.
        unlikely = np.abs(np.einsum("kij,ki->kj", axes, off)) / np.sqrt(variance)
        trust = np.maximum(1.0, unlikely.max(axis=1) / _OUTLIER) ** 2
    largest = np.linalg.eigvalsh(covariances[:, :3, :3])[:, -1]
    return Drift(
        _over_a_second(off, steps.seconds),
        np.sqrt(largest.clip(min=0.0)),
        _over_a_second(steps.turn_off_rad, steps.seconds),
    )


def _predicted(states: _Array, steps: InertialSteps) -> _Array:
    v, b, g = states[:, :3], states[:, 3:6], states[:, 6:]
    dt = steps.seconds[:, np.newaxis]
    by_bias = (steps.moved_by_bias @ b[:, :, np.newaxis])[:, :, 0]
    predicted: _Array = v * dt + steps.moved_m - by_bias + g * dt**2 / 2
    return predicted


def _smoothed(
    moved: _Array,
    axes: _Array,
    variance: _Array,
    still: NDArray[np.bool_],
    steps: InertialSteps,
) -> tuple[_Array, _Array]:
    """Return states (P, 9), velocity, bias and gravity, and their covariances (P, 9, 9)."""
    count = len(still)
    x, covariance = _prior(steps)
    transition = np.tile(np.eye(9), (count - 1, 1, 1))
    transition[:, :3, 3:6] = -steps.gained_by_bias
    transition[:, :3, 6:] = np.eye(3) * steps.seconds[:, np.newaxis, np.newaxis]
    noise = _noise(steps)
    states, covariances = np.empty((count, 9)), np.empty((count, 9, 9))
    ahead, ahead_covariances = np.empty((count, 9)), np.empty((count, 9, 9))
    resting = np.eye(3, 9)
    for k in range(count):
        if still[k]:
            x, covariance = _seen(x, covariance, resting, np.zeros(3), np.full(3, _RESTS_M_S**2))
        if k < count - 1:
            dt = steps.seconds[k]
            way = np.hstack([np.eye(3) * dt, -steps.moved_by_bias[k], np.eye(3) * dt**2 / 2])
            seen = axes[k].T @ (moved[k] - steps.moved_m[k])
            x, covariance = _seen(x, covariance, axes[k].T @ way, seen, variance[k])
        states[k], covariances[k] = x, covariance
        if k < count - 1:
            x = transition[k] @ x
            x[:3] += steps.gained_m_s[k]
            covariance = transition[k] @ covariance @ transition[k].T + np.diag(noise[k])
            ahead[k], ahead_covariances[k] = x, covariance
    for k in range(count - 2, -1, -1):
        gain = covariances[k] @ transition[k].T @ np.linalg.inv(ahead_covariances[k])
        states[k] += gain @ (states[k + 1] - ahead[k])
        covariances[k] += gain @ (covariances[k + 1] - ahead_covariances[k]) @ gain.T
    return states, covariances


def _seen(
    x: _Array, covariance: _Array, model: _Array, value: _Array, variance: _Array
) -> tuple[_Array, _Array]:
    """Take in a measurement: ``value = model @ x`` with independent noise."""
    gain = np.linalg.solve(model @ covariance @ model.T + np.diag(variance), model @ covariance).T
    covariance = covariance - gain @ model @ covariance
    return x + gain @ (value - model @ x), (covariance + covariance.T) / 2


def _prior(steps: InertialSteps) -> tuple[_Array, _Array]:
    # Over a walk the mean force is what opposes gravity: the map need not be level.
    up = steps.gained_m_s.sum(axis=0)
    x = np.zeros(9)
    x[6:] = -up / max(float(np.sqrt((up**2).sum())), 1e-9) * STANDARD_GRAVITY_M_S2
    return x, np.diag(np.repeat(np.square(_AT_FIRST), 3))


def _noise(steps: InertialSteps) -> _Array:
    """Return the variances (P - 1, 9) that each step adds to the state."""
    dt = steps.seconds
    turn = np.sqrt((steps.turn_off_rad**2).sum(axis=1))
    # Poses that turn otherwise than the gyroscope point gravity elsewhere.
    tilt = STANDARD_GRAVITY_M_S2 * (turn - _STEADY_TURN_RAD).clip(min=0.0)
    blind = np.where(steps.blind, _BLIND_M_S2 * dt, 0.0)
    velocity = _IMU_NOISE**2 * dt + (tilt * dt) ** 2 + blind**2
    columns = [velocity, _BIAS_NOISE**2 * dt, _TILT_NOISE**2 * dt + tilt**2]
    return np.repeat(np.stack(columns, axis=1), 3, axis=1)


def _over_a_second(off: _Array, seconds: _Array) -> _Array:
    """Sum steps (P - 1, 3) over a window around each pose, per second: sizes (P,)."""
    total = np.vstack([np.zeros(3), np.cumsum(off, axis=0)])
    time = np.concatenate([[0.0], np.cumsum(seconds)])
    k = np.arange(len(time))
    # The first and the last second serve all poses in their outer halves.
    middle = time.clip(_HALF_WINDOW_S, max(time[-1] - _HALF_WINDOW_S, _HALF_WINDOW_S))
    # A tenth more, or rounding decides whether the pose half a second away counts; never fewer
    # than the poses next to it.
    reach = 1.1 * _HALF_WINDOW_S
    first = np.minimum(np.searchsorted(time, middle - reach), np.maximum(k - 1, 0))
    last = np.searchsorted(time, middle + reach, side="right") - 1
    last = np.maximum(last, np.minimum(k + 1, len(k) - 1))
    size = np.sqrt(((total[last] - total[first]) ** 2).sum(axis=1))
    rate: _Array = size / (time[last] - time[first])
    return rate
