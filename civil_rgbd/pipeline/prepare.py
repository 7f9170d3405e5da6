"""One LiDAR message: filtered, ordered by time, and put into the map point by point."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, fields
from typing import Final

import numba
import numpy as np
from numpy.typing import NDArray

from civil_rgbd.constants import NS_PER_S
from civil_rgbd.domain.recipe import Recipe
from civil_rgbd.domain.rig import Rig
from civil_rgbd.domain.scan import LidarScan
from civil_rgbd.geometry.motion import move_points
from civil_rgbd.geometry.trajectory import Trajectory
from civil_rgbd.geometry.transforms import rotate

_ASKED_FOR: Final = "pose_quality_low"


@dataclass(frozen=True, slots=True)
class PointCounts:
    """What became of the points of one message, or of many.

    Attributes:
        read: points in the message.
        not_finite: NaN or infinite.
        no_return: (0, 0, 0), what a Livox says when nothing came back.
        out_of_range: nearer or further than the recipe allows.
        noise: doubted by the sensor itself.
        outside_trajectory: before its start, after its end, or in a gap of it.
        pose_quality_low: at a pose, or beside one, that is worse than the recipe allows.
        messages_unreadable: messages, not points, that are damaged and were left out.
    """

    read: int = 0
    not_finite: int = 0
    no_return: int = 0
    out_of_range: int = 0
    noise: int = 0
    outside_trajectory: int = 0
    pose_quality_low: int = 0
    messages_unreadable: int = 0


def total_points(counts: Iterable[PointCounts]) -> dict[str, int]:
    """Add up what became of the points of many messages, by field of :class:`PointCounts`.

    ``pose_quality_low`` is missing where it is 0: few recipes ask for a quality.
    """
    counts = list(counts)
    totals = {
        field.name: sum(getattr(count, field.name) for count in counts)
        for field in fields(PointCounts)
    }
    if not totals[_ASKED_FOR]:
        del totals[_ASKED_FOR]
    return totals


@dataclass(frozen=True, slots=True, eq=False)
class MappedScan:
    """The points of one message that count.

    Attributes:
        points_local: (3, N) float32, metres, relative to the recording's local origin: one row an
            axis, which is how they are rendered.
        stamps_ns: (N,) int64, ascending.
        counts: what became of the others.
    """

    points_local: NDArray[np.float32]
    stamps_ns: NDArray[np.int64]
    counts: PointCounts


def local_origin(trajectory: Trajectory) -> NDArray[np.float64]:
    """Return the translation of ``T_map_local``: the first pose in whole metres, (3,) float64.

    Points are kept in float32 relative to it, so that a map far from its origin (UTM) loses
    nothing.
    """
    origin: NDArray[np.float64] = np.floor(trajectory.translations_m[0] + 0.5) + 0.0  # no -0.0
    return origin


def map_scan(
    scan: LidarScan,
    *,
    trajectory: Trajectory,
    rig: Rig,
    recipe: Recipe,
    origin_map: NDArray[np.float64],
) -> MappedScan:
    """Filter a scan, order it by time, and move every point by the pose at its own time.

    Args:
        scan: as recorded.
        trajectory: ``T_map_body``.
        rig: gives ``T_body_lidar``.
        recipe: its stages ``filter``, ``poses`` and ``accumulate.deskew``.
        origin_map: (3,) from :func:`local_origin`.

    Returns:
        the points that count, in stable order of their stamps.
    """
    if scan.point_stamps_ns is None:
        stamps_ns = np.full(len(scan.points), scan.stamp_ns, dtype=np.int64)
    else:
        stamps_ns = scan.point_stamps_ns
    scanned = np.ascontiguousarray(scan.points)  # one layout: the kernels are compiled once
    fate = np.zeros(len(scanned), dtype=np.uint8)
    noise = scan.noise if scan.noise is not None and recipe.filter.drop_noise else _NO_NOISE
    limits = (recipe.filter.min_range_m, recipe.filter.max_range_m)
    # Ranges are seen from the sensor: of points that are in the map, only after its pose is known.
    _judge(scanned, noise, limits if not scan.in_map else (0.0, np.inf), fate)
    counts = _counted(fate)
    points, stamps_ns = _in_time_order(scanned, stamps_ns, fate == _COUNTS)

    points, stamps_ns, pose_stamps_ns = _inside(trajectory, scan, points, stamps_ns, recipe)
    counts["messages_unreadable"] = int(scan.unreadable)
    counts["outside_trajectory"] = (
        counts["read"] - sum(counts[reason] for reason in _FATES[1:]) - len(points)
    )
    inside = len(points)
    points, stamps_ns, pose_stamps_ns = _trusted(
        trajectory, recipe, points, stamps_ns, pose_stamps_ns
    )
    counts[_ASKED_FOR] = inside - len(points)
    translations, quaternions = trajectory.at(pose_stamps_ns)
    if scan.in_map:
        near = _in_range(points, translations, quaternions, rig=rig, limits=limits)
        counts["out_of_range"] += int((~near).sum())
        points, stamps_ns = points[near], stamps_ns[near]
        local = (points.astype(np.float64) - origin_map).T.astype(np.float32, order="C")
    else:
        local = np.empty((3, len(points)), dtype=np.float32)
        move_points(points, rig.T_body_lidar, translations, quaternions, origin_map, local)
    return MappedScan(points_local=local, stamps_ns=stamps_ns, counts=PointCounts(**counts))


_COUNTS = 0
_FATES = ("counts", "not_finite", "no_return", "noise", "out_of_range")
"""What :func:`_judge` may find of a point: the index is its mark, the first that fits is given."""

_NO_NOISE = np.zeros(0, dtype=np.bool_)


@numba.njit(cache=True)
def _judge(points, noise, limits, fate):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202  # a kernel: numba infers
    """Mark each point of (N, 3) with an index into ``_FATES``; ``noise`` may be empty."""
    for i in range(len(points)):
        x, y, z = np.float64(points[i, 0]), np.float64(points[i, 1]), np.float64(points[i, 2])
        range_m = math.sqrt(x * x + y * y + z * z)
        if not (math.isfinite(x) and math.isfinite(y) and math.isfinite(z)):
            fate[i] = 1
        elif x == 0.0 and y == 0.0 and z == 0.0:
            fate[i] = 2
        elif len(noise) and noise[i]:
            fate[i] = 3
        elif not limits[0] <= range_m <= limits[1]:
            fate[i] = 4


def _counted(fate: NDArray[np.uint8]) -> dict[str, int]:
    by_mark = np.bincount(fate, minlength=len(_FATES)).tolist()
    return {"read": len(fate)} | dict(zip(_FATES[1:], by_mark[1:], strict=True))


def _in_time_order(
    points: NDArray[np.floating], stamps_ns: NDArray[np.int64], kept: NDArray[np.bool_]
) -> tuple[NDArray[np.floating], NDArray[np.int64]]:
    points, stamps_ns = points[kept], stamps_ns[kept]
    if (stamps_ns[1:] < stamps_ns[:-1]).any():
        order = np.argsort(stamps_ns, kind="stable")
        return points[order], stamps_ns[order]
    return points, stamps_ns


def _inside(
    trajectory: Trajectory,
    scan: LidarScan,
    points: NDArray[np.floating],
    stamps_ns: NDArray[np.int64],
    recipe: Recipe,
) -> tuple[NDArray[np.floating], NDArray[np.int64], NDArray[np.int64]]:
    """Keep the points with a pose; return them, their stamps, and those of their poses (N or 1)."""
    gap_ns = round(recipe.poses.max_gap_s * NS_PER_S)
    if scan.point_stamps_ns is None or not recipe.accumulate.deskew:
        header_ns = np.array([scan.stamp_ns], dtype=np.int64)
        kept = slice(None) if trajectory.covers(header_ns, max_gap_ns=gap_ns)[0] else slice(0)
        return points[kept], stamps_ns[kept], header_ns[kept]
    if not len(stamps_ns) or trajectory.covers_span(
        int(stamps_ns[0]), int(stamps_ns[-1]), max_gap_ns=gap_ns
    ):
        return points, stamps_ns, stamps_ns
    covered = trajectory.covers(stamps_ns, max_gap_ns=gap_ns)
    return points[covered], stamps_ns[covered], stamps_ns[covered]


def _trusted(
    trajectory: Trajectory,
    recipe: Recipe,
    points: NDArray[np.floating],
    stamps_ns: NDArray[np.int64],
    pose_stamps_ns: NDArray[np.int64],
) -> tuple[NDArray[np.floating], NDArray[np.int64], NDArray[np.int64]]:
    """Keep the points whose pose is good enough; of a pose between two the worse one counts."""
    least = recipe.poses.min_quality
    if least <= 0 or trajectory.quality is None:  # a plan refuses to ask for what nobody judged
        return points, stamps_ns, pose_stamps_ns
    good = trajectory.quality_at(pose_stamps_ns) >= least
    if good.all():
        return points, stamps_ns, pose_stamps_ns
    of_points = np.broadcast_to(good, stamps_ns.shape)  # one pose may move all of them
    return points[of_points], stamps_ns[of_points], pose_stamps_ns[good]


def _in_range(
    points_map: NDArray[np.floating],
    translations: NDArray[np.float64],
    quaternions: NDArray[np.float64],
    *,
    rig: Rig,
    limits: tuple[float, float],
) -> NDArray[np.bool_]:
    """Tell the points of a registered cloud that lie in range of the sensor at their own time."""
    lever = rotate(quaternions, rig.T_body_lidar[np.newaxis, :3, 3])
    seen = points_map.astype(np.float64) - (translations + lever)
    range_m = np.sqrt(seen[:, 0] ** 2 + seen[:, 1] ** 2 + seen[:, 2] ** 2)
    within: NDArray[np.bool_] = (range_m >= limits[0]) & (range_m <= limits[1])
    return within
