"""The walk against scipy, and against what a walk is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from civil_rgbd.simulator.bridge import caster_of
from civil_rgbd.simulator.catalogue import SITES, site_caster_of
from civil_rgbd.simulator.spec import ScanSpec, usual_spec
from civil_rgbd.simulator.walk import (
    START_NS,
    T_LIDAR_CAMERA,
    camera_poses,
    dense_imu_poses,
    image_instants_ns,
    imu_poses,
    imu_readings,
    pose_stamps_ns,
    stated_T_lidar_camera,
)

SPEC = ScanSpec(seconds=20.0)


def test_recorded_poses_are_dense_enough_to_interpolate_between() -> None:
    stamps = pose_stamps_ns(SPEC)
    places, turns = imu_poses(SPEC, stamps)
    between = (stamps[:-1] + stamps[1:]) // 2
    true_places, true_turns = imu_poses(SPEC, between)

    slerped = Slerp(stamps - START_NS, Rotation.from_quat(turns))(between - START_NS)

    error = (slerped.inv() * Rotation.from_quat(true_turns)).magnitude()
    assert error.max() < 5e-6  # radians: 0.1 mm at 20 m
    assert np.abs((places[:-1] + places[1:]) / 2 - true_places).max() < 2e-5


def test_poses_are_unit_quaternions_with_positive_w() -> None:
    _, turns = imu_poses(SPEC, pose_stamps_ns(SPEC))

    np.testing.assert_allclose(np.linalg.norm(turns, axis=1), 1.0, rtol=0, atol=1e-15)
    assert (turns[:, 3] >= 0).all()


def test_the_inspector_walks_at_about_a_metre_a_second_at_chest_height() -> None:
    places, _ = imu_poses(SPEC, pose_stamps_ns(ScanSpec()))
    speed = np.linalg.norm(np.diff(places, axis=0), axis=1) * 200

    assert 0.7 < speed.min() < speed.max() < 1.4
    assert 1.4 < places[:, 2].min() < places[:, 2].max() < 1.5


def test_the_demo_moves_far_enough_for_forty_to_sixty_frames() -> None:
    spec = ScanSpec()
    instants = image_instants_ns(spec)
    places = camera_poses(spec, instants)[:, :3, 3]
    kept = [0]
    for index in range(1, len(places)):
        if np.linalg.norm(places[index] - places[kept[-1]]) > 0.10:
            kept.append(index)

    after_filling = [i for i in kept if instants[i] - START_NS > 1.4e9]
    assert 40 <= len(after_filling) <= 60


def test_a_long_walk_never_leaves_the_free_space() -> None:
    spec = ScanSpec(seconds=80.0)
    places, _ = imu_poses(spec, pose_stamps_ns(spec)[::20])

    for direction in Rotation.from_euler("z", np.arange(0, 360, 30)[:, None], degrees=True).apply(
        [1, 0, 0]
    ):
        distances, _ = caster_of("demo").distances(
            places, np.broadcast_to(direction, places.shape).copy()
        )
        assert distances[distances > 0].min(initial=np.inf) > 0.8


def test_the_inspector_looks_where_he_goes_and_a_little_to_the_left() -> None:
    spec = ScanSpec(seconds=80.0)
    places, turns = imu_poses(spec, pose_stamps_ns(spec))
    going = np.gradient(places[:, :2], axis=0)
    facing = Rotation.from_quat(turns).apply([1.0, 0.0, 0.0])
    left = np.arctan2(
        going[:, 0] * facing[:, 1] - going[:, 1] * facing[:, 0],
        (going * facing[:, :2]).sum(axis=1),
    )
    brisk = np.linalg.norm(going, axis=1) * 200 > 0.3  # the gait sways whoever pivots

    assert left[brisk].min() > -0.1
    assert left[brisk].max() < 0.8
    assert 0.0 < np.arcsin(facing[:, 2]).min() < np.arcsin(facing[:, 2]).max() < 0.35


def test_the_camera_looks_ahead_from_above_the_lidar() -> None:
    right, down, forward, place = T_LIDAR_CAMERA[:3].T

    assert forward[0] > 0.99  # LiDAR x is forward
    assert right[1] < -0.99  # LiDAR y is left
    assert down[2] < -0.99  # LiDAR z is up
    assert place.tolist() == pytest.approx([0.021, 0.034, 0.093])
    assert np.abs(T_LIDAR_CAMERA[:3, :3] - np.rint(T_LIDAR_CAMERA[:3, :3])).max() > 0.02


def test_camera_poses_chain_imu_lidar_and_camera() -> None:
    stamps = pose_stamps_ns(SPEC)[::400]
    places, turns = imu_poses(SPEC, stamps)
    chain = camera_poses(SPEC, stamps)
    avia = np.array([0.04165, 0.02326, -0.0284])

    body = Rotation.from_quat(turns)
    np.testing.assert_allclose(
        chain[:, :3, 3], places + body.apply(avia + T_LIDAR_CAMERA[:3, 3]), rtol=0, atol=1e-12
    )
    expected = (body * Rotation.from_matrix(T_LIDAR_CAMERA[:3, :3])).as_matrix()
    np.testing.assert_allclose(chain[:, :3, :3], expected, rtol=0, atol=1e-12)


def test_a_stated_extrinsic_error_turns_about_the_cameras_own_axes() -> None:
    spec = ScanSpec(extrinsic_error_deg=(0.0, 2.0, 0.0), extrinsic_error_m=(0.01, 0.0, 0.0))

    error = np.linalg.inv(T_LIDAR_CAMERA) @ stated_T_lidar_camera(spec)

    np.testing.assert_allclose(error[:3, 3], [0.01, 0.0, 0.0], rtol=0, atol=1e-12)
    rotation = Rotation.from_matrix(error[:3, :3]).as_rotvec(degrees=True)
    np.testing.assert_allclose(rotation, [0.0, 2.0, 0.0], rtol=0, atol=1e-9)


def test_the_imu_feels_the_turning_and_gravity() -> None:
    stamps = pose_stamps_ns(SPEC)[10:2000:7]
    rate, force = imu_readings(SPEC, stamps)
    step = 500_000
    before, after = (
        Rotation.from_quat(imu_poses(SPEC, stamps + shift)[1]) for shift in (-step, step)
    )

    np.testing.assert_allclose(rate, (before.inv() * after).as_rotvec() / 1e-3, rtol=0, atol=2e-5)
    assert np.linalg.norm(force, axis=1).mean() == pytest.approx(1.0, abs=0.02)  # in g
    assert (force[:, 2] > 0.7).all()  # what holds it up points up


def test_who_stands_still_feels_gravity_alone() -> None:
    spec = ScanSpec(speed_m_s=0.0, seconds=2.0)
    rate, force = imu_readings(spec, pose_stamps_ns(spec))

    assert np.abs(rate).max() < 1e-12
    np.testing.assert_allclose(np.linalg.norm(force, axis=1), 1.0, rtol=0, atol=1e-9)


def test_images_are_taken_inside_the_trajectory() -> None:
    for seconds in (0.35, 2.0, 2.033):
        spec = ScanSpec(seconds=seconds, image_rate_hz=30.0)
        assert image_instants_ns(spec)[-1] <= pose_stamps_ns(spec)[-1]
        assert image_instants_ns(spec)[0] >= START_NS


@pytest.mark.parametrize("bridge", sorted(set(SITES) - {"demo"}))
def test_a_long_walk_past_any_bridge_keeps_off_its_walls(bridge: str) -> None:
    spec = replace(usual_spec(bridge), seconds=150.0)
    places, _ = imu_poses(spec, pose_stamps_ns(spec)[::40])
    caster = site_caster_of(bridge, moving=False).standing

    for azimuth in range(0, 360, 30):
        direction = np.array([np.cos(np.radians(azimuth)), np.sin(np.radians(azimuth)), 0.0])
        distances, _ = caster.distances(places, np.broadcast_to(direction, places.shape).copy())
        assert distances[distances > 0].min(initial=np.inf) > 0.4
    down, _ = caster.distances(places, np.broadcast_to([0.0, 0.0, -1.0], places.shape).copy())
    assert 0.9 < down.min() < down.max() < 1.9  # chest high, above something to stand on


@pytest.mark.parametrize("bridge", ["demo", "B4"])
def test_poses_close_together_may_be_interpolated(bridge: str) -> None:
    spec = usual_spec(bridge)
    stamps = START_NS + 5_000_000_007 + np.arange(24_000, dtype=np.int64) * 100_000_000 // 24_000

    (places, turns), (fast_places, fast_turns) = (
        function(spec, stamps) for function in (imu_poses, dense_imu_poses)
    )

    np.testing.assert_allclose(fast_places, places, rtol=0, atol=1e-8)
    np.testing.assert_allclose(fast_turns, turns, rtol=0, atol=1e-8)


def test_interpolation_is_not_misled_where_a_quaternion_changes_its_sign() -> None:
    spec = ScanSpec(seconds=60.0)
    stamps = START_NS + np.arange(0, 60 * 10**9, 100_000, dtype=np.int64)
    _, turns = imu_poses(spec, stamps)
    flip = int(np.flatnonzero((turns[:-1] * turns[1:]).sum(axis=1) < 0)[0])
    close = stamps[flip] - 1_050_000 + np.arange(0, 2_100_000, 4_167, dtype=np.int64)

    fast, exact = (Rotation.from_quat(f(spec, close)[1]) for f in (dense_imu_poses, imu_poses))

    assert (fast.inv() * exact).magnitude().max() < 1e-7


def test_the_demos_walker_may_stand_first_too() -> None:
    spec = ScanSpec(stands_s=1.0, seconds=4.0)
    places, turns = imu_poses(spec, pose_stamps_ns(spec))

    assert np.ptp(places[:199], axis=0).max() == 0
    assert np.ptp(turns[:199], axis=0).max() == 0
    assert np.linalg.norm(places[-1] - places[0]) > 1.5


@pytest.mark.parametrize(("bridge", "way_m"), [("demo", 10.0), ("B3", 9.25)])
def test_a_walk_that_begins_further_along_stands_where_another_one_passes(
    bridge: str, way_m: float
) -> None:
    walk = ScanSpec(bridge, seconds=12.0, speed_m_s=1.0, sway=0.0)
    stands = replace(walk, speed_m_s=0.0, starts_m=way_m)  # B3's walker sets off within 1.5 s
    after_10_s = np.array([START_NS + 10 * 10**9])

    passed, here = (imu_poses(spec, after_10_s)[0] for spec in (walk, stands))

    assert np.linalg.norm(here - imu_poses(walk, after_10_s - 10 * 10**9)[0]) > 5
    np.testing.assert_allclose(here, passed, rtol=0, atol=1e-9)


def test_a_beginning_that_nobody_asks_for_changes_no_hash() -> None:
    assert "starts_m" not in ScanSpec().document()
    assert ScanSpec(starts_m=3.0).document()["starts_m"] == 3.0
