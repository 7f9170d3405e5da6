"""Poses of low quality: neither their images nor their points come into a bridge."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from civil_rgbd.builder.recipes import load_recipe
from civil_rgbd.builder.run import BuildOptions, build_bridge
from civil_rgbd.domain.bridge import Manifest
from civil_rgbd.domain.recipe import Recipe
from civil_rgbd.format.layout import BRIDGES
from civil_rgbd.format.reader import read_bridge
from civil_rgbd.simulator.recording import SimulatedRecording
from civil_rgbd.validation import validate

from .conftest import INFO, contents


@pytest.fixture(scope="module")
def judged(recording: SimulatedRecording) -> SimulatedRecording:
    """The simulated scan, whose poses cannot be trusted from 1.0 to 1.4 s."""
    copy = SimulatedRecording(recording.spec)
    after_s = (copy.trajectory.stamps_ns - copy.trajectory.start_ns) / 1e9
    quality = np.where((after_s >= 1.0) & (after_s <= 1.4), 0.1, 1.0)
    copy.__dict__["trajectory"] = replace(copy.trajectory, quality=quality)
    return copy


def built(recording: SimulatedRecording, recipe: Recipe, folder: Path) -> Manifest:
    build_bridge(recording, recipe, folder, INFO, BuildOptions())
    assert validate(folder).findings == ()
    return read_bridge(folder / BRIDGES / INFO.bridge_id).manifest


def test_their_points_enter_no_later_window_and_are_counted(
    judged: SimulatedRecording, tmp_path: Path
) -> None:
    settings = ["accumulate.points=8000", "select.min_displacement_m=0"]
    free = built(judged, load_recipe("250k", settings), tmp_path / "free").counts
    asked = load_recipe("250k", [*settings, "poses.min_quality=0.5"])
    strict = built(judged, asked, tmp_path / "strict").counts

    assert strict.dropped["image-pose-quality-low"] == 6
    # 0.4 s of the rays are doubted, of which some did not return.
    low = strict.points_dropped["pose_quality_low"]
    assert 0 < low <= 0.41 * judged.spec.point_rate_hz
    assert low > 0.2 * judged.spec.point_rate_hz
    assert "pose_quality_low" not in free.points_dropped
    assert free.mean_age_span_s is not None
    assert strict.mean_age_span_s is not None
    assert strict.mean_age_span_s > free.mean_age_span_s  # windows reach back beyond the hole


def test_quality_changes_no_byte_where_no_recipe_asks_for_it(
    judged: SimulatedRecording, recording: SimulatedRecording, recipe: Recipe, tmp_path: Path
) -> None:
    built(judged, recipe, tmp_path / "judged")
    built(recording, recipe, tmp_path / "unjudged")

    assert contents(tmp_path / "judged") == contents(tmp_path / "unjudged")
