"""The quality of poses in a file beside them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from civil_rgbd.errors import RecordingError
from civil_rgbd.trajectories.files import read_trajectory, read_trajectory_file
from civil_rgbd.trajectories.quality import quality_path, quality_text, with_quality

from ..recordings import trajectory_of

S = 10**9
STAMPS = [1_700_000_000 * S + 1, 1_700_000_000 * S + 100_000_003]
PATH = trajectory_of(STAMPS, [(0, 0, 0), (1, 0, 0)])
JUDGED = replace(PATH, quality=np.array([1 / 3, 7.0]))
TUM = "1700000000.000000001 0 0 0 0 0 0 1\n1700000000.100000003 1 0 0 0 0 0 1\n"


def test_quality_comes_back_exactly_with_the_poses(tmp_path: Path) -> None:
    poses = tmp_path / "poses.tum"
    poses.write_text(TUM)
    assert read_trajectory(poses).quality is None

    details = {"residual_m": np.array([np.nan, 0.01])}
    quality_path(poses).write_text(quality_text(JUDGED, details))

    found = read_trajectory_file(poses)
    assert found.trajectory.quality is not None
    assert found.trajectory.quality.tolist() == [1 / 3, 7.0]
    assert [source.converter for source in found.sources] == ["trajectory-tum", "pose-quality"]


def test_an_offset_of_the_poses_moves_their_quality_too(tmp_path: Path) -> None:
    poses = tmp_path / "poses.tum"
    poses.write_text(TUM)
    quality_path(poses).write_text(quality_text(JUDGED, {}))

    moved = read_trajectory(poses, time_offset_ns=-25_000_000)

    assert moved.start_ns == STAMPS[0] - 25_000_000
    assert moved.quality is not None


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "does not begin with the columns stamp, quality"),
        ("quality,stamp\n", "does not begin with the columns"),
        ("stamp,quality\n1700000000.000000001,1\n", "has 1 rows, not those of the 2 poses"),
        (
            "stamp,quality\n1700000000.000000001,1\n1700000000.100000004,1\n",
            "not those of the 2 poses",
        ),
        ("stamp,quality\n1700000000.000000001,-1\n", "has the quality -1 in row 1"),
        ("stamp,quality\n1700000000.000000001,inf\n", "has the quality inf in row 1"),
        ("stamp,quality\n1700000000.000000001\n", "no stamp and quality in row 1"),
        ("stamp,quality\nyesterday,1\n", "no stamp and quality in row 1"),
    ],
)
def test_a_file_of_other_poses_is_refused(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "poses.quality.csv"
    path.write_text(text)

    with pytest.raises(RecordingError, match=message) as info:
        with_quality(PATH, path)

    assert "move this file away" in info.value.fix


def test_poses_that_nobody_judged_have_no_quality_to_write() -> None:
    with pytest.raises(ValueError, match="has no quality"):
        quality_text(PATH, {})
