"""What the recording claims of the walk: poses that drift as LiDAR odometry does.

Two random walks: of the place, which is off by ``drift_m_per_root_s`` times the root of the
seconds on each axis, and of the heading, by ``yaw_drift_deg_per_root_s`` times that root. A wrong
heading also bends whatever way is added from there on. Gravity keeps roll and pitch right.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.geometry.transforms import rotate
from civil_rgbd.simulator.spec import ScanSpec
from civil_rgbd.simulator.walk import START_NS, imu_poses, pose_stamps_ns, unit_twice
from civil_rgbd.simulator.waves import chain_turns, turn_about

_STEP_S: Final = 0.5  # between the random steps, which come about smoothly


def recorded_imu_poses(
    spec: ScanSpec,
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """Return the poses that the recording states: the true ones when the spec has no drift.

    Returns:
        stamps (P,) int64, 200 Hz; translations (P, 3) metres; quaternions (P, 4), xyzw:
        ``T_map_imu``, true at the first stamp.
    """
    stamps = pose_stamps_ns(spec)
    places, turns = imu_poses(spec, stamps)
    if not (spec.drift_m_per_root_s or spec.yaw_drift_deg_per_root_s):
        return stamps, places, turns
    rng = np.random.default_rng([spec.seed, 3])
    t_s = (stamps - START_NS) / 1e9
    walks = _random_walks(rng, t_s)
    yaw = walks[:, 3] * math.radians(spec.yaw_drift_deg_per_root_s)
    turned = turn_about(2, yaw)
    steps = rotate(turned[:-1], np.diff(places, axis=0))
    way = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])
    wrong = places[:1] + way + walks[:, :3] * spec.drift_m_per_root_s
    return stamps, wrong, unit_twice(chain_turns(turned, turns))


def _random_walks(rng: np.random.Generator, t_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return four random walks (N, 4) at (N,) seconds, each of variance t, from 0 at 0."""
    count = math.floor(float(t_s[-1]) / _STEP_S) + 2
    knots = np.zeros((count, 4))
    knots[1:] = np.cumsum(rng.standard_normal((count - 1, 4)) * math.sqrt(_STEP_S), axis=0)
    place = t_s / _STEP_S
    before = np.floor(place).astype(np.int64)
    u = (place - before)[:, np.newaxis]
    share = u * u * (3 - 2 * u)
    return knots[before] + share * (knots[before + 1] - knots[before])
