"""Intrinsics are found in the layouts that people keep them in."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from civil_rgbd.errors import RecordingError
from civil_rgbd.importers.cameras import camera_from_text, find_camera, read_camera

FX, FY, CX, CY = 638.26, 636.52, 635.67, 366.15
K = [[FX, 0, CX], [0, FY, CY], [0, 0, 1]]
FLAT = [number for row in K for number in row]


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.json", json.dumps({"camera_matrix": K, "dist_coeff": [0] * 5})),
        ("a.json", json.dumps({"K": FLAT})),
        ("a.json", json.dumps({"camera": {"fx": FX, "fy": FY, "cx": CX, "cy": CY}})),
        ("a.json", json.dumps({"fx_px": FX, "fy_px": FY, "cx_px": CX, "cy_px": CY})),
        ("a.json", json.dumps({"intrinsic_matrix": [FX, 0, 0, 0, FY, 0, CX, CY, 1]})),
        ("a.json", json.dumps({"camera_matrix": {"rows": 3, "cols": 3, "data": FLAT}})),
        ("a.txt", f"{FX} 0 {CX}\n0 {FY} {CY}\n0 0 1\n"),
        ("a.txt", f"{FX}, 0, {CX}, 0\n0, {FY}, {CY}, 0\n0, 0, 1, 0\n0, 0, 0, 1\n"),
        ("a.txt", f"{FX} {FY} {CX} {CY}\n"),
        ("a.txt", f"fx: {FX}\nfy: {FY}\ncx: {CX}\ncy: {CY}\n"),
        ("a.txt", f"fx_color = {FX}\nfy_color = {FY}\nmx_color = {CX}\nmy_color = {CY}\n"),
        ("a.txt", f"P0: 1 0 2 0 0 3 4 0 0 0 1 0\nP2: {FX} 0 {CX} 45 0 {FY} {CY} 0 0 0 1 0\n"),
    ],
)
def test_every_layout_gives_the_same_camera(name: str, text: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text(text)

    camera = read_camera(tmp_path / name)

    assert (camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px) == (FX, FY, CX, CY)
    assert not camera.distorts


def test_size_and_lens_are_read(tmp_path: Path) -> None:
    path = tmp_path / "intrinsics.json"
    path.write_text(
        json.dumps(
            {"camera_matrix": K, "dist_coeff": [[-0.05, 0.06, 0, 0, -0.02]], "width": 1280}
            | {"height": 720}
        )
    )

    camera = read_camera(path)

    assert (camera.width_px, camera.height_px) == (1280, 720)
    assert camera.coefficients == (-0.05, 0.06, 0.0, 0.0, -0.02)
    assert find_camera(tmp_path) == path


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('{"camera_matrix": [1, 2]}', "2 numbers are no camera"),
        ('{"name": "D455"}', "neither a matrix"),
        ("{", "no JSON"),
        ("[1]", "no object"),
        ('{"K": [[nan]]}', "no JSON"),
        ('{"fx": 0, "fy": 1, "cx": 1, "cy": 1}', "focal lengths are 0.0 and 1.0"),
        ('{"fx": 9, "fy": 9, "cx": 1, "cy": 1, "D": [1, 2, 3]}', "3 coefficients"),
    ],
)
def test_what_is_no_camera_is_refused_with_the_file(text: str, said: str, tmp_path: Path) -> None:
    (tmp_path / "K.json").write_text(text)

    with pytest.raises(RecordingError, match=said) as caught:
        read_camera(tmp_path / "K.json")

    assert caught.value.where == str(tmp_path / "K.json")
    assert "--intrinsics" in caught.value.fix


def test_numbers_on_the_command_line_are_a_camera() -> None:
    assert camera_from_text("481.2,-480,319.5,239.5").fy_px == -480
    with pytest.raises(RecordingError, match="neither a file nor numbers"):
        camera_from_text("rig.txt")


def test_a_resized_camera_follows_the_half_pixel_rule() -> None:
    camera = camera_from_text("100,100,31.5,23.5")

    half = type(camera)(100, 100, 31.5, 23.5, 64, 48).sized(32, 24).pinhole

    assert (half.fx_px, half.fy_px, half.cx_px, half.cy_px) == (50, 50, 15.5, 11.5)
