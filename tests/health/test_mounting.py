"""The camera's mounting, from how images and poses turn: of a walk whose rig says it wrong."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from civil_rgbd.converters import open_recording
from civil_rgbd.domain.recording import Recording
from civil_rgbd.geometry.transforms import compose, transform_from
from civil_rgbd.health import mounting
from civil_rgbd.health.mounting import turn_of_mounting
from civil_rgbd.health.sampling import Supposed, stretches_of
from civil_rgbd.health.tracks import Pair, pairs_of
from civil_rgbd.health.views import Views

TURN_DEG = np.array([1.4, -0.9, 0.8])


@pytest.fixture(scope="module")
def walk(turning_walk: Path) -> tuple[Recording, tuple[Pair, ...]]:
    """The walk, and features followed in it."""
    recording = open_recording(turning_walk)
    return recording, pairs_of(recording, tuple(stretches_of(recording)), Views(recording))


def _stated(recording: Recording, turn_deg: np.ndarray, late_s: float = 0.0) -> Supposed:
    """The recording with a rig that is to be turned by so much to be right."""
    R, _ = cv2.Rodrigues(np.radians(turn_deg))
    T_body_camera = compose(recording.rig.T_body_camera, transform_from(R.T, np.zeros(3)))
    rig = replace(recording.rig, T_body_camera=T_body_camera, camera_time_offset_s=-late_s)
    return Supposed(rig, recording.trajectory, recording.image_stamps_ns)


def _off(found: tuple[np.ndarray, np.ndarray], turn_deg: np.ndarray) -> np.ndarray:
    """By how many standard errors each axis is off."""
    turn, sigma = found
    return np.abs(turn - np.radians(turn_deg)) / sigma


@pytest.mark.parametrize("turn_deg", [np.zeros(3), TURN_DEG, -TURN_DEG])
def test_the_turn_is_found_with_its_sign_within_its_errors(
    walk: tuple[Recording, tuple[Pair, ...]], turn_deg: np.ndarray
) -> None:
    recording, pairs = walk

    found = turn_of_mounting(_stated(recording, turn_deg), pairs, 0.0)

    assert (_off(found, turn_deg) < 2.5).all()
    assert (found[1] < np.radians(0.8)).all()


def test_a_shift_of_stamps_is_taken_into_account(
    walk: tuple[Recording, tuple[Pair, ...]],
) -> None:
    recording, pairs = walk

    known = turn_of_mounting(_stated(recording, TURN_DEG, late_s=0.05), pairs, 0.05)

    assert np.allclose(known[0], turn_of_mounting(_stated(recording, TURN_DEG), pairs, 0.0)[0])


def test_asked_from_where_the_camera_is_the_answer_is_surer(
    walk: tuple[Recording, tuple[Pair, ...]], monkeypatch: pytest.MonkeyPatch
) -> None:
    recording, pairs = walk
    stated = _stated(recording, 2 * TURN_DEG)
    twice = turn_of_mounting(stated, pairs, 0.0)
    monkeypatch.setattr(mounting, "_PASSES", 1)

    once = turn_of_mounting(stated, pairs, 0.0)

    assert (twice[1] < once[1]).all()
