"""Messages in the map: read once while they are kept, forgotten when there are too many."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from civil_rgbd.domain.recipe import AccumulateStage, Recipe, VisibilityStage
from civil_rgbd.domain.rig import Rig
from civil_rgbd.domain.scan import LidarScan
from civil_rgbd.geometry.camera import LensCamera, PinholeCamera
from civil_rgbd.pipeline.mapped_scans import MappedScans

from ..recordings import MemoryRecording, standing_still

SECOND = 10**9
RECIPE = Recipe("test", accumulate=AccumulateStage(points=10), visibility=None)


def recording_of(scans: int) -> MemoryRecording:
    """Four points a second."""
    points = np.full((4, 3), 5.0, dtype=np.float32)
    return MemoryRecording(
        rig=Rig(LensCamera(PinholeCamera(8, 6, 4.0, 4.0, 3.5, 2.5)), np.eye(4), np.eye(4)),
        trajectory=standing_still(),
        scans=[LidarScan((1 + i) * SECOND, points) for i in range(scans)],
    )


@pytest.mark.parametrize(
    ("hiding", "kept"), [(None, {2, 3, 4, 5, 6}), (12, {1, 2, 3, 4, 5, 6}), (14, set(range(7)))]
)
def test_two_of_the_widest_windows_worth_of_points_are_kept(
    hiding: int | None, kept: set[int]
) -> None:
    recording = recording_of(7)
    stage = None if hiding is None else VisibilityStage(points=hiding)
    scans = MappedScans(recording, replace(RECIPE, visibility=stage))
    for scan in range(7):
        scans.read(scan)

    for scan in sorted(kept):
        scans.read(scan)

    assert set(recording.scans_read.values()) == {1}
    assert set(scans.counts) == set(range(7))
    for scan in set(range(7)) - kept:
        scans.read(scan)
        assert recording.scans_read[scan] == 2


def test_a_message_of_more_points_than_are_kept_is_kept_while_it_is_the_last() -> None:
    recording = recording_of(2)
    scans = MappedScans(recording, replace(RECIPE, accumulate=AccumulateStage(points=1)))

    first, again = scans.read(0), scans.read(0)
    scans.read(1)
    scans.read(0)

    assert first is again
    assert recording.scans_read == {0: 2, 1: 1}


def test_counts_begin_anew_and_messages_that_are_kept_count_again() -> None:
    scans = MappedScans(recording_of(3), RECIPE)
    scans.read(0)
    scans.read(1)
    before = scans.counts

    scans.forget_counts()
    scans.read(1)

    assert {scan: count.read for scan, count in scans.counts.items()} == {1: 4}
    assert set(before) == {0, 1}
