"""Rig files written and read back."""

from __future__ import annotations

import tomllib
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from civil_rgbd.domain.rig import RigFile
from civil_rgbd.geometry.camera import LensCamera, PinholeCamera
from civil_rgbd.geometry.transforms import inverse
from civil_rgbd.trajectories.rig import rig_from_document
from civil_rgbd.trajectories.rig_text import rig_to_text

from ..strategies import rigid_transforms

PINHOLE = PinholeCamera(1280, 720, 636.5245361328125, 634.7903442382812, 635.67, 366.14)
WHOLE = RigFile(
    camera=LensCamera(PINHOLE, "plumb_bob", (-0.054, 0.0636, 1.6e-4, -0.00098, -0.02)),
    extrinsics={("imu", "lidar"): np.eye(4)},
    camera_time_offset_s=-8.125e-05,
    camera_name='D455 "left"',
    lidar_name="Livox Avia\x7f",
    map_up=(0.0, 0.6, 0.8),
)


def read_back(rig: RigFile, remarks: tuple[str, ...] = ()) -> RigFile:
    return rig_from_document(tomllib.loads(rig_to_text(rig, remarks)), where="rig.toml")


def test_everything_comes_back() -> None:
    again = read_back(WHOLE, ("a remark", "another\nwith a line break\x00"))

    assert again.camera == WHOLE.camera
    assert again.camera_time_offset_s == WHOLE.camera_time_offset_s
    assert (again.camera_name, again.lidar_name) == (WHOLE.camera_name, WHOLE.lidar_name)
    assert again.map_up == WHOLE.map_up
    assert list(again.extrinsics) == [("imu", "lidar")]


def test_nothing_comes_back_as_nothing() -> None:
    again = read_back(RigFile())
    assert (again.camera, dict(again.extrinsics), again.camera_time_offset_s) == (None, {}, None)


@pytest.mark.parametrize("camera", [None, LensCamera(PINHOLE)])
def test_rectified_comes_back(camera: LensCamera | None) -> None:
    again = read_back(replace(WHOLE, camera=camera, rectified=True))
    assert again.rectified
    assert again.camera == camera


@given(rigid_transforms(), st.sampled_from(["lidar", "imu", "body"]))
def test_transforms_come_back_bit_by_bit(T: np.ndarray, a: str) -> None:
    again = read_back(RigFile(extrinsics={(a, "camera"): T}))
    assert np.array_equal(again.extrinsics[a, "camera"], T)


def test_a_transform_that_no_key_holds_is_turned_round() -> None:
    T = np.eye(4)
    T[:3, 3] = 1, 2, 3
    again = read_back(RigFile(extrinsics={("camera", "lidar"): T}))
    assert np.array_equal(again.extrinsics["lidar", "camera"], inverse(T))


def test_directions_stand_in_words_beside_the_numbers() -> None:
    text = rig_to_text(
        replace(WHOLE, extrinsics={("imu", "camera"): np.eye(4), **WHOLE.extrinsics})
    )
    assert "# the camera sits at x 0.000, y 0.000, z 0.000 m of the IMU, looks along its +z" in text
    assert (
        "# the LiDAR sits at x 0.000, y 0.000, z 0.000 m of the IMU, its axes are parallel" in text
    )
