"""What quality says of a room, a tunnel and a soffit, and of poses that run away."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from civil_rgbd.geometry.trajectory import Trajectory
from civil_rgbd.odometry.drift import FEWEST_PLANES
from civil_rgbd.odometry.imu import steady_imu
from civil_rgbd.odometry.quality import (
    Limits,
    PoseMeasures,
    held_by_planes,
    measure_poses,
    quality_of,
)
from civil_rgbd.odometry.words import carried_stretches, weak_stretches

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
    assert (held < FEWEST_PLANES / 5).tolist() == [k < loose for k in range(3)]
    assert (held[loose:] > 5 * FEWEST_PLANES).all()
    # The IMU of this walk says that it stands, which only surfaces can deny.
    stretches = weak_stretches(measures, quality_of(measures))
    if words is None:
        assert not stretches
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
        "drift_m": np.full(40, 0.02),
        "drift_rad": np.full(40, 0.001),
        "settling": np.zeros(40, dtype=np.bool_),
    }
    return PoseMeasures(**(usual | what))  # type: ignore[arg-type]  # of one test


def test_a_pose_that_moves_as_nobody_walks_is_worthless() -> None:
    speed, turn = np.ones(40), np.zeros(40)
    speed[7], turn[20] = 4.1, 4.1

    quality = quality_of(some(speed_m_s=speed, turn_rad_s=turn))

    assert np.flatnonzero(quality == 0).tolist() == [7, 20]
    assert (quality_of(some(speed_m_s=speed), Limits(speed_m_s=5.0)) == 2.0).all()


def test_a_pose_that_fits_badly_counts_less() -> None:
    residual = np.full(40, 0.01)
    residual[9] = 0.20

    quality = quality_of(some(residual_m=residual))

    assert quality[9] == pytest.approx(0.5)
    assert (np.delete(quality, 9) == 2.0).all()


def test_quality_is_the_drift_to_expect_turned_over() -> None:
    drift = np.array([0.0, 0.004, 0.02, 0.04, 0.08, 0.4, np.inf])
    turn = np.array([0.0, 0.0006, 0.003, 0.006, 0.012, 0.06, np.inf])
    calm = np.zeros(7)
    slide = some(drift_m=drift, drift_rad=calm, **{name: np.ones(7) for name in SEVEN})
    spin = some(drift_m=calm, drift_rad=turn, **{name: np.ones(7) for name in SEVEN})

    expected = [10.0, 10.0, 2.0, 1.0, 0.5, 0.1, 0.0]
    assert quality_of(slide, Limits(residual_m=1.0)).tolist() == pytest.approx(expected)
    assert quality_of(spin, Limits(residual_m=1.0)).tolist() == pytest.approx(expected)


SEVEN = ("residual_m", "speed_m_s", "turn_rad_s")


def test_one_pose_alone_cannot_be_judged() -> None:
    walk = Walk(ROOM)
    one = Trajectory(
        *(
            part[:1]
            for part in (
                walk.truth.stamps_ns,
                walk.truth.translations_m,
                walk.truth.quaternions_xyzw,
            )
        )
    )
    imu = steady_imu(walk.imu, where="here")

    found = measure_poses(walk, one, np.arange(1), T_imu_lidar=np.eye(4), imu=imu)

    assert quality_of(found).tolist() == [0.0]


@pytest.mark.parametrize(
    ("what", "words"),
    [
        ({"settling": True, "drift_m": 0.5}, "begins in motion"),
        ({"held_by": 0.1, "drift_m": 0.5}, "too few flat surfaces"),
        ({"residual_m": 0.5}, "the scans do not fit the map"),
        ({"drift_rad": np.radians(2.0)}, "otherwise than the gyroscope, by up to 2.0 deg"),
        ({"drift_m": 0.3}, "otherwise than IMU and surfaces say, by up to 30 cm a second"),
    ],
)
def test_it_is_said_why_poses_cannot_be_trusted(what: dict[str, float], words: str) -> None:
    usual = some()
    measures = some(
        **{name: np.full_like(getattr(usual, name), value) for name, value in what.items()}
    )

    (stretch,) = weak_stretches(measures, quality_of(measures))

    assert words in stretch.why
    assert (stretch.first, stretch.last) == (0, 39)


def test_it_is_said_where_the_imu_carries_poses_that_no_surface_holds() -> None:
    held = np.full((40, 3), 8.0)
    held[10:25, 0] = held[37:40, 0] = 0.1
    drift = np.full(40, 0.02)
    drift[20] = 0.05

    measures = some(held_by=held, drift_m=drift)
    (stretch,) = carried_stretches(measures, quality_of(measures))

    assert stretch.to_text() == "1.0 s to 2.4 s (1.4 s): up to 5 cm a second may be lost"
    assert not carried_stretches(measures, np.zeros(40))


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

    assert np.diag(held_by_planes(up, np.full(100, 0.01))) == pytest.approx([-1.0, -1.0, 99.0])
    assert not held_by_planes(np.zeros((0, 3)), np.zeros(0)).any()
