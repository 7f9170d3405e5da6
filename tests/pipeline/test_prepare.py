"""One message into the map: filters, order, trajectory, de-skew; numbers by hand."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from numpy.typing import NDArray

from civil_rgbd.domain.recipe import AccumulateStage, FilterStage, PosesStage, Recipe
from civil_rgbd.domain.rig import Rig
from civil_rgbd.domain.scan import LidarScan
from civil_rgbd.geometry.camera import LensCamera, PinholeCamera
from civil_rgbd.geometry.trajectory import Trajectory
from civil_rgbd.pipeline.prepare import (
    MappedScan,
    PointCounts,
    local_origin,
    map_scan,
    total_points,
)

from ..recordings import standing_still, trajectory_of
from ..reference.pose import pose_at
from ..strategies import rigid_transforms, seeds

MS = 10**6
SECOND = 10**9
CAMERA = LensCamera(PinholeCamera(8, 6, 8.0, 8.0, 3.5, 2.5))
MOUNTED_STRAIGHT = Rig(CAMERA, np.eye(4), np.eye(4))
RECIPE = Recipe("test", filter=FilterStage(min_range_m=1.0, max_range_m=100.0))


def mapped(
    scan: LidarScan,
    *,
    trajectory: Trajectory | None = None,
    rig: Rig = MOUNTED_STRAIGHT,
    recipe: Recipe = RECIPE,
) -> MappedScan:
    trajectory = trajectory or standing_still()
    return map_scan(
        scan,
        trajectory=trajectory,
        rig=rig,
        recipe=recipe,
        origin_map=local_origin(trajectory),
    )


def scan_of(
    *points: tuple[float, float, float],
    stamps_ns: list[int] | None = None,
    dtype: type[np.floating] = np.float32,
    **other: object,
) -> LidarScan:
    return LidarScan(
        stamp_ns=SECOND,
        points=np.array(points, dtype=dtype).reshape(-1, 3),
        point_stamps_ns=None if stamps_ns is None else np.array(stamps_ns, dtype=np.int64),
        **other,  # type: ignore[arg-type]  # noise, in_map
    )


# --- filters ----------------------------------------------------------------------------------


def test_every_point_is_kept_or_counted_for_its_first_fault() -> None:
    scan = scan_of(
        (5, 0, 0),
        (math.nan, 0, 0),
        (0, math.inf, 0),
        (0, 0, 0),
        (-0.0, 0, 0),
        (0.9, 0, 0),
        (0, 0, 100.1),
        (0, 6, 0),
        (math.nan, 0, 0),
        (0, 0, 0),
        noise=np.array([False] * 7 + [True] * 3),
    )

    found = mapped(scan)

    assert found.points_local.tolist() == [[5], [0], [0]]
    assert found.counts == PointCounts(
        read=10, not_finite=3, no_return=3, noise=1, out_of_range=2, outside_trajectory=0
    )


def test_noise_is_kept_when_the_recipe_says_so() -> None:
    scan = scan_of((5, 0, 0), (6, 0, 0), noise=np.array([True, False]))
    lenient = replace(RECIPE, filter=replace(RECIPE.filter, drop_noise=False))

    assert mapped(scan).points_local[0].tolist() == [6]
    assert mapped(scan, recipe=lenient).points_local[0].tolist() == [5, 6]
    assert mapped(scan, recipe=lenient).counts.noise == 0


def test_the_range_is_euclidean_and_inclusive() -> None:
    scan = scan_of((0.6, 0, 0.8), (60, -80, 0), (0.5, 0, 0.8), (60, 80, 10), dtype=np.float64)

    found = mapped(scan)

    # sqrt(0.36 + 0.64) = 1 and sqrt(3600 + 6400) = 100, the limits themselves.
    assert found.points_local.shape == (3, 2)
    assert found.counts.out_of_range == 2


def test_the_range_is_measured_from_the_lidar_not_from_the_body() -> None:
    T_body_lidar = np.eye(4)
    T_body_lidar[0, 3] = 10.0

    found = mapped(scan_of((-9.5, 0, 0), (0.5, 0, 0)), rig=Rig(CAMERA, np.eye(4), T_body_lidar))

    assert found.points_local[0].tolist() == [0.5]  # 9.5 m from the LiDAR, 0.5 m from the body


def test_a_point_too_large_for_its_square_is_out_of_range_and_warns_of_nothing() -> None:
    assert mapped(scan_of((3e38, 3e38, 0), (5, 0, 0))).counts.out_of_range == 1


# --- order and time ---------------------------------------------------------------------------


def test_points_are_ordered_by_stamp_and_equal_stamps_stay_in_message_order() -> None:
    stamps = [SECOND + offset for offset in (5, 3, 5, -2, 3, 5)]
    scan = scan_of(*[(10 + i, 0, 0) for i in range(6)], stamps_ns=stamps)

    found = mapped(scan)

    assert found.points_local[0].tolist() == [13, 11, 14, 10, 12, 15]
    assert (found.stamps_ns - SECOND).tolist() == [-2, 3, 3, 5, 5, 5]


def test_without_point_times_every_point_has_the_header_stamp() -> None:
    assert mapped(scan_of((5, 0, 0), (6, 0, 0))).stamps_ns.tolist() == [SECOND, SECOND]


MOVING = trajectory_of([SECOND, 2 * SECOND, 3 * SECOND], [(0, 0, 0), (1, 0, 0), (2, 0, 0)])
LONG_GAPS = replace(RECIPE, poses=PosesStage(max_gap_s=1.0))


def test_points_outside_the_trajectory_are_dropped_and_counted_its_ends_are_inside() -> None:
    stamps = [SECOND - 1, SECOND, 3 * SECOND, 3 * SECOND + 1]

    found = mapped(
        scan_of(*[(10.0, 0, 0)] * 4, stamps_ns=stamps), trajectory=MOVING, recipe=LONG_GAPS
    )

    assert found.stamps_ns.tolist() == [SECOND, 3 * SECOND]
    assert found.points_local[0].tolist() == [10, 12]
    assert found.counts.outside_trajectory == 2


def test_points_in_a_gap_of_the_trajectory_are_dropped_and_counted() -> None:
    trajectory = trajectory_of(
        [SECOND, SECOND + 250 * MS, SECOND + 501 * MS], [(0, 0, 0), (1, 0, 0), (2, 0, 0)]
    )
    stamps = [SECOND + ms * MS for ms in (100, 250, 300, 501)]

    found = mapped(scan_of(*[(10.0, 0, 0)] * 4, stamps_ns=stamps), trajectory=trajectory)

    assert ((found.stamps_ns - SECOND) // MS).tolist() == [100, 250, 501]
    assert found.counts.outside_trajectory == 1


def test_a_scan_without_point_times_is_outside_as_a_whole() -> None:
    scan = LidarScan(SECOND - 1, np.full((3, 3), 5.0, np.float32))

    found = mapped(scan, trajectory=MOVING)

    assert found.counts == PointCounts(read=3, outside_trajectory=3)
    assert (found.points_local.shape, found.stamps_ns.shape) == ((3, 0), (0,))


JUDGED = replace(
    trajectory_of([SECOND + k * 100 * MS for k in range(6)], [(k, 0, 0) for k in range(6)]),
    quality=np.array([1.0, 1.0, 0.2, 0.5, 0.5, 1.0]),
)
DEMANDING = replace(RECIPE, poses=PosesStage(min_quality=0.5))


def test_points_beside_a_pose_of_low_quality_are_dropped_and_counted() -> None:
    after_ms = [-1, 50, 100, 101, 150, 200, 250, 299, 300, 400, 450, 501]
    stamps = [SECOND + ms * MS for ms in after_ms]
    scan = scan_of(*[(10.0, 0, 0)] * len(stamps), stamps_ns=stamps)

    found = mapped(scan, trajectory=JUDGED, recipe=DEMANDING)

    assert ((found.stamps_ns - SECOND) // MS).tolist() == [50, 100, 300, 400, 450]
    assert found.points_local[0].tolist() == [10.5, 11.0, 13.0, 14.0, 14.5]
    assert found.counts == PointCounts(read=12, outside_trajectory=2, pose_quality_low=5)


@pytest.mark.parametrize(("after_ms", "kept"), [(100, 3), (101, 0)])
@pytest.mark.parametrize("in_map", [False, True])
def test_a_scan_without_point_times_is_trusted_as_a_whole_or_not_at_all(
    after_ms: int, kept: int, in_map: bool
) -> None:
    points = np.full((3, 3), 5.0, np.float32)
    scan = LidarScan(SECOND + after_ms * MS, points, in_map=in_map)

    found = mapped(scan, trajectory=JUDGED, recipe=DEMANDING)

    assert found.points_local.shape == (3, kept)
    assert found.counts == PointCounts(read=3, pose_quality_low=3 - kept)


def test_quality_changes_nothing_where_no_recipe_asks_for_it() -> None:
    stamps = [SECOND + ms * MS for ms in (50, 150, 250)]
    scan = scan_of(*[(10.0, 0, 0)] * 3, stamps_ns=stamps)

    judged = mapped(scan, trajectory=JUDGED)
    unjudged = mapped(scan, trajectory=replace(JUDGED, quality=None))

    assert judged.points_local.tobytes() == unjudged.points_local.tobytes()
    assert judged.counts == unjudged.counts == PointCounts(read=3)
    assert "pose_quality_low" not in total_points([judged.counts])
    low = mapped(scan, trajectory=JUDGED, recipe=DEMANDING)
    assert total_points([low.counts, judged.counts])["pose_quality_low"] == 2


def test_an_empty_scan_gives_nothing() -> None:
    for stamps in (None, []):
        found = mapped(scan_of(stamps_ns=stamps))

        assert found.points_local.shape == (3, 0)
        assert found.counts == PointCounts()


def test_a_message_that_was_left_out_is_counted_as_such() -> None:
    found = mapped(scan_of(stamps_ns=[], unreadable=True))

    assert found.counts == PointCounts(messages_unreadable=1)


def test_rows_are_contiguous_float32_one_axis_each() -> None:
    found = mapped(scan_of((5, 6, 7), (8, 9, 10), dtype=np.float64))

    assert found.points_local.dtype == np.float32
    assert found.points_local.flags.c_contiguous
    assert found.points_local.tolist() == [[5, 8], [6, 9], [7, 10]]


# --- motion -----------------------------------------------------------------------------------


def test_a_wall_seen_from_a_moving_sensor_is_flat_after_deskew() -> None:
    # 2 m/s towards a wall at x = 20: after 0.1 s steps it is seen at 20, 19.8, 19.6 ..
    trajectory = trajectory_of(
        [SECOND + i * 100 * MS for i in range(11)], [(0.2 * i, 0, 0) for i in range(11)]
    )
    times = [SECOND + 50 * i * MS for i in range(21)]
    scan = scan_of(
        *[(20 - 0.1 * i, 0.5 * i, 1.0) for i in range(21)], stamps_ns=times, dtype=np.float64
    )
    as_one = replace(RECIPE, accumulate=AccumulateStage(deskew=False))

    flat = mapped(scan, trajectory=trajectory).points_local
    skewed = mapped(scan, trajectory=trajectory, recipe=as_one).points_local

    np.testing.assert_allclose(flat[0], 20.0, rtol=0, atol=2e-6)
    np.testing.assert_allclose(flat[1], 0.5 * np.arange(21), rtol=0, atol=2e-6)
    # The header's stamp is the scan's start: without de-skew the wall leans by 2 m.
    np.testing.assert_allclose(skewed[0], 20 - 0.1 * np.arange(21), rtol=0, atol=2e-6)


def test_without_deskew_points_keep_their_own_stamps_and_move_by_the_headers_pose() -> None:
    scan = scan_of((10, 0, 0), (10, 0, 0), stamps_ns=[2 * SECOND, 3 * SECOND])
    as_one = replace(LONG_GAPS, accumulate=AccumulateStage(deskew=False))

    found = mapped(scan, trajectory=MOVING, recipe=as_one)

    assert found.stamps_ns.tolist() == [2 * SECOND, 3 * SECOND]
    assert found.points_local[0].tolist() == [10, 10]


@given(rigid_transforms(reach_m=2.0), seeds)
def test_every_point_goes_through_the_pose_at_its_own_time(
    T_body_lidar: NDArray[np.float64], seed: int
) -> None:
    rng = np.random.default_rng(seed)
    stamps = [SECOND + i * 100 * MS for i in range(6)]
    positions = rng.uniform(-5, 5, size=(6, 3)).tolist()
    q = rng.normal(size=(6, 4))
    q[1:] = q[0] + 0.3 * q[1:]
    quaternions = (q / np.linalg.norm(q, axis=1)[:, None]).tolist()
    trajectory = trajectory_of(stamps, positions, quaternions)
    points = rng.uniform(2, 20, size=(8, 3)).astype(np.float32)
    times = np.sort(rng.integers(stamps[0], stamps[-1], size=8)).tolist()

    found = mapped(
        LidarScan(SECOND, points, np.array(times)),
        trajectory=trajectory,
        rig=Rig(CAMERA, np.eye(4), T_body_lidar),
    )

    origin = np.floor(np.array(positions[0]) + 0.5)
    for index, (point, time) in enumerate(zip(points, times, strict=True)):
        T_map_lidar = pose_at(stamps, positions, quaternions, time) @ T_body_lidar
        expected = (T_map_lidar @ [*point.tolist(), 1.0])[:3] - origin
        np.testing.assert_allclose(found.points_local[:, index], expected, rtol=0, atol=5e-6)


# --- clouds that are in the map already -------------------------------------------------------


def test_a_registered_cloud_is_neither_moved_nor_deskewed() -> None:
    scan = scan_of(
        (10, 0, 0), (20, 5, 0), stamps_ns=[2 * SECOND, 3 * SECOND], in_map=True, dtype=np.float64
    )
    T_body_lidar = np.eye(4)
    T_body_lidar[:3, :3] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    T_body_lidar[:3, 3] = 0.5

    found = mapped(
        scan, trajectory=MOVING, rig=Rig(CAMERA, np.eye(4), T_body_lidar), recipe=LONG_GAPS
    )

    assert found.points_local.T.tolist() == [[10, 0, 0], [20, 5, 0]]


def test_the_range_of_a_registered_cloud_is_measured_from_where_the_sensor_stood() -> None:
    # The body is at x = 1 at 2 s and turned a quarter to the left: the lever (0.5, 0, 0) of the
    # LiDAR points along y, so it stands at (1, 0.5, 0).
    half = math.sqrt(0.5)
    trajectory = trajectory_of(
        [2 * SECOND, 3 * SECOND], [(1, 0, 0), (2, 0, 0)], [(0, 0, half, half)] * 2
    )
    T_body_lidar = np.eye(4)
    T_body_lidar[0, 3] = 0.5
    scan = scan_of(
        (1, 1.49, 0), (1, 1.51, 0), (1.99, 0.5, 0), (2.01, 0.5, 0), (101.01, 0.5, 0), (100, 0.5, 0),
        stamps_ns=[2 * SECOND] * 6, in_map=True, dtype=np.float64,
    )  # fmt: skip

    found = mapped(scan, trajectory=trajectory, rig=Rig(CAMERA, np.eye(4), T_body_lidar))

    x_map = found.points_local[0] + 1.0  # the local origin is (1, 0, 0)
    np.testing.assert_allclose(x_map, [1, 2.01, 100], rtol=1e-6)
    assert found.counts.out_of_range == 3


def test_a_registered_cloud_outside_the_trajectory_does_not_count() -> None:
    scan = scan_of((10, 0, 0), (10, 0, 0), stamps_ns=[SECOND - 1, SECOND], in_map=True)

    found = mapped(scan, trajectory=MOVING, recipe=LONG_GAPS)

    assert found.counts == PointCounts(read=2, outside_trajectory=1)


def test_a_registered_cloud_without_point_times_has_the_pose_of_its_header() -> None:
    # The body is at x = 0 at 1 s, where the header is: range 1 to 100 m from there.
    found = mapped(scan_of((0.5, 0, 0), (100, 0, 0), in_map=True), trajectory=MOVING)
    outside = mapped(LidarScan(SECOND - 1, np.full((2, 3), 9.0), in_map=True), trajectory=MOVING)

    assert found.points_local[0].tolist() == [100]
    assert found.counts == PointCounts(read=2, out_of_range=1)
    assert outside.counts == PointCounts(read=2, outside_trajectory=2)


def test_the_order_of_a_registered_cloud_is_that_of_its_stamps() -> None:
    scan = scan_of(
        (30, 0, 0), (0.1, 0, 0), (10, 0, 0), stamps_ns=[SECOND + 2, SECOND, SECOND], in_map=True
    )

    found = mapped(scan)

    assert found.points_local[0].tolist() == [10, 30]
    assert found.stamps_ns.tolist() == [SECOND, SECOND + 2]


# --- far from the origin ----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("first", "origin"),
    [
        ((0.0, 0.0, 0.0), (0, 0, 0)),
        ((0.5, -0.5, 1.49), (1, 0, 1)),
        ((540000.3, 4810000.7, 329.6), (540000, 4810001, 330)),
    ],
)
def test_the_local_origin_is_the_first_pose_in_whole_metres(
    first: tuple[float, ...], origin: tuple[float, ...]
) -> None:
    found = local_origin(trajectory_of([0, 1], [first, (9, 9, 9)]))

    assert found.tolist() == list(origin)
    assert found.dtype == np.float64
    assert not np.signbit(found).any()


def test_a_registered_cloud_far_from_the_origin_of_the_map_loses_nothing() -> None:
    # float32 steps by half a metre at 4,810,000 m.
    utm = np.array([540000.0, 4810000.0, 330.0])
    trajectory = trajectory_of([SECOND, 2 * SECOND], [tuple(utm)] * 2)
    points = np.random.default_rng(4).uniform(2, 50, size=(200, 3))
    scan = LidarScan(SECOND, points + utm, in_map=True)

    found = mapped(scan, trajectory=trajectory)

    np.testing.assert_allclose(found.points_local.T, points, rtol=0, atol=1e-5)


def test_points_far_from_the_origin_of_the_map_lose_nothing() -> None:
    utm = np.array([540000.0, 4810000.0, 330.0])
    stamps = [SECOND, 2 * SECOND]
    here = [(0.3, 0.2, 0.1), (1.3, 2.2, 0.4)]
    there = [tuple(np.array(position) + utm) for position in here]
    rng = np.random.default_rng(3)
    scan = LidarScan(
        SECOND,
        rng.uniform(-60, 60, size=(500, 3)).astype(np.float32),
        np.sort(rng.integers(*stamps, size=500)),
    )

    near = mapped(scan, trajectory=trajectory_of(stamps, here), recipe=LONG_GAPS)
    far = mapped(scan, trajectory=trajectory_of(stamps, there), recipe=LONG_GAPS)

    np.testing.assert_allclose(far.points_local, near.points_local, rtol=0, atol=1e-5)
