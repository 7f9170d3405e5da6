"""Calibrations of other programs: what each says, which way round, and what is refused.

The way round is told from the program's own words: a point goes by its formula from one sensor to
the other, and the imported transform must bring it back.
"""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from civil_rgbd.domain.rig import RigFile
from civil_rgbd.errors import UsageError
from civil_rgbd.geometry.transforms import transform_points
from civil_rgbd.trajectories.rig_importers.formats import FORMATS, import_rig, merged
from civil_rgbd.trajectories.rig_importers.values import ImportedRig, Request

from . import calibrations as files

pytest.importorskip("yaml", reason="YAML calibrations need the extra [rig]")

POINT = np.array([[1.0, 2.0, 3.0]])
R_CAMERA_AHEAD = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])
"""Takes x forward, y left, z up to x right, y down, z forward."""


def imported(
    folder: Path, *texts: str, format_name: str | None = None, request: Request | None = None
) -> ImportedRig:
    paths = []
    for number, text in enumerate(texts):
        paths.append(folder / f"file{number}.yaml")
        paths[-1].write_text(text, encoding="utf-8")
    return import_rig(paths, format_name, request)[1]


def by_formula(R: NDArray[np.float64], t: list[float]) -> NDArray[np.float64]:
    moved: NDArray[np.float64] = (R @ POINT.T).T + t
    return moved


def camera_of(rig: RigFile) -> tuple[object, ...]:
    assert rig.camera is not None
    p = rig.camera.pinhole
    size = (p.width_px, p.height_px)
    return (size, (p.fx_px, p.fy_px, p.cx_px, p.cy_px), rig.camera.lens, rig.camera.coefficients)


@pytest.mark.parametrize(
    ("texts", "name"),
    [
        ((files.R3LIVE,), "r3live"),
        ((files.FAST_LIVO2,), "fast-livo2"),
        ((files.FAST_LIVO2_CAMERA,), "fast-livo2"),
        ((files.FAST_LIVO2, files.FAST_LIVO2_FISHEYE), "fast-livo2"),
        ((files.LIVOX_EXTRINSIC,), "livox-camera-calib"),
        ((files.LIVOX_EXTRINSIC, files.LIVOX_CAMERA), "livox-camera-calib"),
        ((files.ROS_CAMERA_INFO,), "ros-camera-info"),
        ((files.ROS_ECHO,), "ros-camera-info"),
        ((files.OPENCV,), "opencv"),
        ((files.OPENCALIB_EXTRINSIC, files.OPENCALIB_INTRINSIC), "opencalib"),
    ],
)
def test_a_format_is_told_by_its_content(tmp_path: Path, texts: tuple[str, ...], name: str) -> None:
    paths = [tmp_path / str(number) for number in range(len(texts))]
    for path, text in zip(paths, texts, strict=True):
        path.write_text(text)
    assert import_rig(paths)[0] == name


def test_every_format_but_the_ones_that_need_more_is_told_too(tmp_path: Path) -> None:
    kalibr, direct = Request(camera="cam0"), Request(image_size_px=(1600, 1200))
    assert imported(tmp_path, files.KALIBR, request=kalibr).rig.camera is not None
    assert imported(tmp_path, files.DIRECT_VISUAL, request=direct).rig.camera is not None


def test_r3live_gives_the_cameras_pose_in_the_imu_frame(tmp_path: Path) -> None:
    said = imported(tmp_path, files.R3LIVE)

    # p_imu = R p_camera + t
    p_imu = by_formula(R_CAMERA_AHEAD.T, [0.05, 0.04, -0.03])
    T_imu_camera = said.rig.extrinsics["imu", "camera"]
    np.testing.assert_allclose(transform_points(T_imu_camera, POINT), p_imu)
    np.testing.assert_allclose(
        said.rig.extrinsics["imu", "lidar"][:3, 3], [0.04165, 0.02326, -0.0284]
    )
    assert camera_of(said.rig) == (
        (1280, 1024),
        (860.5, 861.5, 640.25, 518.5),
        "plumb_bob",
        (-0.1, 0.1, -1.25e-4, 5e-5, -0.02),
    )
    assert said.remarks[0].startswith(
        "camera_ext_R and camera_ext_t are the camera's pose in the IMU frame: the camera sits at "
        "x 0.050, y 0.040, z -0.030 m of the IMU, looks along its +x"
    )
    assert "taken for a Livox Avia" in said.remarks[1]


def test_r3live_with_another_lidar_says_that_its_place_is_missing(tmp_path: Path) -> None:
    said = imported(tmp_path, files.R3LIVE.replace("lidar_type: 1", "lidar_type: 3"))
    assert list(said.rig.extrinsics) == [("imu", "camera")]
    assert said.remarks[1] == "the file does not say where the LiDAR sits: add T_imu_lidar"


def test_fast_livo2_takes_lidar_points_to_the_camera(tmp_path: Path) -> None:
    said = imported(tmp_path, files.FAST_LIVO2, files.FAST_LIVO2_CAMERA)

    p_camera = by_formula(R_CAMERA_AHEAD, [0.02, 0.1, -0.03])  # p_c = Rcl p_l + Pcl
    T_lidar_camera = said.rig.extrinsics["lidar", "camera"]
    np.testing.assert_allclose(transform_points(T_lidar_camera, p_camera), POINT, atol=1e-12)
    # extrinsic_T is where the LiDAR sits in the IMU frame.
    np.testing.assert_allclose(
        said.rig.extrinsics["imu", "lidar"][:3, 3], [0.04165, 0.02326, -0.0284]
    )
    assert said.rig.camera_time_offset_s == 0.1  # added to image stamps; not imu_time_offset
    assert camera_of(said.rig) == (
        (1280, 1024),  # of the full image, whatever scale says
        (1290.5, 1291.5, 626.5, 522.5),
        "plumb_bob",
        (-0.076, 0.123, -0.00113, 0.000251),
    )
    assert any(remark.startswith("scale 0.5") for remark in said.remarks)


def test_fast_livo2s_fisheye(tmp_path: Path) -> None:
    said = imported(tmp_path, files.FAST_LIVO2_FISHEYE)
    assert camera_of(said.rig)[2:] == ("fisheye", (-0.037, -0.0089, 0.0089, -0.0038))
    assert "no file gives extrinsics" in said.remarks[0]


def test_livox_camera_calib_takes_lidar_points_to_the_camera(tmp_path: Path) -> None:
    said = imported(tmp_path, files.LIVOX_EXTRINSIC, files.LIVOX_CAMERA)

    p_camera = by_formula(R_CAMERA_AHEAD, [-0.0138, 0.0347, -0.0972])
    T_lidar_camera = said.rig.extrinsics["lidar", "camera"]
    np.testing.assert_allclose(transform_points(T_lidar_camera, p_camera), POINT, atol=1e-12)
    assert camera_of(said.rig) == (
        (1920, 1080),
        (1364.5, 1366.5, 958.25, 535.125),
        "plumb_bob",
        (0.0958, -0.1982, -0.000147, -0.00043, 0.0),
    )


def test_livox_camera_calibs_yaml_needs_the_image_size(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="how large the image is") as caught:
        imported(tmp_path, files.LIVOX_EXTRINSIC, files.LIVOX_CALIB)
    assert "--image-size" in caught.value.fix
    size = Request(image_size_px=(1920, 1080))
    said = imported(tmp_path, files.LIVOX_EXTRINSIC, files.LIVOX_CALIB, request=size)
    assert camera_of(said.rig)[0] == (1920, 1080)


def test_kalibr_takes_imu_points_to_the_camera(tmp_path: Path) -> None:
    said = imported(tmp_path, files.KALIBR, request=Request(camera="cam0"))

    p_camera = by_formula(R_CAMERA_AHEAD, [0.07, -0.02, 0.004])  # p_cam = T_cam_imu p_imu
    T_imu_camera = said.rig.extrinsics["imu", "camera"]
    np.testing.assert_allclose(transform_points(T_imu_camera, p_camera), POINT, atol=1e-12)
    assert said.rig.camera_time_offset_s == -8.125e-05  # t_imu = t_cam + shift
    assert camera_of(said.rig) == (
        (752, 480),
        (461.5, 460.25, 362.75, 246.125),
        "plumb_bob",
        (-0.277, 0.0671, 0.000876, 1.5e-4),
    )


def test_kalibrs_second_camera_has_a_lens_but_no_place(tmp_path: Path) -> None:
    said = imported(tmp_path, files.KALIBR, request=Request(camera="cam1"))
    assert camera_of(said.rig)[2:] == ("fisheye", (-0.01, 0.02, -0.03, 0.04))
    assert dict(said.rig.extrinsics) == {}
    assert "does not say where the camera sits" in said.remarks[0]


def test_openvins_writes_the_cameras_pose_into_kalibrs_file(tmp_path: Path) -> None:
    said = imported(
        tmp_path, files.KALIBR.replace("T_cam_imu", "T_imu_cam"), request=Request(camera="cam0")
    )
    p_imu = by_formula(R_CAMERA_AHEAD, [0.07, -0.02, 0.004])
    np.testing.assert_allclose(transform_points(said.rig.extrinsics["imu", "camera"], POINT), p_imu)


@pytest.mark.parametrize(
    ("camera", "says", "fix"),
    [(None, "it has 2 cameras", "--camera cam0, cam1"), ("cam", "called 'cam'", "did you mean")],
)
def test_which_of_kalibrs_cameras_must_be_clear(
    tmp_path: Path, camera: str | None, says: str, fix: str
) -> None:
    with pytest.raises(UsageError, match=says) as caught:
        imported(tmp_path, files.KALIBR, request=Request(camera=camera))
    assert fix in caught.value.fix


def test_kalibrs_wide_models_are_refused_by_name(tmp_path: Path) -> None:
    text = files.KALIBR.replace("camera_model: pinhole", "camera_model: omni")
    with pytest.raises(UsageError, match="camera model 'omni' with distortion 'radtan'") as caught:
        imported(tmp_path, text, request=Request(camera="cam0"))
    assert "pinhole" in caught.value.fix


CAMERA_ALONE = ((640, 480), (500.5, 501.5, 320.25, 240.125))


def test_a_ros_camera_takes_k_and_d_not_p(tmp_path: Path) -> None:
    said = imported(tmp_path, files.ROS_CAMERA_INFO)
    assert camera_of(said.rig) == (*CAMERA_ALONE, "plumb_bob", (0.1, -0.2, 0.001, 0.002, 0.0))
    assert said.rig.camera_name == "narrow_stereo"


def test_an_echoed_camera_info_is_read_as_well(tmp_path: Path) -> None:
    said = imported(tmp_path, files.ROS_ECHO)
    coefficients = (0.1, 0.2, 0.001, 0.002, 0.3, 0.4, 0.5, 0.6)
    assert camera_of(said.rig) == (*CAMERA_ALONE, "rational_polynomial", coefficients)


def test_opencvs_camera_with_a_number_that_yaml_takes_for_text(tmp_path: Path) -> None:
    said = imported(tmp_path, files.OPENCV)
    assert camera_of(said.rig) == (*CAMERA_ALONE, "plumb_bob", (0.1, -0.2, 0.001, 0.002, 0.0))


def test_opencvs_fisheye_says_so_with_a_flag(tmp_path: Path) -> None:
    text = files.OPENCV.replace("flags: 0", "fisheye_model: 1").replace(
        "2.0000000000000000e-03, 0. ]", "2.0000000000000000e-03 ]"
    )
    assert camera_of(imported(tmp_path, text).rig)[2:] == ("fisheye", (0.1, -0.2, 0.001, 0.002))


@pytest.mark.parametrize(
    ("numbers", "lens", "kept"),
    [
        ([0.0] * 5, "none", ()),
        ([0.1, 0.2, 0.3], "plumb_bob", (0.1, 0.2, 0.3, 0.0)),
        ([0.1, 0, 0, 0, 0, 0, 0, 0], "plumb_bob", (0.1, 0, 0, 0, 0)),
        ([0.1, 0, 0, 0, 0, 0.6], "rational_polynomial", (0.1, 0, 0, 0, 0, 0.6, 0, 0)),
        ([0.1] * 9 + [0.0] * 5, "rational_polynomial", (0.1,) * 9 + (0.0,) * 3),
    ],
)
def test_opencvs_distortion_vectors_of_any_length(
    tmp_path: Path, numbers: list[float], lens: str, kept: tuple[float, ...]
) -> None:
    text = files.ROS_CAMERA_INFO.replace("[0.1, -0.2, 0.001, 0.002, 0.]", repr(numbers))
    text = text.replace("plumb_bob", "rational_polynomial")
    assert camera_of(imported(tmp_path, text).rig)[2:] == (lens, kept)


def test_direct_visual_calibration_gives_the_cameras_pose_in_the_lidar_frame(
    tmp_path: Path,
) -> None:
    said = imported(tmp_path, files.DIRECT_VISUAL, request=Request(image_size_px=(1600, 1200)))

    # p_lidar = T_lidar_camera p_camera; (-0.5, 0.5, -0.5, 0.5) turns z forward to x forward.
    p_lidar = by_formula(R_CAMERA_AHEAD.T, [0.03, 0.002, 0.108])
    T_lidar_camera = said.rig.extrinsics["lidar", "camera"]
    np.testing.assert_allclose(transform_points(T_lidar_camera, POINT), p_lidar, atol=1e-12)
    assert camera_of(said.rig)[:2] == ((1600, 1200), (810.5, 810.25, 822.75, 622.5))


def test_an_unfinished_direct_visual_calibration_is_refused(tmp_path: Path) -> None:
    text = files.DIRECT_VISUAL.replace('"T_lidar_camera"', '"init_T_lidar_camera_auto"')
    with pytest.raises(UsageError, match="only the first guess") as caught:
        imported(tmp_path, text, request=Request(image_size_px=(1600, 1200)))
    assert "calibrate" in caught.value.fix


def test_opencalib_names_which_sensor_goes_to_which(tmp_path: Path) -> None:
    said = imported(tmp_path, files.OPENCALIB_EXTRINSIC, files.OPENCALIB_INTRINSIC)

    p_camera = by_formula(R_CAMERA_AHEAD, [-0.0125, -0.38, -0.55])
    T_lidar_camera = said.rig.extrinsics["lidar", "camera"]
    np.testing.assert_allclose(transform_points(T_lidar_camera, p_camera), POINT, atol=1e-12)
    assert (said.rig.lidar_name, said.rig.camera_name) == ("top_lidar", "front_camera")
    assert camera_of(said.rig)[0] == (1920, 1200)


def test_opencalib_the_other_way_round_is_taken_as_named(tmp_path: Path) -> None:
    text = files.OPENCALIB_EXTRINSIC.replace('"sensor_name": "top_lidar"', '"sensor_name": "cam"')
    text = text.replace('"target_sensor_name": "front_camera"', '"target_sensor_name": "lidar"')
    T = imported(tmp_path, text).rig.extrinsics["lidar", "camera"]
    p_lidar = by_formula(R_CAMERA_AHEAD, [-0.0125, -0.38, -0.55])
    np.testing.assert_allclose(transform_points(T, POINT), p_lidar)


def test_opencalib_between_two_cameras_is_refused(tmp_path: Path) -> None:
    text = files.OPENCALIB_EXTRINSIC.replace("top_lidar", "rear_camera")
    with pytest.raises(UsageError, match="which is the LiDAR") as caught:
        imported(tmp_path, text)
    assert "lidar" in caught.value.fix


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (files.R3LIVE.replace("[0.05, 0.04, -0.03]", "[0.05, 0.04]"), "2 numbers, not 3"),
        (files.R3LIVE.replace("-1, 0, 0,", "1, 0, 0,"), "mirrors"),
        (files.R3LIVE.replace("-1, 0, 0,", "-1, 0.1, 0,"), "not orthonormal"),
        (files.R3LIVE.replace("0.05, 0.04, -0.03", "0.05, .nan, -0.03"), "not finite"),
        (files.R3LIVE.replace("0.05, 0.04, -0.03", "0.05, x, -0.03"), "else than numbers"),
        (files.R3LIVE.replace("860.5, 0.0", "860.5, 5.0"), "skew"),
        (files.R3LIVE.replace("860.5", "-860.5"), "focal lengths are not positive"),
        (files.R3LIVE.replace("1280", "1280.5"), "size is 1280.5 x 1024"),
        (files.R3LIVE.replace("[0.05, 0.04, -0.03]", "&a [*a, *a]"), "more than 1000 items"),
        (files.LIVOX_EXTRINSIC.replace("0,0,0,1", "0,0,1,1"), "last row"),
        (files.LIVOX_EXTRINSIC.replace("0,0,0,1", "0,0,0,1\n1,2,3,4"), "20 numbers, not 16"),
        (files.OPENCV.replace("0. ]\navg", "0., 1, 1, 1, 1, 1, 1, 1, 1, 1 ]\navg"), "tilt"),
        (files.ROS_CAMERA_INFO.replace("plumb_bob", "omni"), "distortion_model 'omni'"),
        (files.FAST_LIVO2_CAMERA.replace("Pinhole", "MEI"), "camera model 'MEI'"),
        ("a: [1", "neither YAML, JSON nor a matrix"),
        ('{"a": ', "not JSON"),
        ("a: 1", "no format that is known"),
        ("", "no format that is known"),
        ("- 1\n- [2, 3]", "no format that is known"),
        ("a: &a\n  b: *a\n", "no format that is known"),
    ],
)
def test_what_cannot_be_read_is_said_with_its_place(tmp_path: Path, text: str, says: str) -> None:
    with pytest.raises(UsageError, match=says) as caught:
        imported(tmp_path, text)
    assert "file0.yaml" in caught.value.where
    assert caught.value.fix


def test_a_missing_a_binary_and_a_large_file_are_said(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="cannot be read: No such file"):
        import_rig([tmp_path / "missing.yaml"])
    (tmp_path / "binary").write_bytes(b"\xff\xfe\x00\x80")
    with pytest.raises(UsageError, match="is no text") as caught:
        import_rig([tmp_path / "binary"])
    assert caught.value.fix == "give a text file"
    (tmp_path / "large").write_bytes(b" " * (1 << 20) + b"a")
    with pytest.raises(UsageError, match="1048577 bytes, more than 1048576"):
        import_rig([tmp_path / "large"])


def test_a_named_format_that_does_not_fit_names_the_one_that_does(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="none of R3LIVE") as caught:
        imported(tmp_path, files.FAST_LIVO2, format_name="r3live")
    assert caught.value.fix == "it looks like --from fast-livo2"
    with pytest.raises(UsageError, match="called 'r4live'") as caught:
        imported(tmp_path, files.R3LIVE, format_name="r4live")
    assert "did you mean 'r3live'" in caught.value.fix


def test_another_image_size_than_the_calibrations_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="made at 1280x1024 pixels") as caught:
        imported(tmp_path, files.R3LIVE, request=Request(image_size_px=(640, 512)))
    assert "leave out --image-size" in caught.value.fix


def test_every_format_is_offered_by_the_command() -> None:
    from civil_rgbd.cli.rig import import_

    (option,) = (p for p in import_.params if p.name == "format_name")
    assert all(name in str(getattr(option, "help", "")) for name in FORMATS)


def test_a_camera_goes_onto_a_rig_that_has_extrinsics(tmp_path: Path) -> None:
    base = imported(tmp_path, files.LIVOX_EXTRINSIC).rig
    new = imported(tmp_path, files.ROS_CAMERA_INFO).rig

    both = merged(base, new)

    assert both.camera == new.camera
    assert both.extrinsics["lidar", "camera"] is base.extrinsics["lidar", "camera"]


def test_transforms_that_do_not_close_their_ring_are_refused(tmp_path: Path) -> None:
    base = imported(tmp_path, files.R3LIVE).rig
    new = imported(tmp_path, files.LIVOX_EXTRINSIC).rig

    with pytest.raises(UsageError, match=r"contradict each other by 0.101 m") as caught:
        merged(base, new)
    assert "take one of the three out" in caught.value.fix


@pytest.mark.parametrize("text", [files.R3LIVE, files.KALIBR, files.OPENCV])
def test_a_missing_extra_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str
) -> None:
    import sys

    from civil_rgbd.errors import MissingExtraError

    monkeypatch.setitem(sys.modules, "yaml", None)
    with pytest.raises(MissingExtraError, match="PyYAML") as caught:
        imported(tmp_path, text)
    assert caught.value.fix == 'pip install "civil-rgbd[rig]"'


def test_json_and_matrices_need_no_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import sys

    monkeypatch.setitem(sys.modules, "yaml", None)
    assert imported(tmp_path, files.LIVOX_EXTRINSIC).rig.extrinsics
    assert imported(tmp_path, files.OPENCALIB_EXTRINSIC).rig.extrinsics


@settings(max_examples=200)
@given(data=st.data())
def test_no_damage_of_a_calibration_crashes_or_hangs(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    known = [value for name, value in vars(files).items() if name.isupper()]
    text = data.draw(st.sampled_from(known))
    at, length = data.draw(st.integers(0, len(text))), data.draw(st.integers(0, 20))
    put = data.draw(st.text(alphabet="[]{}:-&*!,.#\"'0e\n a\t%", max_size=8))
    path = tmp_path_factory.mktemp("fuzz") / "calibration"
    path.write_text(text[:at] + put + text[at + length :], encoding="utf-8")

    with suppress(UsageError):
        import_rig([path], None, Request(image_size_px=None, camera="cam0"))
