"""What quality says of a room, a tunnel and a soffit, and of poses that run away."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from civil_rgbd.geometry.trajectory import Trajectory
from civil_rgbd.odometry.imu import steady_imu
from civil_rgbd.odometry.quality import (
    LOW_QUALITY,
    Limits,
    PoseMeasures,
    held_by_planes,
    measure_poses,
    quality_of,
)
from civil_rgbd.odometry.words import weak_stretches

from .walks import ROOM, SECOND, SOFFIT, START, TUNNEL, Ranges, Walk


def measured(ranges: Ranges, trajectory: Trajectory | None = None) -> PoseMeasures:
    walk = Walk(ranges)
    return measure_poses(
        walk,
        trajectory or walk.truth,
        np.arange(30),
        T_imu_lidar=np.eye(4),
        imu=steady_imu(walk.imu, where="here"),
    )


@pytest.mark.parametrize(
    ("ranges", "loose", "words"),
    [(ROOM, 0, None), (TUNNEL, 1, "one way, as in a smooth tunnel"), (SOFFIT, 2, "two ways")],
)
def test_what_holds_a_scan_is_told_by_its_surfaces(
    ranges: Ranges, loose: int, words: str | None
) -> None:
    measures = measured(ranges)

    held = np.median(measures.held_by[5:], axis=0)
    assert (held < LOW_QUALITY / 5).tolist() == [k < loose for k in range(3)]
    assert (held[loose:] > 5 * LOW_QUALITY).all()
    stretches = weak_stretches(measures, quality_of(measures))
    if words is None:
        assert all(stretch.to_s < 1 for stretch in stretches)
    else:
        assert words in stretches[-1].to_text()
        assert stretches[-1].last == 29


def test_the_residual_is_that_of_the_noise_and_grows_when_the_map_is_smeared() -> None:
    walk = Walk(ROOM)
    wrong = replace(walk.truth, translations_m=walk.places(walk.truth.stamps_ns) * [2.5, 1, 1])

    true, smeared = measured(ROOM), measured(ROOM, wrong)

    # 1 cm along the ray; most rays meet their plane at an angle, which makes it less.
    assert 0.001 < np.median(true.residual_m[5:]) < 0.6745 * 0.01
    assert np.median(smeared.held_by[10:, 0]) < 0.7 * np.median(true.held_by[10:, 0])


def some(**what: object) -> PoseMeasures:
    """40 poses in four seconds, held well, that fit well and walk."""
    usual: dict[str, object] = {
        "stamps_ns": START + np.arange(40, dtype=np.int64) * (SECOND // 10),
        "held_by": np.full((40, 3), 8.0),
        "residual_m": np.full(40, 0.01),
        "overlap": np.ones(40),
        "speed_m_s": np.ones(40),
        "turn_rad_s": np.zeros(40),
        "still": np.zeros(40, dtype=np.bool_),
        "settling": np.zeros(40, dtype=np.bool_),
    }
    return PoseMeasures(**(usual | what))  # type: ignore[arg-type]  # of one test


def test_a_pose_that_moves_as_nobody_walks_is_worthless() -> None:
    speed, turn = np.ones(40), np.zeros(40)
    speed[7], turn[20] = 4.1, 4.1

    quality = quality_of(some(speed_m_s=speed, turn_rad_s=turn))

    assert np.flatnonzero(quality == 0).tolist() == [7, 20]
    assert (quality_of(some(speed_m_s=speed), Limits(speed_m_s=5.0)) == 8.0).all()


def test_a_pose_that_fits_badly_counts_less() -> None:
    residual = np.full(40, 0.01)
    residual[9] = 0.20

    quality = quality_of(some(residual_m=residual))

    assert quality[9] == pytest.approx(2.0)
    assert (np.delete(quality, 9) == 8.0).all()


def test_the_imu_carries_a_held_pose_for_a_moment_and_no_longer() -> None:
    held = np.full((40, 3), 8.0)
    held[10:] = 0.0

    quality = quality_of(some(held_by=held))

    assert (quality[:20] >= LOW_QUALITY).all()
    assert (quality[34:] < LOW_QUALITY).all()


def test_while_nothing_moves_nothing_slides() -> None:
    free = np.zeros((40, 3))

    assert (quality_of(some(held_by=free)) == 0).all()
    assert (quality_of(some(held_by=free, still=np.ones(40, dtype=np.bool_))) > LOW_QUALITY).all()


def test_the_start_of_a_recording_that_begins_in_motion_is_not_trusted() -> None:
    settling = np.arange(40) < 5

    measures = some(settling=settling)
    quality = quality_of(measures)

    assert np.array_equal(quality == 0, settling)
    assert "begins in motion" in weak_stretches(measures, quality)[0].why


def test_stretches_are_told_apart_and_say_when() -> None:
    speed = np.ones(40)
    speed[[3, 4, 30]] = 9.0

    measures = some(speed_m_s=speed)
    first, second = weak_stretches(measures, quality_of(measures))

    assert (first.first, first.last, second.first, second.last) == (3, 4, 30, 30)
    assert first.to_text() == (
        "0.3 s to 0.4 s (0.1 s): the poses move as nobody walks; the poses run away, at up to "
        "9.0 m/s and 0 deg/s"
    )


def test_doubt_in_normals_is_taken_off() -> None:
    up = np.tile([0.0, 0.0, 1.0], (100, 1))

    assert held_by_planes(up, np.full(100, 0.01)).tolist() == [0.0, 0.0, 99.0]
    assert held_by_planes(np.zeros((0, 3)), np.zeros(0)).tolist() == [0.0, 0.0, 0.0]
