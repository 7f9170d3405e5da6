"""Depth for photos: cameras, orientation, what is written and what is told."""

from __future__ import annotations

import struct
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from civil_rgbd.errors import OutputError, UsageError
from civil_rgbd.format.depth_exr import read_depth
from civil_rgbd.format.intrinsics import read_intrinsics
from civil_rgbd.geometry.camera import LensCamera, PinholeCamera
from civil_rgbd.prediction import PhotoCamera, coloured, photos_in, predict_photos

FOCAL = PhotoCamera(focal_px=50.0)


class RedIsDepth:
    """Answers a tenth of the red channel, and remembers the cameras it was given."""

    def __init__(self) -> None:
        self.cameras: list[PinholeCamera] = []

    def predict(self, rgb: NDArray[np.uint8], camera: PinholeCamera) -> NDArray[np.float32]:
        self.cameras.append(camera)
        return rgb[..., 0].astype(np.float32) / 10


def gradient(width: int = 80, height: int = 60) -> NDArray[np.uint8]:
    """(H, W, 3) uint8 that differs from left to right and from top to bottom; red never 0."""
    v, u = np.mgrid[:height, :width]
    return np.stack([20 + 2 * u + v, 3 * v, 255 - 2 * u], -1).astype(np.uint8)


def write_photo(path: Path, rgb: NDArray[np.uint8], *, orientation: int | None = None) -> None:
    data = bytes(cv2.imencode(path.suffix.lower(), rgb[..., ::-1])[1])
    if orientation is not None:
        entry = struct.pack(">HHIHH", 0x0112, 3, 1, orientation, 0)
        exif = b"Exif\0\0MM\0*" + struct.pack(">IH", 8, 1) + entry + bytes(4)
        data = data[:2] + b"\xff\xe1" + struct.pack(">H", len(exif) + 2) + exif + data[2:]
    path.write_bytes(data)


@pytest.fixture
def photos(tmp_path: Path) -> Path:
    folder = tmp_path / "photos"
    folder.mkdir()
    write_photo(folder / "pier.PNG", gradient())
    write_photo(folder / "deck.png", gradient(40, 30))
    return folder


def test_each_photo_gets_depth_a_picture_and_its_camera(photos: Path, tmp_path: Path) -> None:
    (photos / "notes.txt").write_text("wet")

    report = predict_photos(RedIsDepth(), photos, FOCAL, tmp_path / "out")

    written = sorted(p.relative_to(tmp_path / "out").as_posix() for p in tmp_path.rglob("out/*/*"))
    assert written == [
        "colour/deck.png",
        "colour/pier.png",
        "depth/deck.exr",
        "depth/pier.exr",
        "intrinsics/deck.json",
        "intrinsics/pier.json",
    ]
    depth_m = read_depth(tmp_path / "out/depth/pier.exr")
    np.testing.assert_array_equal(depth_m, gradient()[..., 0].astype(np.float32) / 10)
    assert read_intrinsics(tmp_path / "out/intrinsics/deck.json") == PinholeCamera(
        40, 30, 50.0, 50.0, 19.5, 14.5
    )
    assert report.predicted == ["deck.png", "pier.PNG"]
    assert report.left_out == ["notes.txt"]
    assert "2 photos predicted\n1 files are no photos: notes.txt" in report.to_text()


def test_a_broken_photo_is_told_and_the_others_go_on(photos: Path, tmp_path: Path) -> None:
    (photos / "cut.jpg").write_bytes(b"\xff\xd8\xff")
    told: list[tuple[int, int]] = []

    report = predict_photos(
        RedIsDepth(), photos, FOCAL, tmp_path / "out", on_photo=lambda *given: told.append(given)
    )

    assert report.failed == {"cut.jpg": "the file is no image, or it is cut off"}
    assert len(report.predicted) == 2
    assert told == [(1, 3)] * 3


def test_a_calibration_is_scaled_to_the_photo(photos: Path, tmp_path: Path) -> None:
    model = RedIsDepth()
    calibrated = LensCamera(PinholeCamera(160, 120, 100.0, 102.0, 81.5, 57.5))

    predict_photos(model, photos / "pier.PNG", PhotoCamera(calibrated), tmp_path / "out")

    assert model.cameras == [PinholeCamera(80, 60, 50.0, 51.0, 40.5, 28.5)]


def test_a_calibration_of_another_shape_is_no_camera(photos: Path, tmp_path: Path) -> None:
    calibrated = LensCamera(PinholeCamera(160, 90, 100.0, 100.0, 80.0, 45.0))

    report = predict_photos(RedIsDepth(), photos, PhotoCamera(calibrated), tmp_path / "out")

    assert report.predicted == []
    assert "80 x 60 px, its camera 160 x 90" in report.failed["pier.PNG"]


def test_a_lens_is_taken_out_and_the_image_kept(photos: Path, tmp_path: Path) -> None:
    K = np.array([[50.0, 0, 39.5], [0, 50.0, 29.5], [0, 0, 1]])
    bent = (-0.15, 0.02, 0.001, -0.002)
    camera = LensCamera(PinholeCamera(80, 60, 50.0, 50.0, 39.5, 29.5), "plumb_bob", bent)

    report = predict_photos(RedIsDepth(), photos / "pier.PNG", PhotoCamera(camera), tmp_path / "o")

    depth_m = read_depth(tmp_path / "o/depth/pier.exr")
    straight = cv2.undistort(gradient(), K, np.array(bent), newCameraMatrix=K)
    answered = depth_m > 0
    assert report.without_answer["pier.PNG"] == (~answered).sum()
    np.testing.assert_allclose(depth_m[answered] * 10, straight[..., 0][answered], atol=1.01)
    kept = cv2.imread(str(tmp_path / "o/rgb/pier.png"))[..., ::-1]
    np.testing.assert_allclose(kept[answered][:, 0] / 10, depth_m[answered], atol=1e-6)


@pytest.mark.parametrize("calibrated", [False, True])
def test_photos_are_turned_upright_unless_they_are_calibrated(
    tmp_path: Path, calibrated: bool
) -> None:
    write_photo(tmp_path / "a.jpg", gradient(), orientation=6)  # turned a quarter clockwise
    model = RedIsDepth()
    lying = LensCamera(PinholeCamera(80, 60, 50.0, 50.0, 39.5, 29.5))

    predict_photos(
        model, tmp_path / "a.jpg", PhotoCamera(lying) if calibrated else FOCAL, tmp_path / "out"
    )

    sizes = [(camera.width_px, camera.height_px) for camera in model.cameras]
    assert sizes == [(80, 60) if calibrated else (60, 80)]


def test_pixels_without_an_answer_are_stored_as_0_and_counted(photos: Path, tmp_path: Path) -> None:
    class Holes:
        def predict(self, rgb: NDArray[np.uint8], _: PinholeCamera) -> NDArray[np.float32]:
            depth_m = np.ones(rgb.shape[:2], np.float32)
            depth_m[0, :4] = np.nan, np.inf, -1, 0
            return depth_m

    report = predict_photos(Holes(), photos, FOCAL, tmp_path / "out")

    depth_m = read_depth(tmp_path / "out/depth/pier.exr")
    assert (depth_m[0, :5] == [0, 0, 0, 0, 1]).all()
    assert report.without_answer == {"deck.png": 4, "pier.PNG": 4}
    assert "pier.PNG: 4 pixels without answer" in report.to_text()


def test_near_is_warm_far_is_cold_and_nothing_is_black() -> None:
    rgb = coloured(np.array([[1.0, 9.0, 0.0]], np.float32), near_m=1.0, far_m=9.0)

    near, far, nothing = rgb[0].astype(int)
    assert near[0] > near[2]
    assert far[2] > far[0]
    assert nothing.tolist() == [0, 0, 0]


def test_a_folder_that_holds_something_is_left_alone(photos: Path, tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "mine").write_text("")

    with pytest.raises(OutputError, match="holds something already"):
        predict_photos(RedIsDepth(), photos, FOCAL, tmp_path / "out")


def test_photos_of_one_name_are_refused(photos: Path) -> None:
    write_photo(photos / "deck.jpg", gradient())

    with pytest.raises(UsageError, match="two photos share the name 'deck'"):
        photos_in(photos)


@pytest.mark.parametrize("name", ["empty", "nowhere"])
def test_no_photos_are_told(tmp_path: Path, name: str) -> None:
    (tmp_path / "empty").mkdir()

    with pytest.raises(UsageError, match="there is no"):
        photos_in(tmp_path / name)


@pytest.mark.parametrize("focal_px", [0.0, -3.0, float("nan"), float("inf")])
def test_a_focal_length_is_a_positive_number(focal_px: float) -> None:
    with pytest.raises(UsageError, match="no positive number"):
        PhotoCamera(focal_px=focal_px)


def test_a_camera_is_given_once() -> None:
    with pytest.raises(UsageError, match="given twice, or not at all"):
        PhotoCamera()
