"""The time offset, of a walk whose stamps are shifted, and of one that does not turn."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from civil_rgbd.converters import open_recording
from civil_rgbd.domain.recording import Recording
from civil_rgbd.domain.rig import Rig
from civil_rgbd.geometry.trajectory import Trajectory
from civil_rgbd.health.rotations import rotation_vector
from civil_rgbd.health.sampling import Supposed, stretches_of
from civil_rgbd.health.tracks import Pair, pairs_of
from civil_rgbd.health.turning import time_offset
from civil_rgbd.health.views import Views, small_grey


@dataclass(frozen=True, eq=False)
class Changed:
    """A recording that says something else of its rig or poses."""

    inner: Recording
    rig: Rig
    trajectory: Trajectory

    def __getattr__(self, name: str) -> object:
        return getattr(self.inner, name)


@pytest.fixture(scope="module")
def walk(turning_walk: Path) -> tuple[Recording, tuple[Pair, ...]]:
    """The walk, and features followed in it."""
    recording = open_recording(turning_walk)
    stretches = tuple(stretches_of(recording))
    return recording, pairs_of(recording, stretches, Views(recording))


@pytest.mark.parametrize("offset_s", [0.0, 0.03, -0.1, 0.1, 0.3, -0.9])
def test_the_shift_of_stamps_is_found_with_its_sign(
    walk: tuple[Recording, tuple[Pair, ...]], offset_s: float
) -> None:
    recording, pairs = walk
    rig = replace(recording.rig, camera_time_offset_s=-offset_s)
    early = Changed(recording, rig, recording.trajectory)

    found = time_offset(early, pairs)

    assert found.offset_s == pytest.approx(offset_s, abs=0.005)
    assert found.sigma_s < 0.004


@pytest.fixture(scope="module")
def whole_walk(turning_walk: Path) -> tuple[Recording, tuple[Pair, ...]]:
    """The walk, and features followed through nearly all of it, as a longer one has."""
    recording = open_recording(turning_walk)
    first_ns = int(recording.image_stamps_ns.min())
    starts = [first_ns + number * 1_000_000_000 for number in range(8)]
    stretches = tuple(stretches_of(recording, starts))
    return recording, pairs_of(recording, stretches, Views(recording))


def test_a_clock_that_drifts_is_seen_though_no_log_time_tells(
    whole_walk: tuple[Recording, tuple[Pair, ...]],
) -> None:
    recording, pairs = whole_walk
    stamps_ns = recording.image_stamps_ns
    share = 0.05 * 1e9 / (stamps_ns[-1] - stamps_ns[0])
    late_ns = np.round((stamps_ns - stamps_ns[0]) * share).astype(np.int64)
    drifting = Supposed(recording.rig, recording.trajectory, stamps_ns - late_ns)

    steady = time_offset(recording, pairs).change
    change = time_offset(drifting, pairs).change

    assert change.certain
    assert change.change_s == pytest.approx(0.05, abs=0.01)
    assert "from start to end" in change.words
    assert not steady.certain
    assert steady.words == ""


def test_one_part_off_the_rest_is_named(
    whole_walk: tuple[Recording, tuple[Pair, ...]],
) -> None:
    recording, pairs = whole_walk
    stamps_ns = recording.image_stamps_ns
    last = stamps_ns > stamps_ns[0] + 5.95e9
    broken = Supposed(recording.rig, recording.trajectory, stamps_ns - 60_000_000 * last)

    change = time_offset(broken, pairs).change

    assert change.certain
    assert change.words.startswith("in the last quarter it is +")


def test_without_turning_there_is_no_number_but_a_reason(
    walk: tuple[Recording, tuple[Pair, ...]],
) -> None:
    recording, pairs = walk
    poses = recording.trajectory
    upright = np.tile([0.0, 0.0, 0.0, 1.0], (len(poses.stamps_ns), 1))
    still = Trajectory(poses.stamps_ns, poses.translations_m, upright)
    changed = Changed(recording, recording.rig, still)

    found = time_offset(changed, pairs)

    assert found.offset_s is None
    assert "0.00 rad/s RMS; 0.2 with changing sign are needed" in found.why_not


def test_turning_one_way_only_is_not_enough(
    walk: tuple[Recording, tuple[Pair, ...]],
) -> None:
    recording, pairs = walk
    poses = recording.trajectory
    half = 0.4 * (poses.stamps_ns - poses.start_ns) / 2e9
    zero = np.zeros(len(half))
    turns = np.stack([zero, zero, np.sin(half), np.cos(half)], axis=1)
    one_way = Changed(
        recording, recording.rig, Trajectory(poses.stamps_ns, poses.translations_m, turns)
    )

    found = time_offset(one_way, pairs)

    assert found.offset_s is None
    assert found.why_not == "the sensors turn one way only; a turn with changing sign is needed"


def test_poses_of_another_walk_give_no_number(
    walk: tuple[Recording, tuple[Pair, ...]],
) -> None:
    recording, pairs = walk
    poses = recording.trajectory
    other = Trajectory(
        poses.stamps_ns, poses.translations_m[::-1].copy(), poses.quaternions_xyzw[::-1].copy()
    )
    changed = Changed(recording, recording.rig, other)

    found = time_offset(changed, pairs)

    assert found.offset_s is None
    assert found.why_not


def test_rotation_vectors_are_axis_times_angle() -> None:
    angle = 0.7
    R = np.array([
        [1.0, 0, 0],
        [0, np.cos(angle), -np.sin(angle)],
        [0, np.sin(angle), np.cos(angle)],
    ])  # fmt: skip

    assert np.allclose(rotation_vector(R), [angle, 0, 0])
    assert np.allclose(rotation_vector(np.eye(3)), 0)


def test_small_images_are_whole_ones_shrunk(turning_walk: Path) -> None:
    recording = open_recording(turning_walk)
    whole = recording.read_image(3).rgb.mean(axis=2)

    small = small_grey(recording, 3, 2)

    assert small is not None
    assert small.shape == (-(-whole.shape[0] // 2), -(-whole.shape[1] // 2))
    assert abs(float(small.mean()) - float(whole.mean())) < 4


def test_views_beside_each_other_share_what_they_saw(turning_walk: Path) -> None:
    views = Views(open_recording(turning_walk))
    other = views.through(open_recording(turning_walk))

    assert views.at(3) is other.at(3)
    assert views.at(3) is not None
