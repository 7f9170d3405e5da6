"""Short stretches of a recording, looked at instead of all of it: images, and points in the map."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.constants import NS_PER_S
from civil_rgbd.domain.recording import Recording
from civil_rgbd.domain.rig import Rig
from civil_rgbd.domain.scan import LidarScan
from civil_rgbd.errors import CivilRgbdError
from civil_rgbd.geometry.motion import move_points
from civil_rgbd.geometry.trajectory import Trajectory
from civil_rgbd.geometry.transforms import compose

STRETCH_NS: Final = NS_PER_S
_APART_NS: Final = 3 * NS_PER_S
_FEWEST, _MOST = 3, 14
_IMAGE_STEP_NS: Final = 80_000_000
_MAX_GAP_NS: Final = NS_PER_S // 4
_NEAREST_M, _FURTHEST_M = 0.5, 120.0
_POINTS_A_SCAN: Final = 24_000


@dataclass(frozen=True, slots=True, eq=False)
class Stretch:
    """About a second of a recording.

    Attributes:
        start_ns: its beginning, LiDAR clock.
        images: indices of some images in it, in order of their stamps, some 80 ms apart.
        points_map: (N, 3) float64 metres relative to the recording's first pose: those around it.
        stamps_ns: (N,) int64, of the points.
    """

    start_ns: int
    images: tuple[int, ...]
    points_map: NDArray[np.float64]
    stamps_ns: NDArray[np.int64]


class Posed(Protocol):
    """What says where the camera was: a recording, or what one might have said."""

    @property
    def rig(self) -> Rig:
        """How the sensors are mounted."""

    @property
    def trajectory(self) -> Trajectory:
        """``T_map_body``."""

    @property
    def image_stamps_ns(self) -> NDArray[np.int64]:
        """Stamp of each image, camera clock."""


@dataclass(frozen=True, slots=True, eq=False)
class Supposed:
    """A recording as if its rig were another.

    Attributes:
        rig: that is supposed.
        trajectory: of the recording.
        image_stamps_ns: likewise.
    """

    rig: Rig
    trajectory: Trajectory
    image_stamps_ns: NDArray[np.int64]


def image_stamps(recording: Posed) -> NDArray[np.int64]:
    """Return the images' stamps on the LiDAR's clock, as far as the rig knows it."""
    return recording.image_stamps_ns + recording.rig.camera_time_offset_ns


def stretch_starts(recording: Recording) -> tuple[int, ...]:
    """Choose where stretches begin, evenly over a recording with poses: ns, LiDAR clock."""
    stamps_ns = image_stamps(recording)
    trajectory = recording.trajectory
    first = max(int(stamps_ns.min()), trajectory.start_ns)
    last = min(int(stamps_ns.max()), trajectory.end_ns)
    if last <= first:
        return ()
    count = int(np.clip((last - first) // _APART_NS, _FEWEST, _MOST))
    room_ns = max(last - first - STRETCH_NS, 0)
    return tuple(np.linspace(first, first + room_ns, count).astype(np.int64).tolist())


def stretches_of(recording: Recording, starts: Iterable[int] | None = None) -> Iterator[Stretch]:
    """Read the points around each stretch, and choose its images.

    Args:
        recording: with poses.
        starts: of the stretches; by default all of :func:`stretch_starts`.

    Yields:
        in their order; stretches without images or without points are left out.
    """
    stamps_ns = image_stamps(recording)
    for start in stretch_starts(recording) if starts is None else starts:
        images = _images_in(stamps_ns, start)
        parts = list(_points_around(recording, start))
        if images and parts:
            points = np.concatenate([points for points, _ in parts])
            yield Stretch(start, images, points, np.concatenate([stamps for _, stamps in parts]))


def _images_in(stamps_ns: NDArray[np.int64], start_ns: int) -> tuple[int, ...]:
    order = np.argsort(stamps_ns, kind="stable")
    chosen: list[int] = []
    next_ns = start_ns
    for index in order[np.searchsorted(stamps_ns[order], start_ns) :].tolist():
        if stamps_ns[index] > start_ns + STRETCH_NS:
            break
        if stamps_ns[index] >= next_ns:
            chosen.append(index)
            next_ns = int(stamps_ns[index]) + _IMAGE_STEP_NS
    return tuple(chosen)


def _points_around(
    recording: Recording, start_ns: int
) -> Iterator[tuple[NDArray[np.float64], NDArray[np.int64]]]:
    stamps_ns, (early_ns, late_ns) = recording.scan_stamps_ns, recording.point_reach_ns
    late_ns = min(late_ns, NS_PER_S // 5)  # formats allow a second, sweeps take a tenth
    meets = (stamps_ns + late_ns >= start_ns - STRETCH_NS // 4) & (
        stamps_ns + early_ns <= start_ns + STRETCH_NS + STRETCH_NS // 4
    )
    for index in np.flatnonzero(meets).tolist():
        try:
            scan = recording.read_scan(index)
        except CivilRgbdError:
            continue  # counted where the rates are
        points, stamps = points_in_map(scan, recording.rig, recording.trajectory)
        if len(points):
            yield points, stamps


def points_in_map(
    scan: LidarScan, rig: Rig, trajectory: Trajectory
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Put the returns of a scan into the map, each by the pose at its own time.

    Args:
        scan: as recorded; of dense ones every second, third ... point is taken.
        rig: gives ``T_body_lidar``.
        trajectory: ``T_map_body``.

    Returns:
        (N, 3) float64 metres relative to the first pose, and their (N,) stamps.
    """
    step = max(1, len(scan.points) // _POINTS_A_SCAN)
    points = np.ascontiguousarray(scan.points[::step], dtype=np.float64)
    if scan.point_stamps_ns is None:
        stamps_ns = np.full(len(points), scan.stamp_ns, dtype=np.int64)
    else:
        stamps_ns = scan.point_stamps_ns[::step]
    range_m = np.sqrt((points**2).sum(axis=1))
    keep = np.isfinite(range_m) & trajectory.covers(stamps_ns, max_gap_ns=_MAX_GAP_NS)
    if not scan.in_map:
        keep &= (range_m > _NEAREST_M) & (range_m < _FURTHEST_M)
    if scan.noise is not None:
        keep &= ~scan.noise[::step]
    points, stamps_ns = points[keep], stamps_ns[keep]
    origin = trajectory.translations_m[0]
    if scan.in_map:
        return points - origin, stamps_ns
    order = np.argsort(stamps_ns, kind="stable")
    points, stamps_ns = points[order], stamps_ns[order]
    places, turns = trajectory.at(stamps_ns)
    moved = np.empty((3, len(points)), dtype=np.float32)
    move_points(points, rig.T_body_lidar, places, turns, origin, moved)
    return moved.T.astype(np.float64), stamps_ns


def camera_poses(recording: Posed, stamps_ns: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return ``T_map_camera`` (N, 4, 4), relative to the first pose; at the ends, the last one."""
    trajectory = recording.trajectory
    inside = np.clip(stamps_ns, trajectory.start_ns, trajectory.end_ns)
    T_map_camera = compose(trajectory.transforms_at(inside), recording.rig.T_body_camera)
    T_map_camera[:, :3, 3] -= trajectory.translations_m[0]
    return T_map_camera
