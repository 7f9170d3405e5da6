"""When nothing moves: what the IMU alone says, and what the poses say to it."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.constants import NS_PER_S
from civil_rgbd.odometry.imu import SteadyImu

_REST_S: Final = 0.5
_STILL_M_S, _STILL_RAD_S, _REST_FORCE_M_S2 = 0.08, 0.05, 0.05
_FEWEST_READINGS: Final = 10
_STANDS_FORCE_M_S2, _STANDS_RAD_S = 0.4, 0.15  # of a person who stands, the sensor in the hand
_HELD_WELL: Final = 3.0  # planes that oppose a slide: enough to believe a pose rather than the IMU


def begins_in_motion(imu: SteadyImu) -> bool:
    """Tell whether the first half second is no standing: an engine starts as if it were."""
    first = imu.stamps_ns < imu.stamps_ns[0] + round(_REST_S * NS_PER_S)
    shakes = float(imu.forces_m_s2[first].std(axis=0).max())
    turns = float(np.abs(imu.rates_rad_s[first].mean(axis=0)).max())
    return shakes > _STANDS_FORCE_M_S2 or turns > _STANDS_RAD_S


def still_poses(
    imu: SteadyImu,
    stamps_ns: NDArray[np.int64],
    velocities_m_s: NDArray[np.float64],
    turns_rad_s: NDArray[np.float64],
    held: NDArray[np.float64],
) -> NDArray[np.bool_]:
    """Tell at which poses nothing moves: the IMU rests, and the poses do not deny it.

    An IMU rests on a smooth ride too, so the poses have to agree. Not so at the beginning, where an
    engine may slide before it has found its feet: there only poses that surfaces hold can deny it.

    Args:
        imu: whose readings are quiet at rest.
        stamps_ns: (P,) of the poses.
        velocities_m_s: (P, 3) of the poses, map frame.
        turns_rad_s: (P,) how fast the poses turn.
        held: (P, 3, 3) sum of n n^T over the planes that hold each pose.

    Returns:
        (P,) bool.
    """
    rests = _imu_rests(imu, stamps_ns)
    slow = np.sqrt((velocities_m_s**2).sum(axis=1)) < _STILL_M_S
    still: NDArray[np.bool_] = rests & slow & (turns_rad_s < _STILL_RAD_S)
    moves = np.flatnonzero(~rests[1:])  # the first pose may lie too early to tell
    first = int(moves[0]) + 1 if len(moves) else len(rests)
    planes, axes = np.linalg.eigh(held[:first])
    along = np.abs(np.einsum("kij,ki->kj", axes, velocities_m_s[:first]))
    well = planes > _HELD_WELL
    well[: first // 2] = False  # what moves at first and then no longer is an engine that settles
    fastest = np.where(well, along, 0.0).max(axis=1)[well.any(axis=1)]
    denied = bool(len(fastest)) and float(np.median(fastest)) > _STILL_M_S
    if first > 1 and not denied and not begins_in_motion(imu):
        still[:first] = True
    return still


def _imu_rests(imu: SteadyImu, stamps_ns: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Tell for each instant whether the half second before it was without motion: (P,) bool."""
    first = np.searchsorted(imu.stamps_ns, stamps_ns - round(_REST_S * NS_PER_S))
    last = np.searchsorted(imu.stamps_ns, stamps_ns, side="right")
    rests = np.zeros(len(stamps_ns), dtype=np.bool_)
    for k, (a, b) in enumerate(zip(first.tolist(), last.tolist(), strict=True)):
        if b - a >= _FEWEST_READINGS:
            force, rate = imu.forces_m_s2[a:b], imu.rates_rad_s[a:b]
            rests[k] = (
                force.std(axis=0).max() < _REST_FORCE_M_S2
                and np.abs(rate.mean(axis=0)).max() < _STILL_RAD_S
            )
    return rests
