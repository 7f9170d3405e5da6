"""The truth about defects follows the format, and its pixels lie on the spall."""

from __future__ import annotations

import json
from pathlib import Path

import jsonschema
import numpy as np

from civil_rgbd.geometry.camera import PinholeCamera
from civil_rgbd.resources import load_schema
from civil_rgbd.simulator.camera import true_camera_pose, true_depth
from civil_rgbd.simulator.catalogue import site_for
from civil_rgbd.simulator.sightings import seen_spalls
from civil_rgbd.simulator.spec import ScanSpec
from civil_rgbd.simulator.truth import write_truth

CAMERA = PinholeCamera(640, 360, 318.0, 318.0, 319.5, 179.5)
SPEC = ScanSpec("B3", seconds=20.0, image_rate_hz=1.0, map_offset_m=(1000.0, -500.0, 30.0))


def test_a_seen_spall_lies_where_its_pixels_and_the_true_depth_say() -> None:
    spalls = {spall.name: spall for spall in site_for(SPEC).spalls}
    records = seen_spalls(SPEC, CAMERA)

    assert len(records) >= 3
    for record in records:
        index = int(record.frame_id)
        depth, T = true_depth(SPEC, index, CAMERA), true_camera_pose(SPEC, index)
        middle = np.array(record.uv_px).mean(axis=0)
        u, v = np.rint(middle).astype(int)
        x, y = (u - CAMERA.cx_px) / CAMERA.fx_px, (v - CAMERA.cy_px) / CAMERA.fy_px
        spot = T[:3, :3] @ (depth[v, u] * np.array([x, y, 1.0])) + T[:3, 3]
        spall = spalls[record.defect_id]
        away = spot - np.array(SPEC.map_offset_m) - spall.centre_m

        assert abs(away @ spall.along) < spall.length_m / 2
        assert abs(away @ spall.up) < spall.width_m / 2
        assert -spall.depth_m - 1e-6 <= away @ spall.normal < 0.002
        measures = {measure.name: measure.value for measure in record.measures}
        assert measures["length"] == round(spall.length_m * 1e3, 6)
        assert measures["depth"] == round(spall.depth_m * 1e3, 6)


def test_the_truth_folder_tells_spalls_and_movers(tmp_path: Path) -> None:
    folder = write_truth(tmp_path / "b3.mcap", SPEC)
    scene = json.loads((folder / "scene.json").read_text("utf-8"))
    defects = json.loads((folder / "defects.json").read_text("utf-8"))

    jsonschema.validate(defects, load_schema("defects"))
    assert {spall["name"] for spall in scene["spalls"]} >= {"S1", "S2", "S3", "S4"}
    first = next(spall for spall in scene["spalls"] if spall["name"] == "S1")
    assert first["length_m"] == 1.2
    assert first["centre_map_m"][1] == -500.0 - 8.6  # on the abutment's front
    assert {mover["motion"] for mover in scene["movers"]} == {"Drive", "Stroll"}


def test_a_bridge_without_spalls_has_no_defects() -> None:
    assert seen_spalls(ScanSpec(seconds=1.0), CAMERA) == ()
