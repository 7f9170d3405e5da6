"""The LiDAR's points lie where scipy says that the scene is."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from civil_rgbd.simulator.avia import avia_directions
from civil_rgbd.simulator.catalogue import site_of
from civil_rgbd.simulator.lidar import beam_directions, scan_stamps_ns, simulate_scan
from civil_rgbd.simulator.spec import ScanSpec, usual_spec
from civil_rgbd.simulator.walk import START_NS, imu_poses

SPEC = ScanSpec(seconds=2.0, point_rate_hz=60_000)
AVIA_IN_IMU = np.array([0.04165, 0.02326, -0.0284])


def _in_map(spec: ScanSpec, index: int, *, at_header: bool) -> np.ndarray:
    scan = simulate_scan(spec, index)
    stamps = scan.stamp_ns + (0 if at_header else 1) * scan.offset_ns.astype(np.int64)
    places, turns = imu_poses(spec, stamps)
    points = places + Rotation.from_quat(turns).apply(scan.points_lidar + AVIA_IN_IMU)
    return points[scan.points_lidar.any(axis=1)]


def test_points_on_the_road_lie_in_its_plane_when_each_is_placed_at_its_own_time() -> None:
    points = _in_map(SPEC, 7, at_header=False)
    road = points[(np.abs(points[:, 1] + 3.5) < 2.2) & (points[:, 2] < 0.5)]

    assert len(road) > 300
    assert np.abs(road[:, 2]).max() < 2e-5  # float32 points


def test_points_placed_at_the_headers_time_are_smeared() -> None:
    points = _in_map(SPEC, 7, at_header=True)
    road = points[(np.abs(points[:, 1] + 3.5) < 2.2) & (points[:, 2] < 0.3)]

    assert np.abs(road[:, 2]).max() > 5e-3


def test_the_field_of_view_is_that_of_the_avia() -> None:
    times = np.arange(480_000, dtype=np.int64) * 4_167
    beams = beam_directions(times, (np.arange(480_000) % 6).astype(np.uint8))
    azimuth = np.degrees(np.arctan2(beams[:, 1], beams[:, 0]))
    elevation = np.degrees(np.arcsin(beams[:, 2]))

    np.testing.assert_allclose(np.linalg.norm(beams, axis=1), 1.0, rtol=0, atol=1e-14)
    assert azimuth.max() - azimuth.min() == pytest.approx(70.4, abs=0.5)
    assert elevation.max() - elevation.min() == pytest.approx(77.2, abs=0.5)


def test_the_rosette_goes_on_covering_new_ground() -> None:
    def occupied_cells(seconds: float) -> int:
        count = int(240_000 * seconds)
        beams = beam_directions(
            np.arange(count, dtype=np.int64) * 4_167, (np.arange(count) % 6).astype(np.uint8)
        )
        cells = np.floor(np.degrees(np.arcsin(beams[:, 1:])) / 0.2).astype(int)
        return len(np.unique(cells[:, 0] * 10_000 + cells[:, 1]))

    shares = np.array([occupied_cells(s) for s in (0.1, 0.5, 1.0, 4.0)])
    assert (np.diff(shares) > 0.1 * shares[-1]).all()


def test_the_six_lines_fire_in_turn_at_even_times() -> None:
    scan = simulate_scan(ScanSpec(seconds=1.0), 3)

    assert scan.line[:7].tolist() == [0, 1, 2, 3, 4, 5, 0]
    assert len(scan.points_lidar) == 24_000
    assert set(np.diff(scan.offset_ns.astype(np.int64)).tolist()) == {4166, 4167}
    assert int(scan.offset_ns[-1]) < 100_000_000
    assert scan.stamp_ns == START_NS + 300_000_000


def test_what_is_out_of_range_gives_no_return() -> None:
    spec = ScanSpec(seconds=1.0, point_rate_hz=60_000, min_range_m=4.0, max_range_m=20.0)
    scan = simulate_scan(spec, 0)
    ranges = np.linalg.norm(scan.points_lidar.astype(np.float64), axis=1)

    returned = ranges[ranges > 0]
    assert 0.2 < len(returned) / len(ranges) < 0.95
    assert 4.0 - 1e-5 <= returned.min() < returned.max() <= 20.0 + 1e-5
    assert (scan.reflectivity[ranges == 0] == 0).all()
    assert not np.signbit(scan.points_lidar[ranges == 0]).any()


def test_range_noise_moves_points_along_their_beams_by_its_sigma() -> None:
    quiet = simulate_scan(SPEC, 2).points_lidar.astype(np.float64)
    noisy = simulate_scan(
        ScanSpec(seconds=2.0, point_rate_hz=60_000, range_noise_m=0.02), 2
    ).points_lidar.astype(np.float64)
    both = quiet.any(axis=1) & noisy.any(axis=1)
    before, after = (np.linalg.norm(p[both], axis=1) for p in (quiet, noisy))

    assert (after - before).std() == pytest.approx(0.02, rel=0.05)
    cosine = (quiet[both] * noisy[both]).sum(axis=1) / (before * after)
    assert cosine.min() > 1 - 1e-9


def test_false_returns_lie_in_front_and_carry_the_noise_tag() -> None:
    true = simulate_scan(SPEC, 2)
    scan = simulate_scan(ScanSpec(seconds=2.0, point_rate_hz=60_000, false_return_share=0.1), 2)
    moved = (scan.points_lidar != true.points_lidar).any(axis=1) & scan.points_lidar.any(axis=1)

    assert moved.sum() > 300
    assert ((scan.tag & 0x0F) != 0)[moved].all()
    assert not true.tag.any()
    ranges = np.linalg.norm(scan.points_lidar, axis=1) / np.linalg.norm(
        true.points_lidar + 1e-9, axis=1
    )
    assert ranges[moved].max() < 0.951


def test_the_seed_decides_and_the_order_of_reading_does_not() -> None:
    spec = ScanSpec(seconds=1.0, point_rate_hz=6_000, range_noise_m=0.01)
    forwards = [simulate_scan(spec, i).points_lidar for i in (0, 1, 2)]
    backwards = [simulate_scan(spec, i).points_lidar for i in (2, 1, 0)][::-1]
    other = simulate_scan(
        ScanSpec(seconds=1.0, point_rate_hz=6_000, range_noise_m=0.01, seed=1), 0
    ).points_lidar

    for one, two in zip(forwards, backwards, strict=True):
        np.testing.assert_array_equal(one, two)
    assert (other != forwards[0]).any()


def test_every_message_has_its_own_noise() -> None:
    quiet, noisy = (
        ScanSpec(seconds=1.0, point_rate_hz=6_000, range_noise_m=sigma) for sigma in (0.0, 0.01)
    )
    first, second = (
        np.linalg.norm(simulate_scan(noisy, i).points_lidar, axis=1)
        - np.linalg.norm(simulate_scan(quiet, i).points_lidar, axis=1)
        for i in (0, 1)
    )

    assert np.abs(np.corrcoef(first, second)[0, 1]) < 0.3


def test_a_far_away_map_gives_the_same_points() -> None:
    far = ScanSpec(seconds=2.0, point_rate_hz=60_000, map_offset_m=(540_000.0, 4_810_000.0, 330.0))

    difference = simulate_scan(far, 3).points_lidar - simulate_scan(SPEC, 3).points_lidar
    assert np.quantile(np.abs(difference), 0.999) < 1e-4


def test_only_whole_messages_are_sent() -> None:
    assert len(scan_stamps_ns(ScanSpec(seconds=0.95))) == 9
    assert len(scan_stamps_ns(ScanSpec(seconds=0.3))) == 3


AVIA = ScanSpec(seconds=2.0, point_rate_hz=60_000, pattern="avia")


def test_the_avias_beams_point_where_its_law_says_at_each_six_points_time() -> None:
    scan = simulate_scan(AVIA, 3)
    ranges = np.linalg.norm(scan.points_lidar.astype(np.float64), axis=1)

    met = ranges > 0
    since = scan.stamp_ns - START_NS + scan.offset_ns.astype(np.int64)[::6]
    beams = avia_directions(since)[met]
    np.testing.assert_allclose(scan.points_lidar[met] / ranges[met, None], beams, rtol=0, atol=2e-7)
    assert met.mean() > 0.5


def test_points_of_a_bridge_lie_in_its_planes() -> None:
    spec = ScanSpec(
        bridge="B3", seconds=2.0, point_rate_hz=60_000, pattern="avia", moving=0, stands_s=0.0
    )
    points = _in_map(spec, 15, at_header=False)[::40]
    scene = site_of("B3", moving=False).scene
    distances = np.abs(
        points[:, :1] * scene.normals[:, 0]
        + points[:, 1:2] * scene.normals[:, 1]
        + points[:, 2:] * scene.normals[:, 2]
        - scene.offsets_m
    ).min(axis=1)

    assert len(points) > 100
    assert distances.max() < 5e-5


def test_dark_and_grazing_surfaces_drop_out_and_bright_ones_stay() -> None:
    all_of_it = simulate_scan(AVIA, 4)
    scan = simulate_scan(replace(AVIA, range_at_10_percent_m=60.0), 4)
    met, kept = (s.points_lidar.any(axis=1) for s in (all_of_it, scan))
    ranges = np.linalg.norm(all_of_it.points_lidar, axis=1)

    assert not (kept & ~met).any()
    near_wall = met & (all_of_it.reflectivity >= 60) & (ranges < 8)
    far_road = met & (all_of_it.reflectivity == 15) & (ranges > 15)
    assert near_wall.sum() > 300
    assert far_road.sum() > 100
    assert kept[near_wall].mean() > 0.99
    assert kept[far_road].mean() < 0.3
    assert (scan.reflectivity[~kept] == 0).all()
    np.testing.assert_array_equal(scan.points_lidar[kept], all_of_it.points_lidar[kept])


def test_noise_grows_with_range_and_slant() -> None:
    exact = replace(AVIA, seconds=6.0, range_noise_m=0.0, range_at_10_percent_m=450.0)
    noisy = replace(exact, range_noise_m=0.02)
    true, errors = [], []
    for index in range(0, 60, 4):
        one, two = (
            np.linalg.norm(simulate_scan(s, index).points_lidar.astype(float), axis=1)
            for s in (exact, noisy)
        )
        both = (one > 0) & (two > 0)
        true.append(one[both])
        errors.append((two - one)[both])
    ranges, off = np.concatenate(true), np.concatenate(errors)

    near, far = (off[(ranges > a) & (ranges < b)] for a, b in ((2, 8), (40, 120)))
    assert min(len(near), len(far)) > 100
    assert near.std() == pytest.approx(0.0197, rel=0.1)
    assert far.std() > 1.2 * near.std()


def test_at_edges_ranges_mix_and_most_of_them_are_tagged() -> None:
    plain = simulate_scan(AVIA, 2)
    mixed = simulate_scan(replace(AVIA, beam_width_deg=0.28), 2)
    before, after = (
        np.linalg.norm(s.points_lidar.astype(np.float64), axis=1) for s in (plain, mixed)
    )

    changed = np.abs(after - before) > 1e-6
    assert 10 < changed.sum() < 0.02 * len(changed)
    assert (mixed.tag[~changed] == 0).mean() > 0.9999
    assert 0.5 < (mixed.tag[changed] != 0).mean() < 1.0
    assert np.abs(after - before).max() < 1.5


def test_a_scan_of_a_bridge_is_of_its_seed() -> None:
    spec = replace(usual_spec("B2"), seconds=3.0, point_rate_hz=6_000)
    first, again, other = (
        simulate_scan(s, 25) for s in (spec, replace(spec), replace(spec, seed=1))
    )

    np.testing.assert_array_equal(first.points_lidar, again.points_lidar)
    np.testing.assert_array_equal(first.tag, again.tag)
    assert (first.points_lidar != other.points_lidar).any()


@pytest.mark.slow
@pytest.mark.parametrize("bridge", ["B1", "B2", "B3", "B4", "B5"])
def test_a_whole_scan_takes_less_than_thirty_milliseconds_of_processor_time(bridge: str) -> None:
    spec = usual_spec(bridge)
    took = []
    for index in range(30, 41):
        begun = time.thread_time()
        simulate_scan(spec, index)
        took.append(time.thread_time() - begun)

    assert min(took) < 0.030
