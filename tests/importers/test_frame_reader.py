"""Images are put on the depth's pixels; lenses are taken out of both or refused."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from civil_rgbd.errors import RecordingError

from . import sets

Take = Any
LENS = [-0.2, 0.05, 0.001, -0.002, 0.01]


def test_a_lens_is_refused_until_somebody_says_where_it_is(take: Take, tmp_path: Path) -> None:
    root = sets.bridge_rgbd(tmp_path / "set")
    sets.lab_intrinsics(root, LENS)

    with pytest.raises(RecordingError, match="nothing says whether the images still have it") as e:
        take(root, "lab")

    assert "--lens undistort" in e.value.fix
    assert "--lens ignore" in e.value.fix


def test_a_lens_that_is_out_already_changes_nothing(take: Take, tmp_path: Path) -> None:
    root = sets.bridge_rgbd(tmp_path / "set")
    sets.lab_intrinsics(root, LENS)

    bridge = take(root, "bridge-rgbd", lens="ignore")

    assert np.array_equal(bridge.read_rgb(bridge.rows[3]), sets.rgb(3))


def test_a_lens_is_taken_out_as_opencv_does(take: Take, tmp_path: Path) -> None:
    root = sets.bridge_rgbd(tmp_path / "set")
    sets.lab_intrinsics(root, LENS)

    bridge = take(root, "bridge-rgbd", lens="undistort", depth_scale=256.0)

    K = np.array([[sets.FX, 0, sets.CX], [0, sets.FY, sets.CY], [0, 0, 1]])
    size = (sets.WIDTH, sets.HEIGHT)
    maps = cv2.initUndistortRectifyMap(K, np.array(LENS), np.eye(3), K, size, cv2.CV_32FC1)
    expected = cv2.remap(sets.rgb(3), *maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    rgb, depth_m = bridge.read_rgb(bridge.rows[3]), bridge.read_depth(bridge.rows[3])
    exists = rgb.any(axis=2)
    assert 0.8 < exists.mean() <= 1
    assert np.abs(rgb[exists].astype(int) - expected[exists]).max() <= 1
    codes = np.floor(sets.depth_m(3) * 256 + 0.5).astype(np.float32) / 256
    nearest = cv2.remap(codes, *maps, cv2.INTER_NEAREST)
    assert (depth_m[exists] == nearest[exists]).mean() > 0.99
    assert not depth_m[~exists].any()


def test_depth_along_the_ray_becomes_depth_along_the_axis(take: Take, tmp_path: Path) -> None:
    root = tmp_path / "set"
    v, u = np.mgrid[: sets.HEIGHT, : sets.WIDTH]
    ray = np.sqrt(1 + ((u - sets.CX) / sets.FX) ** 2 + ((v - sets.CY) / sets.FY) ** 2)
    along = lambda frame: sets.depth_m(frame) * ray  # noqa: E731  # one line says it
    sets.write_images(root / "rgb", root / "depth", scale=1000.0, z=along)
    sets.lab_intrinsics(root)
    sets.lab_poses(root)

    bridge = take(root, "lab", depth_along="ray")

    assert np.abs(bridge.read_depth(bridge.rows[5]) - sets.depth_m(5)).max() < 6e-4
    assert any("along the ray" in said for said in bridge.manifest.warnings)


def test_larger_colour_goes_onto_the_pixels_of_the_depth(take: Take, tmp_path: Path) -> None:
    root = sets.scannet(tmp_path / "set")
    for frame in range(sets.FRAMES):  # twice as large, seen by a camera of its own
        large = cv2.resize(sets.rgb(frame), None, fx=2, fy=2, interpolation=cv2.INTER_LINEAR)
        sets.write_png(root / "color" / f"{frame}.png", cv2.cvtColor(large, cv2.COLOR_RGB2BGR))
    fx, fy, cx, cy = 2 * sets.FX, 2 * sets.FY, 2 * sets.CX + 0.5, 2 * sets.CY + 0.5
    K = f"{fx} 0 {cx} 0\n0 {fy} {cy} 0\n0 0 1 0\n0 0 0 1\n"
    (root / "intrinsic" / "intrinsic_color.txt").write_text(K)

    bridge = take(root, "scannet")

    assert (bridge.camera.width_px, bridge.camera.fx_px) == (sets.WIDTH, sets.FX)
    inside = (slice(2, -2), slice(2, -2))
    difference = bridge.read_rgb(bridge.rows[2])[inside].astype(int) - sets.rgb(2)[inside]
    assert np.abs(difference).max() <= 1
    assert any("128 x 96" in said for said in bridge.manifest.warnings)


def test_a_camera_for_another_size_is_scaled_and_for_another_shape_refused(
    take: Take, tmp_path: Path
) -> None:
    root = sets.bridge_rgbd(tmp_path / "set")
    path = root / "intrinsics.json"
    large = {
        "fx": 2 * sets.FX,
        "fy": 2 * sets.FY,
        "cx": 2 * sets.CX + 0.5,
        "cy": 2 * sets.CY + 0.5,
    }
    path.write_text(json.dumps(large | {"width": 128, "height": 96}))
    camera = take(root, "bridge-rgbd").camera
    assert (camera.fx_px, camera.cx_px, camera.cy_px) == (sets.FX, sets.CX, sets.CY)

    path.write_text(json.dumps(large | {"width": 128, "height": 72}))
    with pytest.raises(RecordingError, match="128 x 72 pixels, the images have 64 x 48"):
        take(root, "bridge-rgbd", overwrite=True)
