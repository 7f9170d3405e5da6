"""Slant of surfaces from sparse depth: planes whose slant is known by hand."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from civil_rgbd.domain.recipe import QualityStage
from civil_rgbd.geometry.camera import PinholeCamera
from civil_rgbd.pipeline.slopes import slopes_of

CAMERA = PinholeCamera(96, 64, 80.0, 80.0, 47.5, 31.5)
EXACT = QualityStage(range_noise_m=0.0, weak_noise_share=0.0, slant_noise_rad=0.0)
USUAL = QualityStage()
V, U = np.mgrid[0:64, 0:96]
ONE = np.ones((64, 96))
X, Y = (U - 47.5) / 80.0, (V - 31.5) / 80.0


def plane(normal: tuple[float, float, float], distance_m: float) -> NDArray[np.float64]:
    """Depth of the plane n P = distance."""
    return distance_m / (normal[0] * X + normal[1] * Y + normal[2])


def sparse(depth_m: NDArray[np.float64], share: float = 0.4) -> NDArray[np.float32]:
    kept = np.random.default_rng(0).random(depth_m.shape) < share
    return np.where(kept & (depth_m > 0), depth_m, 0).astype(np.float32)


@pytest.mark.parametrize("angle_deg", [0.0, 20.0, 45.0, 70.0])
def test_the_slant_of_a_plane_is_found(angle_deg: float) -> None:
    angle = np.radians(angle_deg)
    normal = (np.sin(angle), 0.0, np.cos(angle))
    truth = plane(normal, 10.0)
    depth_m = sparse(np.where((truth > 0) & (np.abs(X) < 0.25), truth, 0))
    inside = (depth_m > 0) & (np.abs(X) < 0.15) & (V > 8) & (V < 56)

    slopes = slopes_of(depth_m, CAMERA, narrowed=ONE, stage=EXACT)

    cosine = (normal[0] * X + normal[2]) / np.sqrt(1 + X**2 + Y**2)
    np.testing.assert_allclose(
        slopes.tangent[inside], np.sqrt(1 / cosine[inside] ** 2 - 1), rtol=1e-3, atol=1e-3
    )
    # Within a pixel depth is uniform: its deviation is the step to the next pixel / root of 12.
    step_m = np.abs(np.gradient(truth, axis=1))[inside]
    np.testing.assert_allclose(slopes.spread_m[inside], step_m / np.sqrt(12), rtol=0.02, atol=1e-6)
    assert slopes.rough_m[inside].max() < 1e-4


def test_noise_is_not_taken_for_slant_but_for_roughness() -> None:
    noise = 0.05 * np.random.default_rng(1).standard_normal(X.shape)
    depth_m = sparse(plane((0.0, 0.0, 1.0), 4.0) + noise)
    inside = (depth_m > 0) & (U > 8) & (U < 88) & (V > 8) & (V < 56)

    slopes = slopes_of(depth_m, CAMERA, narrowed=ONE, stage=EXACT)

    assert np.median(slopes.rough_m[inside]) == pytest.approx(0.05, rel=0.1)
    assert (slopes.spread_m[inside] == 0).mean() > 0.5  # no more slant than noise gives on average


@pytest.mark.parametrize("apart", [0.1, 0.03])
def test_a_bush_before_a_wall_is_not_taken_for_a_slanting_wall(apart: float) -> None:
    rng = np.random.default_rng(2)
    bush = (rng.random(X.shape) < 0.7 * (U > 48)) & (U < 58)
    depth_m = sparse(np.where(bush, 30.0 * (1 - apart), 30.0) + 0.02 * rng.standard_normal(X.shape))
    wall = (depth_m > 29.7) & (np.abs(U - 48) < 4) & (V > 8) & (V < 56)

    slopes = slopes_of(depth_m, CAMERA, narrowed=ONE, stage=USUAL)

    assert np.quantile(slopes.tangent[wall], 0.9) < 0.5
    assert np.quantile(slopes.rough_m[wall], 0.9) < 0.04


def test_ground_that_slants_more_than_nearer_neighbours_can_show_keeps_its_slant() -> None:
    truth = plane((0.0, 1.0, 0.12), 6.0)  # 83 degrees from the axis
    rng = np.random.default_rng(4)
    some = (truth > 20) & (truth < 60)
    leafy = np.where(some, truth, 0) * (1 + 0.04 * rng.standard_normal(X.shape))
    depth_m = sparse(leafy)
    inside = (depth_m > 30) & (depth_m < 45) & (U > 8) & (U < 88)

    slopes = slopes_of(depth_m, CAMERA, narrowed=ONE, stage=USUAL)

    assert np.median(slopes.rough_m[inside]) > 0.5
    assert np.median(slopes.tangent[inside]) > 3


def test_surfaces_far_before_or_behind_do_not_bend_the_plane() -> None:
    depth_m = sparse(np.where(U < 48, 5.0, 10.0))
    beside = (depth_m > 0) & (np.abs(U - 47.5) < 4) & (V > 8) & (V < 56)

    slopes = slopes_of(depth_m, CAMERA, narrowed=ONE, stage=EXACT)

    assert slopes.spread_m[beside].max() < 1e-6


def test_a_pixel_without_neighbours_is_taken_to_slant_and_an_empty_one_has_nothing() -> None:
    depth_m = np.zeros((64, 96), dtype=np.float32)
    depth_m[30, 40] = 7.0

    slopes = slopes_of(depth_m, CAMERA, narrowed=ONE, stage=USUAL)

    assert slopes.tangent[30, 40] == 8.0
    assert np.count_nonzero(slopes.tangent) == 1
    assert not slopes.spread_m.any()


def test_neighbours_in_one_line_say_nothing() -> None:
    depth_m = np.zeros((64, 96), dtype=np.float32)
    depth_m[30, 20:60] = 7.0

    assert set(slopes_of(depth_m, CAMERA, narrowed=ONE, stage=USUAL).tangent[30, 20:60]) == {8.0}
