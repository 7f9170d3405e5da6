"""One simulated walk as LVX, PCD, PLY and LAS: the same depth, to each format's own precision."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from civil_rgbd.builder.plan import plan_frames
from civil_rgbd.builder.recipes import load_recipe
from civil_rgbd.converters import open_recording
from civil_rgbd.domain.frame import RgbdFrame
from civil_rgbd.domain.recording import Recording
from civil_rgbd.pipeline.frames import FrameMaker
from civil_rgbd.simulator.recording import SimulatedRecording
from civil_rgbd.simulator.spec import ScanSpec

from .walk_beside import options_beside, write_beside, write_scans

SPEC = ScanSpec(seconds=1.2, image_scale=0.25, image_rate_hz=5)


@pytest.fixture(scope="module")
def beside(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("walk")
    write_beside(folder, SimulatedRecording(SPEC))
    return folder


@pytest.fixture(scope="module")
def expected() -> list[RgbdFrame]:
    return frames_of(SimulatedRecording(SPEC))


def frames_of(recording: Recording) -> list[RgbdFrame]:
    recipe = load_recipe("demo", ("select.min_displacement_m=0.2",))
    plan = plan_frames(recording, recipe)
    outcomes = list(FrameMaker(recording, recipe).make(plan.frames))
    return [outcome.frame for outcome in outcomes if outcome.frame is not None]


@pytest.mark.parametrize("kind", ["pcd", "ply"])
def test_formats_that_keep_every_bit_give_the_same_pixels(
    beside: Path, expected: list[RgbdFrame], kind: str
) -> None:
    location = write_scans(beside / kind, SimulatedRecording(SPEC), kind)
    found = frames_of(open_recording(location, options_beside(beside, scans_in="lidar")))
    assert len(found) == len(expected) == 2
    for a, b in zip(expected, found, strict=True):
        np.testing.assert_array_equal(a.depth_m, b.depth_m)
        np.testing.assert_array_equal(a.rgb, b.rgb)
        assert a.stamp_ns == b.stamp_ns


@pytest.mark.parametrize(("kind", "step_m", "share"), [("las", 1e-4, 0.99), ("lvx", 1e-3, 0.96)])
def test_formats_that_round_agree_to_their_own_step(
    beside: Path, expected: list[RgbdFrame], kind: str, step_m: float, share: float
) -> None:
    location = write_scans(beside / kind, SimulatedRecording(SPEC), kind)
    more = {} if kind == "lvx" else {"scans_in": "lidar", "point_time": "gps_time:s:epoch"}
    recording = open_recording(location, options_beside(beside, **more))
    found = frames_of(recording)
    assert len(found) == len(expected) == 2
    stored_step_m = 1 / 1024
    for a, b in zip(expected, found, strict=True):
        both = (a.depth_m > 0) & (b.depth_m > 0)
        apart = np.abs(a.depth_m.astype(np.float64) - b.depth_m)[both]
        assert both.sum() > 2000
        # A point on the border of two pixels may change sides; all others keep their depth.
        assert (apart <= stored_step_m + step_m).mean() > share
        assert ((a.depth_m > 0) == (b.depth_m > 0)).mean() > 0.999
        np.testing.assert_array_equal(a.rgb, b.rgb)


def test_every_point_of_an_lvx_file_is_within_half_a_millimetre(beside: Path) -> None:
    simulated = SimulatedRecording(SPEC)
    location = beside / "lvx/walk.lvx"
    if not location.exists():
        write_scans(beside / "lvx", simulated, "lvx")
    recording = open_recording(location, options_beside(beside))
    first, halves = simulated.read_scan(0), [recording.read_scan(at) for at in range(2)]
    points = np.concatenate([scan.points for scan in halves])
    np.testing.assert_allclose(points, first.points, atol=0.000502)
    stamps = [scan.point_stamps_ns for scan in halves]
    assert stamps[0] is not None
    assert stamps[1] is not None
    assert first.point_stamps_ns is not None
    # 4,167 ns for 4,166.67: at most a third of a nanosecond a point of a packet.
    apart = np.concatenate([stamps[0], stamps[1]]) - first.point_stamps_ns
    assert np.abs(apart).max() <= 33
    assert recording.rig.lidar_name == "Livox Avia"
