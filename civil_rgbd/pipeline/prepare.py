"""One LiDAR message: filtered, ordered by time, and put into the map point by point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.constants import NS_PER_S
from civil_rgbd.domain.recipe import Recipe
from civil_rgbd.domain.rig import Rig
from civil_rgbd.domain.scan import LidarScan
from civil_rgbd.geometry.trajectory import Trajectory
from civil_rgbd.geometry.transforms import rotate, transform_points


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
    """

    read: int = 0
    not_finite: int = 0
    no_return: int = 0
    out_of_range: int = 0
    noise: int = 0
    outside_trajectory: int = 0


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
    usable, counts = _sort_out(scan, recipe, returns_from=None if scan.in_map else scan.points)
    points, stamps_ns = scan.points[usable], stamps_ns[usable]
    if (np.diff(stamps_ns) < 0).any():
        order = np.argsort(stamps_ns, kind="stable")
        points, stamps_ns = points[order], stamps_ns[order]

    pose_stamps_ns = _pose_stamps(scan, stamps_ns, deskew=recipe.accumulate.deskew)
    covered = trajectory.covers(pose_stamps_ns, max_gap_ns=_gap_ns(recipe))
    covered_points = np.broadcast_to(covered, stamps_ns.shape)
    outside = int((~covered_points).sum())
    points, stamps_ns = points[covered_points], stamps_ns[covered_points]
    if len(pose_stamps_ns) > 1:
        pose_stamps_ns = pose_stamps_ns[covered]
    in_range = np.zeros(0, dtype=np.bool_)
    local = np.zeros((0, 3))
    if len(points):
        translations, quaternions = trajectory.at(pose_stamps_ns)
        if len(pose_stamps_ns) == 1:
            quaternions = quaternions[0]
        if scan.in_map:
            local = points.astype(np.float64) - origin_map
            # The sensor stands where the pose says; its returns are measured from there.
            lever = rotate(quaternions, np.broadcast_to(rig.T_body_lidar[:3, 3], points.shape))
            in_range = _within(local - (lever + (translations - origin_map)), recipe)
            local, stamps_ns = local[in_range], stamps_ns[in_range]
        else:
            points_body = transform_points(rig.T_body_lidar, points)
            local = rotate(quaternions, points_body) + (translations - origin_map)
    return MappedScan(
        points_local=np.ascontiguousarray(local.T, dtype=np.float32),
        stamps_ns=stamps_ns,
        counts=PointCounts(
            **counts
            | {"outside_trajectory": outside}
            | ({"out_of_range": int((~in_range).sum())} if scan.in_map else {})
        ),
    )


def _sort_out(
    scan: LidarScan, recipe: Recipe, *, returns_from: NDArray[np.floating] | None
) -> tuple[NDArray[np.bool_], dict[str, int]]:
    """Tell the points that count from the others; a point is counted for its first fault."""
    x, y, z = scan.points.T
    usable = np.isfinite(x) & np.isfinite(y) & np.isfinite(z)
    counts = {"read": len(usable), "not_finite": int((~usable).sum())}
    faults = [("no_return", (x == 0) & (y == 0) & (z == 0))]
    if scan.noise is not None and recipe.filter.drop_noise:
        faults.append(("noise", scan.noise))
    if returns_from is not None:
        faults.append(("out_of_range", ~_within(returns_from, recipe)))
    for name, fault in faults:
        counts[name] = int((usable & fault).sum())
        usable &= ~fault
    return usable, counts


def _within(points_lidar: NDArray[np.floating], recipe: Recipe) -> NDArray[np.bool_]:
    x, y, z = (points_lidar[:, axis].astype(np.float64) for axis in range(3))
    with np.errstate(invalid="ignore", over="ignore"):  # points that are not finite were counted
        range_m = np.sqrt(x * x + y * y + z * z)
        within: NDArray[np.bool_] = (range_m >= recipe.filter.min_range_m) & (
            range_m <= recipe.filter.max_range_m
        )
    return within


def _pose_stamps(
    scan: LidarScan, stamps_ns: NDArray[np.int64], *, deskew: bool
) -> NDArray[np.int64]:
    """The instants whose poses move the points: one each, or one for all."""
    if deskew and scan.point_stamps_ns is not None:
        return stamps_ns
    return np.array([scan.stamp_ns], dtype=np.int64)


def _gap_ns(recipe: Recipe) -> int:
    return round(recipe.poses.max_gap_s * NS_PER_S)
