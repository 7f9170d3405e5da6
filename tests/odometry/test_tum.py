"""What engines leave is read exactly or refused; what we write comes back bit for bit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given

from civil_rgbd.errors import OdometryError
from civil_rgbd.geometry.trajectory import Trajectory
from civil_rgbd.odometry.tum import read_engine_poses, tum_text
from civil_rgbd.trajectories.files import read_trajectory

from ..strategies import trajectories
from .walks import ROOM, Walk

GOOD = "1700000000.1 1 2 3 0 0 0 1\n1700000000.200000001 1 2 3 0 0 0.6 -0.8\n"


def read(folder: Path, text: str) -> Trajectory:
    path = folder / "answer.tum"
    path.write_text(text)
    return read_engine_poses(path)


def test_stamps_keep_every_nanosecond(tmp_path: Path) -> None:
    found = read(tmp_path, "# a remark\n" + GOOD)

    assert found.stamps_ns.tolist() == [1_700_000_000_100_000_000, 1_700_000_000_200_000_001]
    assert found.quaternions_xyzw[1] == pytest.approx([0, 0, -0.6, 0.8])


def test_six_digits_of_a_quaternion_are_scaled_to_norm_1(tmp_path: Path) -> None:
    found = read(tmp_path, "1.5 0 0 0 0.182574 0.365148 0.547723 0.730297\n")

    assert np.linalg.norm(found.quaternions_xyzw) == pytest.approx(1, abs=1e-15)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "holds no pose"),
        ("# only words\n", "holds no pose"),
        (GOOD + "1700000000.3 1 2\n", "no pose in line 3"),
        (GOOD + "1700000000.3 1 2 nan 0 0 0 1\n", "no pose in line 3"),
        (GOOD + "1.7e9 1 2 3 0 0 0 1\n", "no pose in line 3"),
        (GOOD + "1700000000.15 1 2 3 0 0 0 1\n", "makes no trajectory: stamp 2"),
        (GOOD + "1700000000.3 1 2 3 0 0 0 0.9\n", "not of norm 1"),
        (GOOD + "1700000000.3 1 2 3 0 0 0 0\n", "not of norm 1"),
        (GOOD + "1700000000.3 1 2 \x00\xff 0 0 0 1\n", "no pose in line 3"),
    ],
)
def test_an_answer_that_is_none_is_refused(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(OdometryError, match=message) as info:
        read(tmp_path, text)

    assert "--keep" in info.value.fix


@given(trajectories())
def test_what_we_write_is_read_back_bit_for_bit(
    tmp_path_factory: pytest.TempPathFactory, path: Trajectory
) -> None:
    file = tmp_path_factory.mktemp("tum") / "poses.tum"
    file.write_text(tum_text(path, ("body: imu",)))

    back = read_engine_poses(file)

    assert np.array_equal(back.stamps_ns, path.stamps_ns)
    assert np.array_equal(back.translations_m, path.translations_m)
    assert back.quaternions_xyzw == pytest.approx(path.quaternions_xyzw, abs=1e-15)


def test_the_reader_of_trajectory_files_takes_it_for_tum(tmp_path: Path) -> None:
    walk = Walk(ROOM).truth
    file = tmp_path / "poses.tum"
    file.write_text(tum_text(walk, ("genz-lio 0.1.1: poses of the imu",)))

    back = read_trajectory(file)

    assert np.array_equal(back.stamps_ns, walk.stamps_ns)
    assert np.array_equal(back.translations_m, walk.translations_m)
