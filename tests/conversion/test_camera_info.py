"""CameraInfo to a camera: models, windows, bins, rectified images."""

from __future__ import annotations

from typing import Any

import pytest

from civil_rgbd.conversion.camera_info import camera_from_info, parse_camera_info
from civil_rgbd.errors import RecordingError
from civil_rgbd.geometry.camera import LensCamera, PinholeCamera

from . import messages


def camera(*, rectified: bool = False, **what: Any) -> LensCamera:
    info = parse_camera_info(memoryview(messages.camera_info(**what)))
    return camera_from_info(info, rectified=rectified, where="test")


def test_raw_images_take_k_and_d() -> None:
    made = camera(d=(0.1, -0.2, 0.001, 0.002, 0.3))
    assert made.pinhole == PinholeCamera(64, 48, 50.0, 50.0, 31.5, 23.5)
    assert (made.lens, made.coefficients) == ("plumb_bob", (0.1, -0.2, 0.001, 0.002, 0.3))


def test_rectified_images_take_p_and_no_distortion() -> None:
    made = camera(d=(0.1, -0.2, 0.001, 0.002, 0.3), rectified=True)
    assert made.pinhole == PinholeCamera(64, 48, 40.0, 41.0, 30.0, 22.0)
    assert made.lens == "none"


def test_rectified_without_p_takes_k() -> None:
    assert camera(rectified=True, p=(0,) * 12).pinhole.fx_px == 50.0


@pytest.mark.parametrize(
    ("model", "d", "lens", "coefficients"),
    [
        ("plumb_bob", (0.1, 0.2, 0.3, 0.4), "plumb_bob", (0.1, 0.2, 0.3, 0.4, 0)),
        ("plumb_bob", (0.1, 0, 0, 0, 0, 0, 0, 0), "plumb_bob", (0.1, 0, 0, 0, 0)),
        ("plumb_bob", (0,) * 5, "none", ()),
        ("rational_polynomial", tuple(range(1, 9)), "rational_polynomial", tuple(range(1, 9))),
        ("rational_polynomial", (1, 2, 3, 4, 5), "rational_polynomial", (1, 2, 3, 4, 5, 0, 0, 0)),
        (
            "rational_polynomial",
            (*range(1, 13), 0, 0),
            "rational_polynomial",
            tuple(range(1, 13)),
        ),
        ("equidistant", (1, 2, 3, 4), "fisheye", (1, 2, 3, 4)),
        ("fisheye", (0, 0, 0, 0), "fisheye", (0, 0, 0, 0)),
        ("kannala_brandt4", (1, 2, 3, 4, 0), "fisheye", (1, 2, 3, 4)),
        ("", (), "none", ()),
        ("", (0, 0, 0, 0, 0), "none", ()),
        ("inverse_brown_conrady", (0, 0, 0, 0, 0), "none", ()),
    ],
)
def test_lens_models(
    model: str, d: tuple[float, ...], lens: str, coefficients: tuple[float, ...]
) -> None:
    made = camera(model=model, d=d)
    assert (made.lens, made.coefficients) == (lens, coefficients)


@pytest.mark.parametrize(
    ("what", "says"),
    [
        ({"model": "omni", "d": (1.0,)}, "'omni' is none of plumb_bob"),
        ({"model": "", "d": (0.1, 0.0)}, "'' is none of"),
        ({"model": "plumb_bob", "d": (0.1, 0.2)}, "takes 5 coefficients, D has 2"),
        ({"model": "plumb_bob", "d": (1, 2, 3, 4, 5, 6)}, "takes 5 coefficients, D has 6"),
        ({"model": "rational_polynomial", "d": tuple(range(14))}, "D has 14"),
        ({"model": "fisheye", "d": (1, 2)}, "takes 4 coefficients, D has 2"),
        ({"d": (float("nan"), 0, 0, 0, 0)}, "not finite"),
        ({"k": (-50, 0, 31, 0, 50, 23, 0, 0, 1)}, "not positive"),
        ({"size": (0, 0)}, "no pixels"),
    ],
)
def test_what_makes_no_camera_is_refused(what: dict[str, Any], says: str) -> None:
    with pytest.raises(RecordingError, match=says) as caught:
        camera(**what)
    assert "--rig" in caught.value.fix


def test_bins_keep_the_centre_where_it_is() -> None:
    # A pixel at the principal point of the full image; two by two become one.
    made = camera(binning=(2, 2)).pinhole
    assert made == PinholeCamera(32, 24, 25.0, 25.0, 15.5, 11.5)


def test_axes_bin_apart_and_zero_means_one() -> None:
    made = camera(binning=(0, 2)).pinhole
    assert (made.width_px, made.height_px, made.fx_px, made.fy_px) == (64, 24, 50.0, 25.0)


def test_a_window_moves_the_principal_point() -> None:
    made = camera(roi=(10, 4, 30, 20)).pinhole
    assert made == PinholeCamera(30, 20, 50.0, 50.0, 21.5, 19.5)


def test_window_then_bins() -> None:
    made = camera(roi=(10, 4, 31, 20), binning=(2, 4)).pinhole
    assert (made.width_px, made.height_px) == (15, 5)
    assert (made.cx_px, made.cy_px) == ((21.5 + 0.5) / 2 - 0.5, (19.5 + 0.5) / 4 - 0.5)


def test_k_of_zero_is_uncalibrated() -> None:
    info = parse_camera_info(memoryview(messages.camera_info(k=(0,) * 9)))
    assert not info.calibrated
