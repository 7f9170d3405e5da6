"""Rig files: what they say, and what they may not."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from civil_rgbd.domain.rig import Rig
from civil_rgbd.errors import UsageError
from civil_rgbd.geometry.camera import LensCamera, PinholeCamera
from civil_rgbd.trajectories.rig import RigFile, read_rig, rig_from_document

CAMERA = {"width_px": 4, "height_px": 3, "fx_px": 5, "fy_px": 6.5, "cx_px": 1, "cy_px": 2}


def said(text: str) -> RigFile:
    return rig_from_document(tomllib.loads(text), where="rig.toml")


def test_an_empty_file_says_nothing() -> None:
    rig = said("")
    assert (rig.camera, rig.rectified, dict(rig.extrinsics)) == (None, False, {})
    assert (rig.camera_time_offset_s, rig.map_up, rig.lidar_name) == (None, None, None)


def test_a_camera_with_its_lens(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    lines = [f"{name} = {value}" for name, value in CAMERA.items()]
    lens = "lens = 'plumb_bob'\ncoefficients = [0.1, 0, 0, 0, 0]\n"
    path.write_text("[camera]\n" + "\n".join(lines) + "\n" + lens)
    camera = read_rig(path).camera
    assert camera is not None
    assert (camera.pinhole.width_px, camera.pinhole.height_px) == (4, 3)
    assert (camera.pinhole.fx_px, camera.pinhole.fy_px) == (5, 6.5)
    assert (camera.pinhole.cx_px, camera.pinhole.cy_px) == (1, 2)
    assert (camera.lens, camera.coefficients) == ("plumb_bob", (0.1, 0, 0, 0, 0))


def test_rows_and_quaternion_say_the_same() -> None:
    q = Rotation.from_euler("xyz", [0.3, -0.2, 1.1])
    rows = np.eye(4)
    rows[:3, :3], rows[:3, 3] = q.as_matrix(), [1, 2, 3]
    given = {"translation_m": [1, 2, 3], "quaternion_xyzw": (-q.as_quat()).tolist()}
    document = {"extrinsics": {"T_imu_camera": rows.tolist(), "T_imu_lidar": given}}
    rig = rig_from_document(document, where="")
    assert np.allclose(rig.extrinsics["imu", "camera"], rows, atol=1e-12)
    assert np.allclose(rig.extrinsics["imu", "lidar"], rows, atol=1e-12)


def test_numbers_typed_with_four_digits_become_a_rotation() -> None:
    turn = Rotation.from_euler("z", 30, degrees=True).as_matrix().round(4)
    rows = np.eye(4)
    rows[:3, :3] = turn
    document = {"extrinsics": {"T_lidar_camera": rows.tolist()}}
    R = rig_from_document(document, where="").extrinsics["lidar", "camera"][:3, :3]
    assert np.abs(R @ R.T - np.eye(3)).max() < 1e-12
    assert np.abs(R - turn).max() < 1e-4


@pytest.mark.parametrize(
    ("key", "offset_s"),
    [
        ("camera_time_offset_s", -0.25),
        ("r3live_time_offset_s", -0.25),  # image time + td = LiDAR time
        ("kalibr_timeshift_cam_imu_s", -0.25),  # t_imu = t_cam + shift
    ],
)
def test_time_offsets_are_added_to_image_stamps(key: str, offset_s: float) -> None:
    assert said(f"{key} = -0.25").camera_time_offset_s == offset_s


def test_two_time_offsets_contradict() -> None:
    with pytest.raises(UsageError, match="more than once") as caught:
        said("camera_time_offset_s = 0\nr3live_time_offset_s = 1")
    assert "keep one" in caught.value.fix


def test_names_up_and_rectified() -> None:
    rig = said("map_up = [0, 3, 4]\n[sensors]\ncamera = 'D455'\n[camera]\nrectified = true")
    assert rig.map_up == (0.0, 0.6, 0.8)
    assert (rig.camera_name, rig.lidar_name) == ("D455", None)
    assert rig.rectified
    assert rig.camera is None


MIRROR = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, -1, 0], [0, 0, 0, 1]]
SHEAR = [[1, 0.1, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]


@pytest.mark.parametrize(
    ("document", "says", "where"),
    [
        ({"camra": {}}, "unknown key 'camra'", "rig.toml"),
        ({"camera": {"fx": 3}}, "unknown key 'fx'", "rig.toml: camera"),
        ({"extrinsics": {"T_camera_lidar": MIRROR}}, "unknown key 'T_camera_lidar'", "extrinsics"),
        ({"camera_time_offset_s": 1e10}, "greater than the maximum", "camera_time_offset_s"),
        ({"r3live_time_offset_s": -1e300}, "less than the minimum", "r3live_time_offset_s"),
        ({"kalibr_timeshift_cam_imu_s": float("inf")}, "greater", "kalibr_timeshift_cam_imu_s"),
        ({"camera": {"width_px": 3}}, "'height_px' is a dependency", "rig.toml: camera"),
        ({"camera": {**CAMERA, "fx_px": -5}}, "-5 is less than or equal", "camera.fx_px"),
        ({"camera": {**CAMERA, "lens": "omni"}}, "'omni' is not one of", "camera.lens"),
        (
            {"camera": {**CAMERA, "lens": "fisheye", "coefficients": [1]}},
            "takes .* coefficients, not 1",
            "camera",
        ),
        ({"camera": {**CAMERA, "lens": "fisheye", "rectified": True}}, "has a lens", "camera"),
        ({"extrinsics": {"T_lidar_camera": MIRROR}}, "mirrors", "extrinsics.T_lidar_camera"),
        ({"extrinsics": {"T_lidar_camera": SHEAR}}, "not orthonormal", "T_lidar_camera"),
        ({"extrinsics": {"T_lidar_camera": [[1]]}}, "too short", "extrinsics.T_lidar_camera"),
        (
            {"extrinsics": {"T_lidar_camera": {"translation_m": [0, 0, 0]}}},
            "'quaternion_xyzw' is a required",
            "T_lidar_camera",
        ),
        (
            {
                "extrinsics": {
                    "T_lidar_camera": {"translation_m": [0, 0, 0], "quaternion_xyzw": [0, 0, 0, 2]}
                }
            },
            "norm 2, not 1",
            "T_lidar_camera",
        ),
        ({"map_up": [0, 0, 0]}, "length 0", "map_up"),
        ({"camera_time_offset_s": float("nan")}, "is nan", "rig.toml"),
    ],
)
def test_what_does_not_fit_is_said_with_its_place(
    document: dict[str, Any], says: str, where: str
) -> None:
    with pytest.raises(UsageError, match=says) as caught:
        rig_from_document(document, where="rig.toml")
    assert where in caught.value.where
    assert caught.value.fix


def test_an_unknown_key_names_the_nearest() -> None:
    with pytest.raises(UsageError, match="unknown key") as caught:
        said("camera_time_offset = 1")
    assert "did you mean 'camera_time_offset_s'" in caught.value.fix


@pytest.mark.parametrize(
    ("given", "known"),
    [
        ("T_camera_lidar", "T_lidar_camera"),
        ("T_camera_imu", "T_imu_camera"),
        ("T_lidar_imu", "T_imu_lidar"),
        ("T_camera_body", "T_body_camera"),
        ("T_lidar_body", "T_body_lidar"),
    ],
)
def test_a_transform_the_other_way_round_is_to_be_inverted(given: str, known: str) -> None:
    with pytest.raises(UsageError, match="unknown key") as caught:
        rig_from_document({"extrinsics": {given: np.eye(4).tolist()}}, where="")
    assert f"give its inverse as {known}" in caught.value.fix


def test_a_transform_between_unknown_frames_is_no_inverse() -> None:
    with pytest.raises(UsageError, match="unknown key") as caught:
        rig_from_document({"extrinsics": {"T_lidar_cam": np.eye(4).tolist()}}, where="")
    assert "did you mean 'T_lidar_camera'" in caught.value.fix


@pytest.mark.parametrize("name", ["fx_px", "fy_px"])
def test_a_negative_focal_length_says_what_to_do(name: str) -> None:
    with pytest.raises(UsageError, match="less than or equal to the minimum") as caught:
        rig_from_document({"camera": {**CAMERA, name: -5.0}}, where="")
    assert "civil-rgbd convert" in caught.value.fix
    assert "positive" in caught.value.fix


@pytest.mark.parametrize("offset_s", [1.8e9, -4e9])
def test_an_offset_between_power_on_and_1970_is_taken(offset_s: float) -> None:
    rig = rig_from_document({"camera_time_offset_s": offset_s}, where="")
    assert rig.camera_time_offset_s == offset_s


@pytest.mark.parametrize("offset_s", [4.1e9, -1e300, float("nan")])
def test_no_rig_has_an_offset_that_stamps_cannot_take(offset_s: float) -> None:
    camera = LensCamera(PinholeCamera(4, 3, 5.0, 5.0, 1.5, 1.0))
    with pytest.raises(ValueError, match="camera_time_offset_s is"):
        Rig(camera, np.eye(4), np.eye(4), camera_time_offset_s=offset_s)
    latest_ns = np.array([2**32 * 10**9], dtype=np.int64)
    most = Rig(camera, np.eye(4), np.eye(4), camera_time_offset_s=4e9)
    assert (latest_ns + most.camera_time_offset_ns).tolist() == [2**32 * 10**9 + 4 * 10**18]


def test_no_file_and_no_toml_are_said(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="cannot be read") as caught:
        read_rig(tmp_path / "missing.toml")
    assert "--rig" in caught.value.fix
    (tmp_path / "rig.toml").write_text("[camera\n")
    with pytest.raises(UsageError, match="not TOML"):
        read_rig(tmp_path / "rig.toml")
