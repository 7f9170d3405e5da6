"""What is said of the camera's mounting, by edges and by turning: of a walk whose rig is wrong."""

from __future__ import annotations

import json
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from civil_rgbd.converters import open_recording
from civil_rgbd.domain.recording import Recording
from civil_rgbd.geometry.transforms import compose, transform_from
from civil_rgbd.health.checks import Figure
from civil_rgbd.health.extrinsics import extrinsics_figure
from civil_rgbd.health.mounting import with_camera_turned
from civil_rgbd.health.rotations import rotation
from civil_rgbd.health.sampling import Stretch, stretches_of
from civil_rgbd.health.tracks import Pair, pairs_of
from civil_rgbd.health.views import Views


class Seen(NamedTuple):
    """The walk, and what a check looks at."""

    recording: Recording
    stretches: tuple[Stretch, ...]
    pairs: tuple[Pair, ...]
    views: Views


@pytest.fixture(scope="module")
def seen(turning_walk: Path) -> Seen:
    """The walk, looked at once."""
    recording = open_recording(turning_walk)
    stretches, views = tuple(stretches_of(recording)), Views(recording)
    return Seen(recording, stretches, pairs_of(recording, stretches, views), views)


def _said(seen: Seen, turn_deg: tuple[float, ...], stretches: tuple[Stretch, ...]) -> Figure:
    """Judge a rig that is to be turned by so much to be right."""
    wrong = with_camera_turned(seen.recording, -np.radians(turn_deg))
    return extrinsics_figure(wrong, stretches, seen.pairs, seen.views, 0.0)


def _numbers(figure: Figure) -> list[float]:
    words = figure.detail.replace(",", "").split()
    return [float(words[words.index(axis) + 1]) for axis in "xyz"]


@pytest.mark.parametrize("turn_deg", [(1.1, 0.0, 0.0), (-0.7, 0.9, -0.6), (1.0, 5.0, -2.0)])
def test_a_turned_camera_is_a_finding_with_its_turn(
    seen: Seen, turn_deg: tuple[float, float, float]
) -> None:
    figure = _said(seen, turn_deg, seen.stretches)

    assert figure.found
    assert np.allclose(_numbers(figure), turn_deg, atol=0.25)
    assert figure.value == pytest.approx(np.sqrt(np.square(turn_deg).sum()), abs=0.25)


def test_the_camera_as_it_is_is_no_finding(seen: Seen) -> None:
    figure = _said(seen, (0.0, 0.0, 0.0), seen.stretches)

    assert not figure.found


def test_the_remedy_is_the_mounting_as_it_should_be(seen: Seen) -> None:
    figure = _said(seen, (0.0, 5.0, 0.0), seen.stretches)

    written = np.array(json.loads(figure.fix.rsplit(" = ", 1)[1]))
    right = seen.recording.rig.T_lidar_camera
    between = compose(np.linalg.inv(written), right)
    assert np.trace(between[:3, :3]) > 3 - np.radians(0.3) ** 2
    assert np.allclose(written[:3, 3], right[:3, 3], atol=1e-5)


def test_without_edges_only_what_is_far_off_is_a_finding(seen: Seen) -> None:
    far = _said(seen, (0.0, 4.0, 0.0), ())
    near = _said(seen, (0.0, 0.6, 0.0), ())

    assert far.found
    assert "only 0 depth edges are in view" in far.detail
    assert near.value is None
    assert near.detail == "only 0 depth edges are in view"


def test_a_turn_is_about_the_camera_s_own_axes(seen: Seen) -> None:
    turn = np.radians((0.0, 5.0, 0.0))

    turned = with_camera_turned(seen.recording, turn).rig.T_lidar_camera

    expected = compose(
        seen.recording.rig.T_lidar_camera, transform_from(rotation(turn), np.zeros(3))
    )
    assert np.allclose(turned, expected)
