"""LiDAR-only sources keep the promises of a converter."""

from __future__ import annotations

from pathlib import Path

import pytest

from civil_rgbd.conversion import lvx, scan_folder
from civil_rgbd.simulator.recording import SimulatedRecording
from civil_rgbd.simulator.spec import ScanSpec
from civil_rgbd.validation.recordings import check_recording

from .walk_beside import options_beside, write_beside, write_scans

SPEC = ScanSpec(seconds=0.5, image_scale=0.1, image_rate_hz=10, point_rate_hz=240_000)


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("walk")
    write_beside(folder, SimulatedRecording(SPEC))
    return folder


@pytest.mark.parametrize("kind", ["pcd", "ply", "las", "lvx"])
def test_a_converter_keeps_its_promises(walk: Path, kind: str) -> None:
    location = write_scans(walk / kind, SimulatedRecording(SPEC), kind)
    more = {} if kind == "lvx" else {"scans_in": "lidar"}
    if kind == "las":
        more["point_time"] = "gps_time:s:epoch"
    converter = lvx if kind == "lvx" else scan_folder
    faults = check_recording(
        converter.open_recording,
        location,
        options_beside(walk, **more),
        other_process=kind in ("pcd", "lvx"),
    )
    assert faults == ()
