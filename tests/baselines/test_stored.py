"""Predictions in a folder, written by whatever program."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import OpenEXR
import pytest
from numpy.typing import NDArray

from civil_rgbd.baselines.model import StoredDepth, load_model, predict_frame
from civil_rgbd.baselines.stored import StoredPredictions
from civil_rgbd.errors import FormatError, UsageError
from civil_rgbd.geometry.camera import PinholeCamera

DEPTH_M = np.linspace(0.5, 40, 50 * 75, dtype=np.float32).reshape(50, 75)


def write_exr(path: Path, channels: dict[str, NDArray[Any]]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, channels).write(str(path))


@pytest.mark.parametrize(
    "place",
    ["B1/000012.exr", "B1/depth/000012.exr", "B1_000012.exr", "000012.exr"],
)
def test_an_exr_is_found_by_bridge_and_frame(
    tmp_path: Path, place: str, rgb: NDArray[np.uint8], camera: PinholeCamera
) -> None:
    write_exr(tmp_path / place, {"Z": DEPTH_M})
    model = load_model(f"predictions:{tmp_path}")

    found = predict_frame(model, rgb, camera, bridge="B1", frame="000012")

    assert isinstance(model, StoredDepth)
    np.testing.assert_array_equal(found, DEPTH_M)


@pytest.mark.parametrize(
    "channels",
    [
        {"Y": DEPTH_M},
        {"depth": DEPTH_M},
        {"R": DEPTH_M, "G": DEPTH_M, "B": DEPTH_M},
        {"Z": DEPTH_M, "A": np.ones_like(DEPTH_M)},
        {"anything": DEPTH_M},
    ],
    ids="".join,
)
def test_depth_is_found_under_other_writers_names(
    tmp_path: Path, channels: dict[str, NDArray[np.float32]], camera: PinholeCamera
) -> None:
    write_exr(tmp_path / "7.exr", channels)

    found = StoredPredictions(tmp_path).depth_of("B1", "7", camera)

    np.testing.assert_array_equal(found, DEPTH_M)


def test_half_floats_are_read(tmp_path: Path, camera: PinholeCamera) -> None:
    write_exr(tmp_path / "7.exr", {"Z": DEPTH_M.astype(np.float16)})

    found = StoredPredictions(tmp_path).depth_of("B1", "7", camera)

    np.testing.assert_array_equal(found, DEPTH_M.astype(np.float16).astype(np.float32))


def test_0_is_no_answer_and_odd_answers_are_left_to_scoring(
    tmp_path: Path, camera: PinholeCamera
) -> None:
    depth_m = DEPTH_M.copy()
    depth_m[0, :5] = 0, np.nan, -1, np.inf, -np.inf
    write_exr(tmp_path / "7.exr", {"Z": depth_m})

    found = StoredPredictions(tmp_path).depth_of("B1", "7", camera)

    np.testing.assert_array_equal(found[0, :5], [np.nan, np.nan, -1, np.inf, -np.inf])
    np.testing.assert_array_equal(found[1:], depth_m[1:])


@pytest.mark.parametrize("units_per_m", [256, 1000.0, 1e-35])
def test_every_number_of_a_png_is_divided_and_0_is_no_answer(
    tmp_path: Path, units_per_m: float
) -> None:
    numbers = np.arange(1 << 16).astype(np.uint16).reshape(256, 256)
    cv2.imwrite(str(tmp_path / "7.png"), numbers)
    camera = PinholeCamera(256, 256, 100.0, 100.0, 127.5, 127.5)

    found = StoredPredictions(tmp_path, units_per_m=units_per_m).depth_of("B1", "7", camera)

    with np.errstate(over="ignore"):
        expected = (numbers.astype(np.float64) / units_per_m).astype(np.float32)
    expected[0, 0] = np.nan
    np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("by_file", [True, False])
def test_png_units_become_metres(tmp_path: Path, camera: PinholeCamera, by_file: bool) -> None:
    stored = np.full((50, 75), 256 * 9 + 128, np.uint16)
    stored[3, 4] = 0
    cv2.imwrite(str(tmp_path / "7.png"), stored)
    if by_file:
        (tmp_path / "predictions.json").write_text(json.dumps({"units_per_m": 256}))

    model = StoredPredictions(tmp_path, units_per_m=None if by_file else 256)

    found = model.depth_of("B1", "7", camera)
    assert found[0, 0] == 9.5
    assert np.isnan(found[3, 4])


def test_a_png_without_a_scale_is_a_question(tmp_path: Path, camera: PinholeCamera) -> None:
    cv2.imwrite(str(tmp_path / "7.png"), np.ones((50, 75), np.uint16))

    with pytest.raises(UsageError, match="their scale is not given") as caught:
        StoredPredictions(tmp_path).depth_of("B1", "7", camera)
    assert "predictions.json" in caught.value.fix


@pytest.mark.parametrize(
    ("pixels", "words"),
    [
        (np.ones((50, 75), np.uint8), r"uint8 \(50, 75\)"),
        (np.ones((50, 75, 3), np.uint16), r"uint16 \(50, 75, 3\)"),
    ],
)
def test_a_picture_of_depth_is_no_depth(
    tmp_path: Path, camera: PinholeCamera, pixels: NDArray[Any], words: str
) -> None:
    cv2.imwrite(str(tmp_path / "7.png"), pixels)

    with pytest.raises(FormatError, match=words):
        StoredPredictions(tmp_path, units_per_m=256).depth_of("B1", "7", camera)


@pytest.mark.parametrize("suffix", [".exr", ".png"])
@pytest.mark.parametrize("share", [0.0, 0.5])
def test_a_damaged_file_is_named(
    tmp_path: Path, camera: PinholeCamera, suffix: str, share: float
) -> None:
    path = tmp_path / f"7{suffix}"
    if suffix == ".exr":
        write_exr(path, {"Z": np.random.default_rng(0).random((50, 75), dtype=np.float32)})
    else:
        cv2.imwrite(str(path), np.ones((50, 75), np.uint16))
    path.write_bytes(path.read_bytes()[: int(path.stat().st_size * share)])

    with pytest.raises(FormatError, match=r"cannot be read|not one channel|has \d+ x") as caught:
        StoredPredictions(tmp_path, units_per_m=256).depth_of("B1", "7", camera)
    assert caught.value.where == str(path)


def test_colours_are_no_depth(tmp_path: Path, camera: PinholeCamera) -> None:
    write_exr(tmp_path / "7.exr", {"R": DEPTH_M, "G": DEPTH_M * 2, "B": DEPTH_M})

    with pytest.raises(FormatError, match="no depth channel, but B, G, R"):
        StoredPredictions(tmp_path).depth_of("B1", "7", camera)


def test_another_size_is_refused(tmp_path: Path, camera: PinholeCamera) -> None:
    write_exr(tmp_path / "7.exr", {"Z": DEPTH_M[:25]})

    with pytest.raises(FormatError, match="75 x 25 px, its image 75 x 50"):
        StoredPredictions(tmp_path).depth_of("B1", "7", camera)


def test_a_frame_without_a_file_is_told(tmp_path: Path, camera: PinholeCamera) -> None:
    with pytest.raises(UsageError, match="no prediction of frame 000003 of bridge B1") as caught:
        StoredPredictions(tmp_path).depth_of("B1", "000003", camera)
    assert "B1/000003.exr" in caught.value.fix


@pytest.mark.parametrize(
    ("text", "words"),
    [("{", "no JSON"), ("[1]", "no JSON object"), ('{"units_per_m": -1}', "positive number: -1")],
)
def test_settings_that_say_nothing_are_refused(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "predictions.json").write_text(text)

    with pytest.raises((FormatError, UsageError), match=words):
        StoredPredictions(tmp_path)


def test_a_missing_folder_is_told(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="no such folder"):
        load_model(f"predictions:{tmp_path / 'nowhere'}")
