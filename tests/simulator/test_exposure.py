"""What the shutter does: brightness that settles, and blur along the motion."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from civil_rgbd.simulator.camera import raw_camera, simulate_jpeg
from civil_rgbd.simulator.exposure import exposed
from civil_rgbd.simulator.spec import ScanSpec
from civil_rgbd.simulator.walk import START_NS, camera_poses

CAMERA = raw_camera(0.25).pinhole
GREY = np.full((CAMERA.height_px, CAMERA.width_px, 3), 100, dtype=np.uint8)


def _at_s(seconds: float) -> int:
    return START_NS + round(seconds * 1e9)


def test_by_default_the_picture_stays_what_it_is() -> None:
    assert exposed(GREY, ScanSpec(), _at_s(0.1), CAMERA) is GREY


def test_the_first_pictures_are_over_exposed_and_settle() -> None:
    spec = ScanSpec(exposure_settles_s=0.5)
    values = [int(exposed(GREY, spec, _at_s(s), CAMERA)[0, 0, 0]) for s in (0, 0.1, 0.3, 0.5, 2)]

    assert values == [220, 177, 119, 100, 100]
    white = exposed(GREY + np.uint8(60), spec, _at_s(0.0), CAMERA)
    assert (white == 255).all()


def test_one_who_stands_still_blurs_nothing() -> None:
    spec = ScanSpec(exposure_s=0.05, speed_m_s=0.0)

    assert exposed(GREY, spec, _at_s(1.0), CAMERA) is GREY


def test_a_dot_is_smeared_along_the_way_that_it_moves() -> None:
    spec, dot = ScanSpec(exposure_s=0.1, sway=3.0), np.zeros_like(GREY)
    dot[88:92, 158:162] = 255
    middle = _at_s(2.0)

    smeared = exposed(dot, spec, middle, CAMERA).astype(float)[..., 0]

    rows, columns = np.nonzero(smeared > 20)
    moments = np.cov(np.stack([columns, rows]))
    direction = np.linalg.eigh(moments)[1][:, 1]
    # By hand: a point 6 m ahead of the middle camera, seen at both ends of the exposure.
    ends = camera_poses(spec, middle + np.array([0, -50_000_000, 50_000_000]))
    x, y = (159.5 - CAMERA.cx_px) / CAMERA.fx_px, (89.5 - CAMERA.cy_px) / CAMERA.fy_px
    point = ends[0] @ [6 * x, 6 * y, 6, 1]
    seen = [np.linalg.inv(T) @ point for T in ends[1:]]
    (u0, v0), (u1, v1) = ((CAMERA.fx_px * p[0] / p[2], CAMERA.fy_px * p[1] / p[2]) for p in seen)
    moved = np.array([u1 - u0, v1 - v0])
    assert np.linalg.norm(moved) > 3
    assert abs(direction @ moved) / np.linalg.norm(moved) > 0.9
    assert smeared.sum() == pytest.approx(dot[..., 0].sum(), rel=0.05)


def test_images_of_the_recording_show_it() -> None:
    plain, bright = (
        cv2.imdecode(
            np.frombuffer(
                simulate_jpeg(ScanSpec(image_scale=0.1, exposure_settles_s=s), 0), np.uint8
            ),
            cv2.IMREAD_COLOR,
        )
        for s in (0.0, 1.0)
    )

    assert bright.mean() > 1.3 * plain.mean()
