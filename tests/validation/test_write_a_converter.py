"""The converter of docs/tutorials/write_a_converter.md, as a reader of the page would save it."""

from __future__ import annotations

import importlib
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from civil_rgbd.builder.recipes import load_recipe
from civil_rgbd.builder.run import BuildOptions, build_bridge
from civil_rgbd.domain.bridge import BridgeInfo
from civil_rgbd.domain.recording import RecordingOptions
from civil_rgbd.simulator.recording import SimulatedRecording
from civil_rgbd.simulator.spec import ScanSpec
from civil_rgbd.validation.recordings import check_recording

PAGE = Path(__file__).parents[2] / "docs" / "tutorials" / "write_a_converter.md"


@pytest.fixture
def converter(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[ModuleType]:
    block = re.search(r"^```python not run: a test saves this.*?\n(.*?)^```", *_page())
    assert block is not None
    (tmp_path / "npz_walk.py").write_text(block[1], "utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))
    yield importlib.import_module("npz_walk")
    del sys.modules["npz_walk"]


def _page() -> tuple[str, re.RegexFlag]:
    return PAGE.read_text("utf-8"), re.DOTALL | re.MULTILINE


@pytest.fixture
def walk(tmp_path: Path) -> Path:
    recording = SimulatedRecording(
        ScanSpec(seconds=2.0, image_scale=0.05, point_rate_hz=6000, image_rate_hz=10.0)
    )
    arrays = {
        f"scan_{i}": recording.read_scan(i).points for i in range(len(recording.scan_stamps_ns))
    }
    arrays |= {
        f"image_{i}": recording.read_image(i).rgb for i in range(len(recording.image_stamps_ns))
    }
    pinhole, trajectory = recording.rig.camera.pinhole, recording.trajectory
    K = pinhole.matrix
    path = tmp_path / "walk.npz"
    np.savez(
        path,
        **arrays,
        camera=[pinhole.width_px, pinhole.height_px, K[0, 0], K[1, 1], K[0, 2], K[1, 2]],
        T_lidar_camera=recording.rig.T_lidar_camera,
        poses=np.hstack([trajectory.translations_m, trajectory.quaternions_xyzw]),
        pose_stamps_ns=trajectory.stamps_ns,
        scan_stamps_ns=recording.scan_stamps_ns,
        image_stamps_ns=recording.image_stamps_ns,
    )
    return path


def test_the_converter_of_the_page_keeps_its_promises(converter: ModuleType, walk: Path) -> None:
    assert check_recording(converter.open_recording, walk, at_most=5) == ()


def test_the_converter_of_the_page_builds(
    converter: ModuleType, walk: Path, tmp_path: Path
) -> None:
    recording = converter.open_recording(walk, RecordingOptions())
    recipe = load_recipe("250k", ["accumulate.points=1000"])

    report = build_bridge(recording, recipe, tmp_path / "out", BridgeInfo("B9"), BuildOptions())

    assert report.counts.frames_kept > 3


def test_the_page_says_sixty_lines_or_so() -> None:
    block = re.search(r"^```python not run: a test saves this.*?\n(.*?)^```", *_page())

    assert block is not None
    code = [line for line in block[1].splitlines() if line.strip()]
    assert len(code) <= 70
    assert max(map(len, code)) <= 105
