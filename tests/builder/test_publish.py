"""What is counted while a bridge is published: how old points are when an image is taken."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from civil_rgbd.builder.report import BuildReport
from civil_rgbd.builder.run import BuildOptions, build_bridge
from civil_rgbd.conversion.mcap import open_recording
from civil_rgbd.domain.bridge import Counts
from civil_rgbd.domain.recipe import Recipe
from civil_rgbd.format.layout import BRIDGES
from civil_rgbd.format.reader import read_bridge
from civil_rgbd.simulator.recorder import write_recording
from civil_rgbd.simulator.recording import SimulatedRecording

from ..conversion import scene
from ..conversion.containers import messages_of
from .conftest import INFO


@pytest.fixture(scope="module")
def ended(recording: SimulatedRecording, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The simulated scan, whose LiDAR ends after two thirds of it."""
    folder = tmp_path_factory.mktemp("ended")
    write_recording(folder / "whole.mcap", recording.spec)
    found = messages_of(folder / "whole.mcap")
    clouds = [at for at, message in enumerate(found) if message.type_name.endswith("CustomMsg")]
    gone = set(clouds[2 * len(clouds) // 3 :])
    return scene.write(
        folder / "scan.mcap", [message for at, message in enumerate(found) if at not in gone]
    )


def counts_of(folder: Path) -> Counts:
    return read_bridge(folder / BRIDGES / INFO.bridge_id).manifest.counts


def built(recording: Path, recipe: Recipe, out: Path) -> BuildReport:
    report = build_bridge(open_recording(recording), recipe, out, INFO, BuildOptions())
    assert isinstance(report, BuildReport)
    return report


def test_frames_after_the_last_scan_are_counted_and_said(
    ended: Path, recipe: Recipe, tmp_path: Path
) -> None:
    report = built(ended, recipe, tmp_path)

    recording = open_recording(ended)
    last_ns = max(recording.read_scan(len(recording.scan_stamps_ns) - 1).point_stamps_ns)
    stamps = [row.stamp_ns for row in read_bridge(tmp_path / BRIDGES / INFO.bridge_id).rows]
    late_s = [(stamp - last_ns) / 1e9 for stamp in stamps]
    counts = counts_of(tmp_path)
    assert counts.frames_with_old_points == sum(age > 0.25 for age in late_s) > 0
    assert counts.max_newest_age_s == pytest.approx(max(late_s), abs=0.01)  # a few fall out
    assert counts.mean_newest_age_s == pytest.approx(np.clip(late_s, 0, None).mean(), abs=0.01)
    said = report.to_text()
    assert f"on average, {counts.max_newest_age_s:.3f} s at most" in said
    old = f"{counts.frames_with_old_points} of {counts.frames_kept}"
    assert f"warning       {old} frames have no point within 0.25 s of their image" in said


def test_points_of_a_whole_scan_are_young(
    recording: SimulatedRecording, recipe: Recipe, tmp_path: Path
) -> None:
    report = build_bridge(recording, recipe, tmp_path, INFO, BuildOptions())

    counts = counts_of(tmp_path)
    assert counts.frames_with_old_points == 0
    assert counts.max_newest_age_s is not None
    assert 0 < counts.max_newest_age_s < 0.05
    assert "warning" not in report.to_text()
