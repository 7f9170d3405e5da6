"""Units told from gravity; order, doubles and gaps."""

from __future__ import annotations

import numpy as np
import pytest

from civil_rgbd.domain.motion import ImuReadings
from civil_rgbd.errors import RecordingError
from civil_rgbd.odometry.imu import steady_imu

MS = 1_000_000


def readings(force: float = 9.8, count: int = 400, step_ms: int = 5) -> ImuReadings:
    tilted = np.tile([0.6 * force, 0.0, 0.8 * force], (count, 1))
    stamps = np.arange(count, dtype=np.int64) * step_ms * MS
    return ImuReadings(stamps, np.zeros((count, 3)), tilted)


@pytest.mark.parametrize(("force", "unit"), [(1.0, "g"), (0.9, "g"), (9.6, "m/s2"), (10.4, "m/s2")])
def test_the_unit_is_told_from_the_size_of_gravity_in_any_attitude(force: float, unit: str) -> None:
    steady = steady_imu(readings(force), where="imu")

    assert steady.unit == unit
    expected = force * (9.80665 if unit == "g" else 1.0)
    assert np.linalg.norm(steady.forces_m_s2, axis=1) == pytest.approx(expected)


@pytest.mark.parametrize("force", [0.0, 0.02, 3.0, 98.0])
def test_a_force_of_neither_unit_is_refused(force: float) -> None:
    with pytest.raises(RecordingError, match="neither gravity in g") as info:
        steady_imu(readings(force), where="imu")

    assert "takes gravity out" in info.value.fix


def test_readings_are_put_in_order_and_doubles_are_counted() -> None:
    given = readings()
    given.stamps_ns[[10, 11]] = given.stamps_ns[[11, 10]]
    given.stamps_ns[20] = given.stamps_ns[19]
    given.rates_rad_s[:, 0] = np.arange(400)
    given.forces[30, 1] = np.nan

    steady = steady_imu(given, where="imu")

    assert (np.diff(steady.stamps_ns) > 0).all()
    assert len(steady.stamps_ns) == 398
    assert steady.rates_rad_s[9:13, 0].tolist() == [9.0, 11.0, 10.0, 12.0]
    assert steady.remarks == (
        "1 IMU readings are not finite and are left out",
        "2 IMU readings were out of order and are put in order",
        "1 IMU readings repeat a stamp and are left out",
    )


def test_a_gap_is_said_with_its_place() -> None:
    given = readings()
    given.stamps_ns[200:] += 400 * MS

    (remark,) = steady_imu(given, where="imu").remarks

    assert remark == "1 gaps in the IMU, the longest 0.41 s after 0.99 s"


@pytest.mark.parametrize(("count", "step_ms"), [(0, 5), (1, 5), (100, 25)])
def test_too_slow_an_imu_is_refused(count: int, step_ms: int) -> None:
    with pytest.raises(RecordingError, match="odometry needs 50 Hz"):
        steady_imu(readings(count=count, step_ms=step_ms), where="imu")
