"""What an engine answers is put at its instants, or refused."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from civil_rgbd.errors import OdometryError
from civil_rgbd.odometry.engines import ENGINES, START, Engine
from civil_rgbd.odometry.environment import find_program
from civil_rgbd.odometry.run import PoseEstimate, estimate_poses
from civil_rgbd.odometry.tum import seconds_text, tum_text

from .fakes import fake_environment
from .walks import ROOM, SECOND, Walk, last_offset

pytestmark = pytest.mark.skipif(os.name == "nt", reason="the stand-in engines are scripts")

SE3 = ENGINES["se3-lio"]
WALK = Walk(ROOM, seconds=2.0)
ANSWER = "(out / 'x_se3lio.tum').write_text(truth)"


def estimated(
    folder: Path, code: str = ANSWER, *, truth: str | None = None, engine: Engine = SE3
) -> PoseEstimate:
    environment = fake_environment(folder / "environment", engine, code)
    (environment / "truth.tum").write_text(truth or tum_text(WALK.truth))
    scratch = folder / "scratch"
    scratch.mkdir()
    return estimate_poses(
        WALK,
        engine,
        find_program(engine, environment),
        T_imu_lidar=np.eye(4),
        scratch=scratch,
        timeout_s=60,
    )


@pytest.mark.parametrize("name", ENGINES)
def test_the_poses_come_back_at_the_ends_of_their_scans(tmp_path: Path, name: str) -> None:
    answer = "(out / 'deep').mkdir(); (out / 'deep' / 'a_tum.txt').write_text(truth)"

    found = estimated(tmp_path, answer, engine=ENGINES[name])

    assert np.array_equal(found.trajectory.stamps_ns, WALK.truth.stamps_ns)
    assert np.array_equal(found.trajectory.translations_m, WALK.truth.translations_m)
    assert found.scan_indices.tolist() == list(range(20))
    assert found.imu.unit == "m/s2"


def test_a_stamp_that_a_float_rounded_is_put_right(tmp_path: Path) -> None:
    moved = replace(WALK.truth, stamps_ns=WALK.truth.stamps_ns + 238)

    found = estimated(tmp_path, truth=tum_text(moved))

    assert np.array_equal(found.trajectory.stamps_ns, WALK.truth.stamps_ns)


def test_an_engine_that_ends_a_scan_earlier_is_believed(tmp_path: Path) -> None:
    moved = replace(WALK.truth, stamps_ns=WALK.truth.stamps_ns - 40_000_000)

    found = estimated(tmp_path, truth=tum_text(moved))

    assert np.array_equal(found.trajectory.stamps_ns, moved.stamps_ns)
    assert found.scan_indices.tolist() == list(range(20))


def test_stamps_of_starts_with_poses_of_ends_are_told_apart(tmp_path: Path) -> None:
    engine = replace(SE3, stamps_name=START)
    named = replace(WALK.truth, stamps_ns=WALK.scan_stamps_ns)

    found = estimated(tmp_path, truth=tum_text(named), engine=engine)

    assert np.array_equal(found.trajectory.stamps_ns, WALK.scan_stamps_ns + last_offset())


def test_scans_in_between_without_a_pose_are_counted(tmp_path: Path) -> None:
    lines = tum_text(WALK.truth).splitlines()

    found = estimated(tmp_path, truth="\n".join(lines[:8] + lines[11:]))

    assert found.remarks[-1] == "se3-lio gave no pose for 3 scans in between"
    assert 7 not in found.scan_indices


def lines(*which: slice) -> str:
    rows = [row for row in tum_text(WALK.truth).splitlines() if not row.startswith("#")]
    return "\n".join("\n".join(rows[part]) for part in which)


def shifted(by_ns: int) -> str:
    return tum_text(replace(WALK.truth, stamps_ns=WALK.truth.stamps_ns + by_ns))


@pytest.mark.parametrize(
    ("truth", "message"),
    [
        (lines(slice(9)), r"do not cover the scan.* end 1\.10 s before it does"),
        (lines(slice(0, 20, 3)), "35% of the scans have one"),
        (shifted(5 * SECOND), "do not belong to the scans"),
        (shifted(150_000_000), "do not belong to the scans"),
        (
            lines(slice(20)).replace(seconds_text(int(WALK.truth.stamps_ns[4])), "1"),
            "no trajectory",
        ),
    ],
)
def test_poses_that_cannot_be_those_of_the_scans_are_refused(
    tmp_path: Path, truth: str, message: str
) -> None:
    with pytest.raises(OdometryError, match=message):
        estimated(tmp_path, truth=truth)


@pytest.mark.parametrize(
    ("code", "message"),
    [
        ("print('all well')", r"(?s)left 0 trajectories.*all well"),
        (f"{ANSWER}; (out / 'y_tum.txt').write_text(truth)", "left 2 trajectories"),
        ("sys.exit('no IMU topic')", r"(?s)se3-lio 0\.2\.0 failed with exit code 1.*no IMU topic"),
        ("import os; os.abort()", "killed by signal 6"),
    ],
)
def test_an_engine_that_fails_is_quoted(tmp_path: Path, code: str, message: str) -> None:
    with pytest.raises(OdometryError, match=message) as info:
        estimated(tmp_path, code)

    assert "--engine" in info.value.fix
