"""The renderer: equals its slow twin, and numbers by hand."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from civil_rgbd.domain.recipe import DepthStage
from civil_rgbd.geometry.camera import PinholeCamera
from civil_rgbd.pipeline.render import RenderedDepth, render_depth

from ..reference.zbuffer import Pinhole, zbuffer, zbuffer_by_minimum_at
from ..strategies import pinhole_cameras, rigid_transforms, seeds

ONE_TO_ONE = PinholeCamera(4, 3, 1.0, 1.0, 0.0, 0.0)  # at depth 1, x and y are u and v
EXACT = DepthStage(min_m=0.5, max_m=200.0, step_m=0.0)


def segment(*points: tuple[float, float, float]) -> NDArray[np.float32]:
    return np.array(points, dtype=np.float32).reshape(-1, 3).T.copy()


def drawn(
    *points: tuple[float, float, float],
    camera: PinholeCamera = ONE_TO_ONE,
    stage: DepthStage = EXACT,
) -> RenderedDepth:
    return render_depth([segment(*points)], T_camera_local=np.eye(4), camera=camera, stage=stage)


def plain(camera: PinholeCamera) -> Pinhole:
    return Pinhole(
        camera.width_px, camera.height_px, camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px
    )


# --- against the twin -------------------------------------------------------------------------


def cloud(rng: np.random.Generator, count: int) -> NDArray[np.float32]:
    """Points all around, some at the same place, some at the camera's own."""
    points = rng.uniform(-60, 60, size=(count, 3)).astype(np.float32)
    points[rng.random(count) < 0.1] = points[0] if count else 0
    points[rng.random(count) < 0.02] = 0
    return points


@given(
    pinhole_cameras(),
    rigid_transforms(),
    seeds,
    st.sampled_from([0, 1, 500, 5000]),
    st.sampled_from([0.0, 2.0**-10, 0.25]),
)
def test_it_equals_its_slow_twin_pixel_by_pixel(
    camera: PinholeCamera,
    T_camera_local: NDArray[np.float64],
    seed: int,
    count: int,
    step_m: float,
) -> None:
    rng = np.random.default_rng(seed)
    points = cloud(rng, count)
    stage = DepthStage(min_m=0.5, max_m=50.0, step_m=step_m)
    limits = {"min_m": stage.min_m, "max_m": stage.max_m, "step_m": step_m}
    expected, doubtful = zbuffer(points, T_camera_local, plain(camera), **limits)
    cuts = np.sort(rng.integers(0, count + 1, size=3))

    found = render_depth(
        [np.ascontiguousarray(part.T) for part in np.split(points, cuts)],
        T_camera_local=T_camera_local,
        camera=camera,
        stage=stage,
    ).depth_m

    assert found.shape == (camera.height_px, camera.width_px)
    np.testing.assert_array_equal(found[~doubtful], expected[~doubtful])
    # Free clouds hardly ever meet a boundary: doubt is no loophole.
    assert doubtful.sum() <= 2


def test_a_whole_frame_equals_both_twins_without_a_single_doubt() -> None:
    rng = np.random.default_rng(5)
    points = rng.uniform([-40, -25, -5], [40, 25, 60], size=(40_000, 3)).astype(np.float32)
    camera = PinholeCamera(768, 432, 382.0, 381.0, 381.2, 219.5)
    T = np.array([[0.96, -0.28, 0, 0.3], [0.28, 0.96, 0, -0.2], [0, 0, 1, 0.7], [0, 0, 0, 1]])
    stage = DepthStage()
    limits = {"min_m": stage.min_m, "max_m": stage.max_m, "step_m": stage.step_m}
    expected, doubtful = zbuffer(points, T, plain(camera), **limits)

    found = render_depth(
        [np.ascontiguousarray(points.T)], T_camera_local=T, camera=camera, stage=stage
    )

    assert not doubtful.any()
    assert (found.depth_m != expected).sum() == 0
    assert (found.depth_m > 0).sum() > 10_000
    by_numpy = zbuffer_by_minimum_at(points, T, plain(camera), **limits)
    np.testing.assert_array_equal(by_numpy, expected)


@given(seeds, st.integers(1, 9))
def test_how_points_are_cut_and_ordered_changes_nothing(seed: int, parts: int) -> None:
    rng = np.random.default_rng(seed)
    points = rng.uniform(-4, 4, size=(3000, 3)).astype(np.float32)
    camera = PinholeCamera(20, 30, 15.0, 20.0, 9.5, 14.5)
    whole = render_depth([points.T.copy()], T_camera_local=np.eye(4), camera=camera, stage=EXACT)
    shuffled = points[rng.permutation(len(points))]

    found = render_depth(
        [part.T for part in np.array_split(shuffled, parts)],  # not contiguous either
        T_camera_local=np.eye(4),
        camera=camera,
        stage=EXACT,
    )

    np.testing.assert_array_equal(found.depth_m, whole.depth_m)
    assert found.points_in_view == whole.points_in_view


# --- by hand ----------------------------------------------------------------------------------


def test_u_goes_right_and_v_goes_down() -> None:
    depth_m = drawn((3.0, 1.0, 1.0)).depth_m

    assert np.argwhere(depth_m).tolist() == [[1, 3]]
    assert depth_m[1, 3] == 1.0


def test_focal_lengths_and_principal_point_belong_to_their_axes() -> None:
    camera = PinholeCamera(100, 60, 40.0, 20.0, 10.0, 30.0)

    # u = 40 * 1/2 + 10 = 30, v = 20 * 1/2 + 30 = 40.
    assert np.argwhere(drawn((1.0, 1.0, 2.0), camera=camera).depth_m).tolist() == [[40, 30]]


def test_the_camera_stands_where_the_inverse_of_its_pose_says() -> None:
    # 2 m before the wall at z = 5, turned half round: sees it when it looks along -z from z = 7.
    T_camera_local = np.array([[-1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, -1, 7], [0, 0, 0, 1]])

    found = render_depth(
        [segment((-2, 2, 5))], T_camera_local=T_camera_local, camera=ONE_TO_ONE, stage=EXACT
    )

    assert np.argwhere(found.depth_m).tolist() == [[1, 1]]
    assert found.depth_m[1, 1] == 2.0


@pytest.mark.parametrize(
    ("u", "column"),
    [
        (-0.5, 0),
        (-0.25, 0),
        (math.nextafter(-0.5, -1), None),
        (0.49999997, 0),
        (0.5, 1),
        (1.5, 2),  # half to even would be 2 as well
        (2.5, 3),  # and here 2
        (3.4999998, 3),
        (3.5, None),
        (-0.7, None),  # truncation would draw it in column 0
        (-1e9, None),
        (1e9, None),
        (3e38, None),
    ],
)
def test_a_pixel_is_floor_of_u_and_a_half(u: float, column: int | None) -> None:
    # The translation is float64: what float32 points cannot say, it can.
    T_camera_local = np.eye(4)
    T_camera_local[0, 3] = u
    wide = PinholeCamera(4, 1, 1.0, 1.0, 0.0, 0.0)
    tall = PinholeCamera(1, 4, 1.0, 1.0, 0.0, 0.0)
    expected = [] if column is None else [[0, column]]

    across = render_depth(
        [segment((0, 0, 1))], T_camera_local=T_camera_local, camera=wide, stage=EXACT
    )
    T_camera_local[:2, 3] = 0.0, u
    down = render_depth(
        [segment((0, 0, 1))], T_camera_local=T_camera_local, camera=tall, stage=EXACT
    )

    assert np.argwhere(across.depth_m).tolist() == expected
    assert np.argwhere(down.depth_m.T).tolist() == expected
    assert across.points_in_view == down.points_in_view == len(expected)


@pytest.mark.parametrize("order", [(2.0, 3.0, 4.0), (4.0, 3.0, 2.0), (3.0, 2.0, 4.0)])
def test_the_smallest_depth_wins_a_pixel(order: tuple[float, ...]) -> None:
    found = drawn(*[(0.0, 0.0, z) for z in order])

    assert found.depth_m[0, 0] == 2.0
    assert found.points_in_view == 3


def test_depth_is_along_the_axis_and_not_along_the_ray() -> None:
    assert drawn((6.0, 4.0, 2.0)).depth_m[2, 3] == 2.0


@pytest.mark.parametrize(
    ("z", "seen"),
    [
        (0.5, True),
        (math.nextafter(0.5, 0), False),
        (200.0, True),
        (math.nextafter(200.0, 300), False),
        (0.0, False),
        (-0.0, False),
        (-2.0, False),
        (1e-300, False),
    ],
)
def test_the_depth_range_is_inclusive_and_points_behind_are_not_drawn(z: float, seen: bool) -> None:
    T_camera_local = np.eye(4)
    T_camera_local[2, 3] = z

    found = render_depth(
        [segment((0, 0, 0))], T_camera_local=T_camera_local, camera=ONE_TO_ONE, stage=DepthStage()
    )

    assert found.points_in_view == int(seen)
    assert (found.depth_m > 0).sum() == int(seen)


@pytest.mark.parametrize(
    ("z", "stored"),
    [(1.0, 1.0), (1.12, 1.0), (1.125, 1.25), (1.13, 1.25), (1.374, 1.25), (1.375, 1.5)],
)
def test_depth_is_rounded_half_up_to_the_step(z: float, stored: float) -> None:
    assert drawn((0, 0, z), stage=DepthStage(step_m=0.25)).depth_m[0, 0] == stored


def test_the_range_is_asked_before_depth_is_rounded() -> None:
    stage = DepthStage(min_m=1.0, max_m=2.0, step_m=0.25)

    assert drawn((0, 0, 0.99), stage=stage).points_in_view == 0  # though it rounds to 1
    assert drawn((0, 0, 2.01), stage=stage).points_in_view == 0  # though it rounds to 2


def test_without_a_step_the_float32_depth_itself_is_stored() -> None:
    z = np.float32(7.1234567)

    assert drawn((0, 0, float(z))).depth_m[0, 0] == z


def test_no_points_give_an_empty_image() -> None:
    for segments in ([], [segment()]):
        found = render_depth(segments, T_camera_local=np.eye(4), camera=ONE_TO_ONE, stage=EXACT)

        assert found.depth_m.dtype == np.float32
        assert found.depth_m.tolist() == [[0.0] * 4] * 3
        assert found.points_in_view == 0
    assert not np.signbit(found.depth_m).any()


def test_points_that_are_not_finite_leave_no_trace() -> None:
    found = drawn((math.nan, 0, 1), (0, 0, math.nan), (0, 0, math.inf), (math.inf, 0, 1), (1, 1, 1))

    assert np.argwhere(found.depth_m).tolist() == [[1, 1]]
    assert np.isfinite(found.depth_m).all()
    assert found.points_in_view == 1


@pytest.mark.parametrize("count", [2047, 2048, 2049, 4097])
def test_every_point_of_a_long_segment_is_drawn(count: int) -> None:
    camera = PinholeCamera(count, 1, 1.0, 1.0, 0.0, 0.0)
    points = np.zeros((3, count), dtype=np.float32)
    points[0], points[2] = np.arange(count), 1.0

    found = render_depth([points], T_camera_local=np.eye(4), camera=camera, stage=EXACT)

    assert (found.depth_m == 1.0).all()
    assert found.points_in_view == count


def test_products_and_sums_are_rounded_one_by_one() -> None:
    # Depth is big_x * x + big_y * y, where the second product rounds by up to an eighth of a metre.
    # Rounded one by one the two leave 5 m; fused into one operation they leave what was rounded.
    y = np.float32(1.1)
    big_y = (2.0**50 + 1) / 3
    T_camera_local = np.zeros((4, 4))
    T_camera_local[2, :2] = 5.0 - big_y * float(y), big_y
    assert Fraction(big_y) * Fraction(float(y)) != Fraction(big_y * float(y))

    found = render_depth(
        [np.array([[1.0] * 64, [y] * 64, [0.0] * 64], dtype=np.float32)],
        T_camera_local=T_camera_local,
        camera=ONE_TO_ONE,
        stage=EXACT,
    )

    assert found.depth_m[0, 0] == 5.0


def test_what_was_drawn_before_does_not_shine_through() -> None:
    full = drawn(*[(x, y, 1.0) for x in range(4) for y in range(3)])
    empty = drawn()

    assert (full.depth_m == 1).all()
    assert not empty.depth_m.any()
