"""Which return won each pixel: as the renderer draws it, and as a loop finds it."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from numpy.typing import NDArray

from civil_rgbd.domain.recipe import DepthStage
from civil_rgbd.geometry.camera import PinholeCamera
from civil_rgbd.pipeline.accumulate import PointWindow
from civil_rgbd.pipeline.render import render_depth
from civil_rgbd.pipeline.winners import NO_WINNER, Winners, find_winners, returns_within

from ..strategies import pinhole_cameras, rigid_transforms, seeds

LIMITS = DepthStage(min_m=0.5, max_m=50.0, step_m=0.0)
CAMERA = PinholeCamera(4, 3, 1.0, 1.0, 0.0, 0.0)  # at depth 1, x and y are u and v


def window_of(*points: NDArray[np.float32]) -> PointWindow:
    """A window of segments of (n, 3) points."""
    return PointWindow(
        segments=[np.ascontiguousarray(part.T) for part in points],
        stamps_ns=[np.arange(len(part), dtype=np.int64) for part in points],
        places=[(scan, 0, len(part)) for scan, part in enumerate(points)],
    )


def found(*points: tuple[float, float, float]) -> Winners:
    cloud = np.array(points, dtype=np.float32).reshape(-1, 3)
    return find_winners(window_of(cloud), T_camera_local=np.eye(4), camera=CAMERA, limits=LIMITS)


@given(pinhole_cameras(), rigid_transforms(), seeds)
def test_the_winners_are_the_points_that_the_renderer_draws(
    camera: PinholeCamera, T_camera_local: NDArray[np.float64], seed: int
) -> None:
    rng = np.random.default_rng(seed)
    points = rng.uniform(-60, 60, size=(3000, 3)).astype(np.float32)
    window = window_of(points[:1000], points[1000:])
    drawn = render_depth(
        window.segments, T_camera_local=T_camera_local, camera=camera, stage=LIMITS
    )

    winners = find_winners(window, T_camera_local=T_camera_local, camera=camera, limits=LIMITS)

    won = winners.point != NO_WINNER
    np.testing.assert_array_equal(won, drawn.depth_m > 0)
    depths = winners.depths_m[winners.point[won]].astype(np.float32)
    np.testing.assert_array_equal(depths, drawn.depth_m[won])
    assert winners.returns.sum() == drawn.points_in_view
    np.testing.assert_array_equal(winners.returns > 0, won)


def test_the_nearest_wins_and_of_equals_the_first() -> None:
    winners = found((2, 1, 2), (2, 2, 2), (1, 1, 1), (1, 1, 1))

    assert winners.point.tolist() == [[-1, -1, -1, -1], [-1, 2, -1, -1], [-1, -1, -1, -1]]
    assert winners.returns[1, 1] == 4


def test_returns_out_of_the_depth_range_are_seen_but_do_not_win() -> None:
    winners = found((0, 0, 60), (0.25, 0, 0.25), (0, 0, -3), (2, 2, 1))

    assert winners.out_of_range.tolist() == [[True, True, False, False]] + 2 * [[False] * 4]
    assert winners.returns.sum() == 1


def test_returns_far_behind_the_winner_are_not_of_its_surface() -> None:
    winners = found((1, 1, 1), (1.125, 1.125, 1.125), (3, 3, 3), (6, 3, 3))

    near = returns_within(winners, np.full((3, 4), 0.125))

    assert near[1].tolist() == [0, 2, 1, 0]
    assert winners.returns[1].tolist() == [0, 3, 1, 0]


def test_a_window_without_points_has_no_winners() -> None:
    winners = find_winners(
        PointWindow([], [], []), T_camera_local=np.eye(4), camera=CAMERA, limits=LIMITS
    )

    assert (winners.point == NO_WINNER).all()
    assert not winners.out_of_range.any()
