"""Quality planes: calibrated on walls whose noise is known, and right by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from civil_rgbd.domain.frame import EMPTY, QUALITY_PLANES
from civil_rgbd.domain.recipe import DepthStage, QualityStage
from civil_rgbd.geometry.camera import PinholeCamera
from civil_rgbd.pipeline.accumulate import PointWindow
from civil_rgbd.pipeline.quality import quality_planes
from civil_rgbd.pipeline.render import render_depth
from civil_rgbd.pipeline.winners import Winners, find_winners

CAMERA = PinholeCamera(160, 120, 130.0, 130.0, 79.5, 59.5)
LIMITS = DepthStage(min_m=0.5, max_m=200.0, step_m=0.0)
STAGE = QualityStage(weak_noise_share=0.0, slant_noise_rad=0.0)
EYE = np.eye(4)
ALL = np.ones((120, 160), dtype=np.bool_)


def window_of(points: NDArray[np.floating], stamps_ns: NDArray[np.int64]) -> PointWindow:
    segment = np.ascontiguousarray(points.T.astype(np.float32))
    return PointWindow([segment], [stamps_ns], [(0, 0, len(points))])


def wall(
    count: int, tangent: float, noise_m: float
) -> tuple[PointWindow, NDArray[np.float64], NDArray[np.float64]]:
    """Returns from a wall 8 m away that turns about the vertical; and their rays' true depths."""
    rng = np.random.default_rng(3)
    x, y = rng.uniform([[-0.5], [-0.4]], [[0.5], [0.4]], (2, count))
    truth_m = 8.0 / (1 + tangent * x)
    ray = np.sqrt(1 + x**2 + y**2)
    depth_m = truth_m + noise_m / ray * rng.standard_normal(count)  # noise along the ray
    points = np.stack([x, y, np.ones(count)], axis=1) * depth_m[:, np.newaxis]
    return window_of(points, np.arange(count, dtype=np.int64)), truth_m, depth_m


def planes_of(
    window: PointWindow, stage: QualityStage = STAGE, limits: DepthStage = LIMITS
) -> tuple[dict[str, NDArray[np.float16]], NDArray[np.float32], Winners]:
    depth_m = render_depth(window.segments, T_camera_local=EYE, camera=CAMERA, stage=limits).depth_m
    winners = find_winners(window, T_camera_local=EYE, camera=CAMERA, limits=limits)
    planes = quality_planes(
        depth_m,
        winners,
        ages_s=np.concatenate(window.stamps_ns) / 1e3 - 0.5,
        before_m=depth_m,
        exists=ALL,
        camera=CAMERA,
        depth=limits,
        stage=stage,
    )
    return dict(planes), depth_m, winners


@pytest.mark.parametrize("tangent", [0.0, 0.7, 1.8])
@pytest.mark.parametrize("count", [4_000, 25_000, 120_000])
def test_errors_are_as_large_as_expected_however_many_returns_compete(
    count: int, tangent: float
) -> None:
    window, truth_m, _ = wall(count, tangent, noise_m=0.02)

    planes, depth_m, winners = planes_of(window)

    won = winners.point >= 0
    error = depth_m[won] - truth_m[winners.point[won]]
    z = (error - planes["bias_m"][won]) / planes["sigma_m"][won]
    for low, high in ((1, 1), (2, 3), (4, 99)):
        some = z[(planes["returns"][won] >= low) & (planes["returns"][won] <= high)]
        if len(some) > 500:
            assert abs(np.median(some)) < 0.3
            assert 0.8 < 1.4826 * np.median(np.abs(some - np.median(some))) < 1.25
            assert (np.abs(some) > 3).mean() < 0.01


def test_the_nearest_of_many_returns_is_too_near_by_the_stored_bias() -> None:
    window, truth_m, _ = wall(120_000, 0.0, noise_m=0.02)

    planes, depth_m, winners = planes_of(window)

    many = planes["returns"] >= 6
    error = depth_m[many] - truth_m[winners.point[many]]
    assert np.median(error) < -0.02  # more than one sigma
    assert np.median(planes["bias_m"][many]) == pytest.approx(np.median(error), rel=0.15)
    assert not planes["bias_m"][planes["returns"] <= 1].any()


def test_sigma_grows_with_range_and_slant_as_the_recipe_says() -> None:
    slanting = replace(STAGE, slant_noise_rad=0.002)
    weak = replace(STAGE, weak_noise_share=0.002)

    def alone(depth_m: float, stage: QualityStage) -> float:
        point = window_of(np.array([[0.0, 0.0, depth_m]]), np.zeros(1, dtype=np.int64))
        planes, _, _ = planes_of(point, stage)
        return float(planes["sigma_m"].max())

    # A lonely return is taken to come from a surface that slants with tangent 8.
    assert alone(8.0, STAGE) == alone(32.0, STAGE) == pytest.approx(0.02, rel=1e-3)
    assert alone(8.0, slanting) == pytest.approx(np.hypot(0.02, 0.002 * 8 * 8), rel=1e-2)
    assert alone(32.0, slanting) == pytest.approx(np.hypot(0.02, 0.002 * 32 * 8), rel=1e-2)
    expected = np.hypot(0.02, 0.002 * 32 * np.hypot(1, 8) ** 0.5)
    assert alone(32.0, weak) == pytest.approx(expected, rel=1e-2)


def test_sigma_of_a_wall_grows_with_its_own_slant() -> None:
    slanting = replace(STAGE, slant_noise_rad=0.002)
    expected_m = np.hypot(0.02, 0.002 * 8 * 1.8)
    window, _, _ = wall(25_000, 1.8, noise_m=expected_m)

    planes, _, _ = planes_of(window, slanting)

    # Where the ray is the axis, the tangent is that of the wall.
    alone = (planes["returns"] == 1) & (np.abs(np.arange(160) - 79.5) < 8)
    assert np.median(planes["sigma_m"][alone]) == pytest.approx(expected_m, rel=0.1)


@pytest.mark.parametrize(("noise_m", "low_m", "high_m"), [(0.02, 0.02, 0.03), (0.06, 0.05, 0.066)])
def test_what_neighbours_show_corrects_what_the_recipe_says(
    noise_m: float, low_m: float, high_m: float
) -> None:
    window, _, _ = wall(12_000, 0.0, noise_m=noise_m)
    stated_m = np.hypot(0.02, 0.0045 * 8)  # 4.1 cm: twice as much, or two thirds

    planes, _, _ = planes_of(window, replace(STAGE, weak_noise_share=0.0045))

    alone = planes["returns"] == 1
    assert not low_m < stated_m < high_m
    assert low_m <= np.median(planes["sigma_m"][alone]) <= high_m


def test_noise_that_is_the_same_everywhere_is_calibrated_when_the_recipe_says_so() -> None:
    window, truth_m, _ = wall(25_000, 1.8, noise_m=0.02)
    far = window_of(window.segments[0].T.astype(np.float64) * 6, window.stamps_ns[0])
    # What was 2 cm of noise is 12 cm there: taken back to 2 cm along each ray.
    ray = far.segments[0] / far.segments[0][2]
    truth_m = truth_m * 6
    depth_m = truth_m + (far.segments[0][2] - truth_m) / 6
    far = window_of((ray * depth_m).T, far.stamps_ns[0])

    def width(stage: QualityStage) -> float:
        planes, stored_m, winners = planes_of(far, stage)
        won = winners.point >= 0
        error = stored_m[won] - truth_m[winners.point[won]]
        z = (error - planes["bias_m"][won]) / planes["sigma_m"][won]
        return float(1.4826 * np.median(np.abs(z - np.median(z))))

    assert 0.8 < width(STAGE) < 1.25
    assert width(QualityStage()) < 0.8  # a sensor is stated that errs more where beams slant


def test_towards_the_corners_less_of_the_noise_is_depth_and_the_way_is_longer() -> None:
    window, _, _ = wall(25_000, 0.0, noise_m=0.0)
    ray = np.sqrt(
        1 + (np.arange(160) - 79.5) ** 2 / 130**2 + (np.arange(120)[:, None] - 59.5) ** 2 / 130**2
    )
    corners = ray > 1.15

    def ratio(stage: QualityStage, expected: NDArray[np.float64]) -> float:
        planes, _, _ = planes_of(window, stage)
        alone = corners & (planes["returns"] == 1)
        assert alone.sum() > 50
        return float(np.median(planes["sigma_m"][alone] / expected[alone]))

    weak = replace(STAGE, range_noise_m=0.001, weak_noise_share=0.002)
    weakened = 0.002 * 8 * ray * np.sqrt(ray)  # the cosine of the angle is 1 / ray
    assert ratio(STAGE, 0.02 / ray) == pytest.approx(1.0, abs=0.02)
    assert ratio(weak, np.hypot(0.001, weakened) / ray) == pytest.approx(1.0, abs=0.02)


def test_leaves_slant_more_than_the_plane_through_them() -> None:
    slanting = replace(STAGE, slant_noise_rad=0.01)
    plane, leaves = (wall(25_000, 0.2, noise_m=noise_m)[0] for noise_m in (0.0256, 0.6))

    def middle(window: PointWindow) -> float:
        planes, _, _ = planes_of(window, slanting)
        alone = (planes["returns"] == 1) & (np.abs(np.arange(160) - 79.5) < 8)
        return float(np.median(planes["sigma_m"][alone]))

    assert middle(plane) < 0.035
    assert middle(leaves) > 0.06  # a tangent of about 1


def test_returns_are_counted_as_far_as_half_floats_count_one_by_one() -> None:
    points = np.tile([0.0, 0.0, 4.0], (2051, 1))
    window = window_of(points, np.zeros(len(points), dtype=np.int64))

    planes, _, _ = planes_of(window)

    assert planes["returns"].max() == 2048


def test_poses_and_rounding_count_as_noise() -> None:
    window, _, _ = wall(4_000, 0.0, noise_m=0.0)

    planes, _, _ = planes_of(
        window, replace(STAGE, pose_noise_m=0.03), replace(LIMITS, step_m=0.0625)
    )

    alone = planes["returns"] == 1
    expected = np.sqrt(0.02**2 + 0.03**2 + 0.0625**2 / 12)
    assert np.median(planes["sigma_m"][alone]) == pytest.approx(expected, rel=0.05)


def test_the_age_is_that_of_the_winning_return_and_signed() -> None:
    points = np.array([[0, 0, 8.0], [0, 0, 4.0], [1, 0, 4.0]])
    window = window_of(points, np.array([0, 250, 1250], dtype=np.int64))

    planes, depth_m, _ = planes_of(window)

    assert sorted(planes["age_s"][depth_m > 0].tolist()) == [-0.25, 0.75]
    assert not planes["age_s"][depth_m == 0].any()


def test_every_empty_pixel_says_why() -> None:
    points = np.array([[0, 0, 4.0], [1, 0, 4.0], [0, 60.0, 300.0], [0, -1, 4.0]])
    window = window_of(points, np.zeros(4, dtype=np.int64))
    drawn = render_depth(window.segments, T_camera_local=EYE, camera=CAMERA, stage=LIMITS).depth_m
    winners = find_winners(window, T_camera_local=EYE, camera=CAMERA, limits=LIMITS)
    (top, middle, right) = np.argwhere(drawn > 0)
    kept, exists = drawn.copy(), ALL.copy()
    kept[tuple(right)] = 0
    exists[tuple(top)], kept[tuple(top)] = False, 0

    planes = quality_planes(
        kept,
        winners,
        ages_s=np.zeros(4),
        before_m=np.where(exists, drawn, np.float32(0)),
        exists=exists,
        camera=CAMERA,
        depth=LIMITS,
        stage=STAGE,
    )

    empty = planes["empty"]
    assert empty[tuple(middle)] == EMPTY["depth"]
    assert empty[tuple(right)] == EMPTY["hidden"]
    assert empty[tuple(top)] == EMPTY["no-source"]
    assert np.count_nonzero(empty == EMPTY["out-of-range"]) == 1
    assert np.count_nonzero(empty == EMPTY["no-return"]) == 120 * 160 - 4
    assert planes["returns"][tuple(right)] == 1
    assert planes["sigma_m"][tuple(right)] == 0


def test_only_the_planes_that_were_asked_for_are_made() -> None:
    window, _, _ = wall(100, 0.0, noise_m=0.0)

    planes, _, _ = planes_of(window, replace(STAGE, planes=("returns", "age_s")))

    assert list(planes) == ["age_s", "returns"]
    assert {plane.dtype for plane in planes.values()} == {np.dtype(np.float16)}


def test_a_frame_without_points_has_planes_all_the_same() -> None:
    planes, _, _ = planes_of(PointWindow([], [np.zeros(0, dtype=np.int64)], []))

    assert list(planes) == list(QUALITY_PLANES)
    assert (planes["empty"] == EMPTY["no-return"]).all()
    assert not planes["sigma_m"].any()
    assert not any(np.signbit(plane).any() for plane in planes.values())
