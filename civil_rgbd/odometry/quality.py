"""How far each pose can be trusted: how far it may drift, how well it fits, how fast it moves."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.constants import NS_PER_S
from civil_rgbd.domain.motion import MotionRecording
from civil_rgbd.domain.scan import LidarScan
from civil_rgbd.geometry.trajectory import Trajectory
from civil_rgbd.geometry.transforms import rotate, transform_points
from civil_rgbd.odometry.drift import Drift, measure_drift
from civil_rgbd.odometry.imu import SteadyImu
from civil_rgbd.odometry.inertial import inertial_steps
from civil_rgbd.odometry.input_bag import returns
from civil_rgbd.odometry.rest import begins_in_motion, still_poses
from civil_rgbd.odometry.surfaces import Cells, Planes, cells_of, keys_of, merged, planes_of

Progress = Callable[[int, int], object]
"""Called with scans newly judged and scans in all."""

_BLOCKS, _BLOCK_SCANS = 5, 10  # a scan is held against itself and the five to six seconds before
_RANGE_M: Final = (0.5, 150.0)
DRIFT_OF_ONE_M, TURN_OF_ONE_RAD = 0.04, 0.006  # over a second, of a pose with quality 1
_SETTLES_S: Final = 1.5
_BELIEVED: Final = 0.5  # of the standard deviation: it came out some three times too large
_BEST: Final = 10.0


@dataclass(frozen=True, slots=True, eq=False)
class PoseMeasures:
    """What was measured at each pose.

    Attributes:
        stamps_ns: (P,) int64 of the poses.
        held_by: (P, 3) eigenvalues, ascending, of the sum of n n^T over the normals n of the planes
            that the scan meets: how many planes oppose a slide in the direction that is held
            worst, and in the two others. A smooth tunnel has one 0, a plain soffit two.
        residual_m: (P,) median distance of the scan's points from those planes; NaN without any.
        overlap: (P,) share of the scan's points that meet a plane.
        speed_m_s: (P,) from the pose before.
        turn_rad_s: (P,) from the pose before.
        drift_m: (P,) how far the pose may be off over the second around it: what is seen of that
            and what nobody can tell, together.
        drift_rad: (P,) how far it turns otherwise than the gyroscope over that second.
        settling: (P,) bool, the first moments of a recording that begins in motion: an engine
            takes gravity and velocity from them as if it stood. Only to say so.
    """

    stamps_ns: NDArray[np.int64]
    held_by: NDArray[np.float64]
    residual_m: NDArray[np.float64]
    overlap: NDArray[np.float64]
    speed_m_s: NDArray[np.float64]
    turn_rad_s: NDArray[np.float64]
    drift_m: NDArray[np.float64]
    drift_rad: NDArray[np.float64]
    settling: NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Limits:
    """What a hand-held walk does not exceed.

    Attributes:
        speed_m_s: faster poses have quality 0.
        turn_rad_s: faster turning poses have quality 0.
        residual_m: the quality of poses that fit worse is scaled down by the ratio.
    """

    speed_m_s: float = 4.0
    turn_rad_s: float = 4.0
    residual_m: float = 0.05


LOW_QUALITY: Final = 0.5
"""Poses below this cannot be trusted: they may drift by 8 cm or 0.7 degrees over a second. Set on
scenes other than the ones it is scored on."""


def measure_poses(
    recording: MotionRecording,
    trajectory: Trajectory,
    scan_indices: NDArray[np.int64],
    *,
    T_imu_lidar: NDArray[np.float64],
    imu: SteadyImu,
    on_progress: Progress = lambda _done, _total: None,
) -> PoseMeasures:
    """Measure what can be seen of the poses' quality without knowing the truth.

    Args:
        recording: its scans.
        trajectory: ``T_map_imu``.
        scan_indices: (P,) the scan that each pose belongs to.
        T_imu_lidar: (4, 4).
        imu: tells when nothing moves.
        on_progress: called scan by scan.
    """
    count = len(scan_indices)
    held, residual, overlap = np.zeros((count, 3, 3)), np.full(count, np.nan), np.zeros(count)
    recent = _RecentMap()
    for k, index in enumerate(scan_indices.tolist()):
        points = points_in_map(recording.read_scan(index), trajectory, T_imu_lidar)
        recent.add(cells_of(points))
        held[k], residual[k], overlap[k] = _against(points, recent.planes())
        on_progress(1, count)
    if count > 1:
        # The first scan lies before the first pose, so nothing of it is in the map.
        held[0], residual[0], overlap[0] = held[1], residual[1], overlap[1]
    velocity, turn = _motion(trajectory)
    drift = _drift(trajectory, held, velocity, turn, imu)
    stamps = trajectory.stamps_ns
    at_first = stamps - stamps[0] < round(_SETTLES_S * NS_PER_S)
    return PoseMeasures(
        stamps_ns=stamps,
        held_by=np.linalg.eigvalsh(held).clip(min=0.0),
        residual_m=residual,
        overlap=overlap,
        speed_m_s=np.sqrt((velocity**2).sum(axis=1)),
        turn_rad_s=turn,
        drift_m=np.hypot(drift.seen_m, _BELIEVED * drift.unsure_m),
        drift_rad=drift.turn_rad,
        settling=at_first & begins_in_motion(imu),
    )


def quality_of(measures: PoseMeasures, limits: Limits | None = None) -> NDArray[np.float64]:
    """Turn measures into one number a pose: larger is better, 0 is worthless.

    It is 4 cm over the drift to expect in a second, or 0.34 degrees over the turn, whichever is
    less. A pose that fits badly counts less, one that moves as nobody walks counts nothing.

    Args:
        measures: of all poses.
        limits: of speed and fit; None are those of a walk.

    Returns:
        (P,) float64, at most 10.
    """
    limits = limits or Limits()
    shares = measures.drift_m / DRIFT_OF_ONE_M, measures.drift_rad / TURN_OF_ONE_RAD
    quality = 1 / np.maximum(np.maximum(*shares), 1 / _BEST)
    fits = np.nan_to_num(limits.residual_m / np.maximum(measures.residual_m, 1e-9), nan=1.0)
    possible = (measures.speed_m_s <= limits.speed_m_s) & (measures.turn_rad_s <= limits.turn_rad_s)
    judged: NDArray[np.float64] = np.where(possible, quality * fits.clip(max=1.0), 0.0)
    return judged


def _drift(
    trajectory: Trajectory,
    held: NDArray[np.float64],
    velocities_m_s: NDArray[np.float64],
    turns_rad_s: NDArray[np.float64],
    imu: SteadyImu,
) -> Drift:
    stamps = trajectory.stamps_ns
    if len(stamps) < 2:
        unknown = np.full(len(stamps), np.inf)  # a single pose goes nowhere that could be judged
        return Drift(unknown, unknown, unknown)
    still = still_poses(imu, stamps, velocities_m_s, turns_rad_s, held)
    return measure_drift(trajectory, held, still, inertial_steps(trajectory, imu, still))


class _RecentMap:
    """The last scans, summed cell by cell; older sums are kept in blocks, to add up fewer."""

    def __init__(self) -> None:
        self._blocks: deque[Cells] = deque(maxlen=_BLOCKS)
        self._open: list[Cells] = []

    def add(self, cells: Cells) -> None:
        self._open.append(cells)
        if len(self._open) == _BLOCK_SCANS:
            self._blocks.append(merged(self._open))
            self._open = []

    def planes(self) -> Planes:
        return planes_of(merged([*self._blocks, *self._open]))


def points_in_map(
    scan: LidarScan, trajectory: Trajectory, T_imu_lidar: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Move a scan's returns to the map, each by the pose at its own time: (N, 3) float64.

    Returns outside of the trajectory stay out.
    """
    stamps = scan.point_stamps_ns
    if stamps is None:
        stamps = np.full(len(scan.points), scan.stamp_ns, dtype=np.int64)
    keep = returns(scan) & (stamps >= trajectory.start_ns) & (stamps <= trajectory.end_ns)
    points = scan.points[keep].astype(np.float64)
    ranges = np.sqrt((points**2).sum(axis=1))
    near = (ranges >= _RANGE_M[0]) & (ranges <= _RANGE_M[1])
    translations, turns = trajectory.at(stamps[keep][near])
    return rotate(turns, transform_points(T_imu_lidar, points[near])) + translations


def held_by_planes(normals: NDArray[np.float64], doubt: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the sum of n n^T over unit normals.

    Args:
        normals: (K, 3).
        doubt: (K,) variance of their directions, rad^2; what it adds is taken off.

    Returns:
        (3, 3) symmetric. Its eigenvalues say how many planes oppose a slide along its axes.

    >>> held_by_planes(np.eye(3)[[0, 0, 1]], np.zeros(3)).diagonal().tolist()
    [2.0, 1.0, 0.0]
    """
    held: NDArray[np.float64] = normals.T @ normals - doubt.sum() * np.eye(3)
    return held


def _against(
    points_map: NDArray[np.float64], planes: Planes
) -> tuple[NDArray[np.float64], float, float]:
    if not len(points_map) or not len(planes.keys):
        return np.zeros((3, 3)), np.nan, 0.0
    keys = keys_of(points_map)
    at = np.minimum(np.searchsorted(planes.keys, keys), len(planes.keys) - 1)
    met = planes.keys[at] == keys
    if not met.any():
        return np.zeros((3, 3)), np.nan, 0.0
    off = ((points_map[met] - planes.middles_m[at[met]]) * planes.normals[at[met]]).sum(axis=1)
    hit = np.unique(at[met])
    held_by = held_by_planes(planes.normals[hit], planes.doubt[hit])
    return held_by, float(np.median(np.abs(off))), float(met.mean())


def _motion(trajectory: Trajectory) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return velocity (P, 3) and turn rate, from the pose before; the first's from the next."""
    if len(trajectory.stamps_ns) < 2:
        return np.zeros((1, 3)), np.zeros(1)
    step_s = np.diff(trajectory.stamps_ns) / NS_PER_S
    q = trajectory.quaternions_xyzw
    half = np.abs((q[1:] * q[:-1]).sum(axis=1)).clip(max=1.0)
    velocity = np.diff(trajectory.translations_m, axis=0) / step_s[:, np.newaxis]
    turn = 2 * np.arccos(half) / step_s
    return np.concatenate([velocity[:1], velocity]), np.concatenate([turn[:1], turn])
