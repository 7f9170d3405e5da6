"""Cameras: every lens against OpenCV, the half-pixel rule by hand."""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from civil_rgbd.geometry.camera import (
    LensCamera,
    PinholeCamera,
    distort,
    source_pixels,
    valid_radius,
)

from ..reference.undistort import source_of
from ..strategies import finite, lens_cameras, pinhole_cameras, seeds

# The colour camera of a D455 at 1280 x 720, as its driver reports it.
D455 = PinholeCamera(1280, 720, 636.5245361328125, 634.7903442382812, 635.67297, 366.147705)
D455_LENS = (-0.05449240654706955, 0.06359218806028366, 0.00016181448981880032)
D455_LENS += (-0.0009868403431028128, -0.02028072439134121)


def _by_opencv(
    camera: LensCamera, x: NDArray[np.float64], y: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    rays = np.stack([x, y, np.ones_like(x)], axis=-1).reshape(-1, 1, 3)
    still = np.zeros(3)
    k = np.array(camera.coefficients) if camera.coefficients else np.zeros(4)
    project = cv2.fisheye.projectPoints if camera.lens == "fisheye" else cv2.projectPoints
    uv = project(rays, still, still, np.eye(3), k)[0].reshape(-1, 2)
    return uv[:, 0], uv[:, 1]


@given(lens_cameras(), seeds)
def test_every_lens_distorts_as_opencv_projects(camera: LensCamera, seed: int) -> None:
    x, y = np.random.default_rng(seed).uniform(-1.2, 1.2, size=(2, 50))

    found = distort(camera, x, y)

    np.testing.assert_allclose(found, _by_opencv(camera, x, y), rtol=0, atol=1e-12)


def test_a_fisheye_looks_right_at_its_axis_and_almost_sideways() -> None:
    camera = LensCamera(D455, "fisheye", (0.1, -0.03, 0.01, -0.001))
    x = np.array([0.0, 1e-12, 50.0])

    found = distort(camera, x, np.zeros(3))[0]

    np.testing.assert_allclose(found, _by_opencv(camera, x, np.zeros(3))[0], rtol=0, atol=1e-12)


def test_one_coefficient_at_a_time_by_hand() -> None:
    # At (0.5, 0.25): r2 = 0.3125, xy = 0.125.
    x, y = np.array([0.5]), np.array([0.25])
    moved = {
        i: [float(a[0]) for a in distort(LensCamera(D455, "plumb_bob", coefficients), x, y)]
        for i, coefficients in enumerate(np.eye(5).tolist())
        for coefficients in [tuple(coefficients)]
    }

    assert moved[0] == pytest.approx([0.5 * 1.3125, 0.25 * 1.3125])  # k1 r2
    assert moved[1] == pytest.approx([0.5 * 1.09765625, 0.25 * 1.09765625])  # k2 r4
    assert moved[2] == pytest.approx([0.5 + 0.25, 0.25 + 0.3125 + 0.125])  # p1: 2xy, r2 + 2y2
    assert moved[3] == pytest.approx([0.5 + 0.3125 + 0.5, 0.25 + 0.25])  # p2: r2 + 2x2, 2xy
    assert moved[4] == pytest.approx([0.5 * 1.030517578125, 0.25 * 1.030517578125])  # k3 r6


# --- source pixels ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("lens", "k"),
    [
        ("none", ()),
        ("plumb_bob", D455_LENS),
        ("plumb_bob", (-0.2, 0.05, 0.002, -0.003)),
        ("rational_polynomial", (0.2, -0.1, 0.001, -0.002, 0.01, 0.1, -0.05, 0.01)),
    ],
)
def test_at_scale_1_the_lookup_is_opencvs_undistortion_map(lens: str, k: tuple[float]) -> None:
    raw = LensCamera(D455, lens, k)
    columns, rows = cv2.initUndistortRectifyMap(
        D455.matrix, np.array(k), None, D455.matrix, (1280, 720), cv2.CV_32FC1
    )

    found = source_pixels(raw, D455)

    np.testing.assert_allclose(found.columns, columns, rtol=0, atol=2e-4)
    np.testing.assert_allclose(found.rows, rows, rtol=0, atol=2e-4)


def test_at_scale_1_the_lookup_of_a_fisheye_is_opencvs() -> None:
    k = (0.05, -0.01, 0.004, -0.001)
    columns, rows = cv2.fisheye.initUndistortRectifyMap(
        D455.matrix, np.array(k), np.eye(3), D455.matrix, (1280, 720), cv2.CV_32FC1
    )

    found = source_pixels(LensCamera(D455, "fisheye", k), D455)

    np.testing.assert_allclose(found.columns, columns, rtol=0, atol=2e-4)
    np.testing.assert_allclose(found.rows, rows, rtol=0, atol=2e-4)


@given(lens_cameras(), finite(0.2, 2.5), st.floats(0, 1), st.floats(0, 1))
def test_at_any_scale_the_lookup_is_the_sum_done_by_hand(
    raw: LensCamera, scale: float, across: float, down: float
) -> None:
    stored = raw.pinhole.scaled(scale)
    column, row = (
        math.floor(across * (stored.width_px - 1)),
        math.floor(down * (stored.height_px - 1)),
    )
    K = (raw.pinhole.fx_px, raw.pinhole.fy_px, raw.pinhole.cx_px, raw.pinhole.cy_px)
    expected = source_of(
        column,
        row,
        size=(raw.pinhole.width_px, raw.pinhole.height_px),
        K=K,
        lens=raw.lens,
        k=raw.coefficients,
        scale=scale,
    )

    found = source_pixels(raw, stored)

    pixel = (found.columns[row, column], found.rows[row, column])
    # float32 of the lookup: 2^-24 of a coordinate.
    np.testing.assert_allclose(pixel, expected, rtol=2e-7, atol=1e-5)


def test_a_pixel_exists_up_to_the_edge_of_the_raw_image_and_no_further() -> None:
    raw = LensCamera(PinholeCamera(4, 2, 2.0, 2.0, 1.5, 0.5))
    # Stored columns look at raw columns -1, -0.5, 0, .. 3.5, 4: edges lie at -0.5 and 3.5.
    stored = PinholeCamera(11, 7, 4.0, 4.0, 5.0, 3.0)

    found = source_pixels(raw, stored)

    assert found.columns[0].tolist() == [-1, -0.5, 0, 0.5, 1, 1.5, 2, 2.5, 3, 3.5, 4]
    assert found.exists[3].tolist() == [False] + [True] * 9 + [False]
    assert found.rows[:, 0].tolist() == [-1, -0.5, 0, 0.5, 1, 1.5, 2]
    assert found.exists[:, 5].tolist() == [False] + [True] * 5 + [False]


@pytest.mark.parametrize("scale", [0.3, 0.6, 1.0, 1.7])
def test_without_distortion_every_stored_pixel_has_a_source(scale: float) -> None:
    assert source_pixels(LensCamera(D455), D455.scaled(scale)).exists.all()


# --- the valid radius -------------------------------------------------------------------------


def test_a_barrel_lens_is_valid_up_to_where_it_folds_back() -> None:
    # r (1 - 0.3 r2) grows up to r = sqrt(1 / 0.9).
    lens = LensCamera(D455, "plumb_bob", (-0.3, 0.0, 0.0, 0.0))

    assert valid_radius(lens, 2.0) == pytest.approx(math.sqrt(1 / 0.9), abs=2.0 / 8192)
    assert valid_radius(lens, 1.0) == 1.0


def test_pixels_beyond_the_fold_have_no_source_though_the_formula_lands_inside_the_image() -> None:
    pinhole = PinholeCamera(101, 101, 20.0, 20.0, 50.0, 50.0)  # sees up to r = 2.5
    raw = LensCamera(pinhole, "plumb_bob", (-0.3, 0.0, 0.0, 0.0))

    found = source_pixels(raw, pinhole)

    row = found.exists[50]
    reach = math.floor(20 * math.sqrt(1 / 0.9))  # 21 columns
    assert np.flatnonzero(row).tolist() == list(range(50 - reach, 51 + reach))
    # At r = 1.8, r (1 - 0.3 r2) = 0.05: the formula folds that ray onto the image's middle.
    assert 50 <= found.columns[50, 50 + 36] < 52
    assert not found.exists[50, 50 + 36]


def test_a_lens_that_never_folds_is_valid_everywhere() -> None:
    assert valid_radius(LensCamera(D455, "plumb_bob", D455_LENS), 1.2) == 1.2
    assert valid_radius(LensCamera(D455), 7.0) == 7.0
    assert valid_radius(LensCamera(D455, "fisheye", (0.0, 0.0, 0.0, 0.0)), 50.0) == 50.0


def test_a_rational_lens_is_valid_up_to_its_pole_at_most() -> None:
    # 1 - r2 below: a pole at r = 1.
    lens = LensCamera(D455, "rational_polynomial", (0.0,) * 5 + (-1.0, 0.0, 0.0))

    assert 0.99 < valid_radius(lens, 3.0) <= 1.0


# --- the pinhole ------------------------------------------------------------------------------


def test_the_matrix_is_opencvs() -> None:
    camera = PinholeCamera(10, 20, 1.0, 2.0, 3.0, 4.0)

    assert camera.matrix.tolist() == [[1, 0, 3], [0, 2, 4], [0, 0, 1]]


def test_scaling_moves_the_principal_point_by_the_half_pixel_rule() -> None:
    # 1280 x 720 by 0.6: sx = sy = 0.6 exactly.
    camera = D455.scaled(0.6)

    assert (camera.width_px, camera.height_px) == (768, 432)
    assert camera.cx_px == pytest.approx((635.67297 + 0.5) * 0.6 - 0.5)
    assert camera.cy_px == pytest.approx((366.147705 + 0.5) * 0.6 - 0.5)
    assert camera.fx_px == pytest.approx(636.5245361328125 * 0.6)
    assert camera.fy_px == pytest.approx(634.7903442382812 * 0.6)


def test_a_ray_meets_the_same_spot_of_the_scene_at_every_scale() -> None:
    # The right edge of the image (u = W - 0.5) stays the right edge, the left one (-0.5) the left.
    for scale in (0.2, 0.37, 0.6, 1.0, 2.3):
        small = D455.scaled(scale)
        for edge in (-0.5, D455.width_px - 0.5):
            ray = (edge - D455.cx_px) / D455.fx_px
            at = -0.5 if edge < 0 else small.width_px - 0.5
            assert small.fx_px * ray + small.cx_px == pytest.approx(at, abs=1e-9)


@pytest.mark.parametrize(
    ("raw", "scale", "stored"),
    [(5, 0.5, 3), (5, 0.3, 2), (7, 0.5, 4), (1242, 0.6, 745), (375, 0.6, 225), (3, 0.1, 1)],
)
def test_sizes_round_half_up(raw: int, scale: float, stored: int) -> None:
    camera = PinholeCamera(raw, raw + 100, 1.0, 1.0, 0.0, 0.0).scaled(scale)
    turned = PinholeCamera(raw + 100, raw, 1.0, 1.0, 0.0, 0.0).scaled(scale)

    assert (camera.width_px, turned.height_px) == (stored, stored)


def test_each_axis_has_the_factor_of_its_own_rounded_size() -> None:
    # 5 x 10 by 0.5: 3 x 5, so sx = 0.6 and sy = 0.5.
    camera = PinholeCamera(5, 10, 10.0, 10.0, 2.0, 4.5).scaled(0.5)

    assert (camera.width_px, camera.height_px) == (3, 5)
    assert (camera.fx_px, camera.fy_px) == pytest.approx((6.0, 5.0))
    assert (camera.cx_px, camera.cy_px) == pytest.approx((1.0, 2.0))


@given(pinhole_cameras())
def test_scaling_by_1_changes_nothing(camera: PinholeCamera) -> None:
    scaled = camera.scaled(1.0)

    assert (scaled.width_px, scaled.height_px) == (camera.width_px, camera.height_px)
    assert scaled.fx_px == camera.fx_px
    assert scaled.cx_px == pytest.approx(camera.cx_px, abs=1e-12)


def test_cropping_shifts_the_principal_point() -> None:
    window = D455.cropped(left_px=100, top_px=-20, width_px=300, height_px=200)

    assert (window.width_px, window.height_px) == (300, 200)
    assert (window.cx_px, window.cy_px) == (D455.cx_px - 100, D455.cy_px + 20)
    assert (window.fx_px, window.fy_px) == (D455.fx_px, D455.fy_px)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"width_px": 0}, "no pixels: 0 x 720"),
        ({"fx_px": 0.0}, "not positive"),
        ({"fy_px": -480.0}, "not positive"),
        ({"cx_px": math.nan}, "not finite"),
        ({"fx_px": math.inf}, "not finite"),
    ],
)
def test_impossible_pinholes_are_refused(change: dict[str, float], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        replace(D455, **change)


@pytest.mark.parametrize(
    ("lens", "k", "words"),
    [
        ("pinhole", (), "'pinhole' is none of none, plumb_bob"),
        ("plumb_bob", (0.1,), "takes .4, 5. coefficients, not 1"),
        ("fisheye", (0.1,) * 5, "not 5"),
        ("plumb_bob", (0.1, math.nan, 0.0, 0.0), "not finite"),
    ],
)
def test_impossible_lenses_are_refused(lens: str, k: tuple[float, ...], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        LensCamera(D455, lens, k)


def test_zero_coefficients_do_not_distort_but_a_fisheye_always_does() -> None:
    assert not LensCamera(D455, "plumb_bob", (0.0,) * 5).distorts
    assert LensCamera(D455, "plumb_bob", (0.0, 0.0, 0.0, 1e-9, 0.0)).distorts
    assert LensCamera(D455, "fisheye", (0.0,) * 4).distorts
