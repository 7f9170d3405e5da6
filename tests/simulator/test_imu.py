"""What the IMU says: the truth, or the truth with the errors of a BMI088."""

from __future__ import annotations

import numpy as np
import pytest

from civil_rgbd.simulator.imu import recorded_imu
from civil_rgbd.simulator.spec import ScanSpec
from civil_rgbd.simulator.walk import imu_readings, pose_stamps_ns

SPEC = ScanSpec(seconds=20.0, imu_noise=1.0)


def _errors(spec: ScanSpec) -> tuple[np.ndarray, np.ndarray]:
    stamps, rate, force = recorded_imu(spec)
    true_rate, true_force = imu_readings(spec, stamps)
    return rate - true_rate, force - true_force


def test_without_noise_it_tells_the_truth() -> None:
    stamps, rate, force = recorded_imu(ScanSpec())
    true_rate, true_force = imu_readings(ScanSpec(), pose_stamps_ns(ScanSpec()))

    np.testing.assert_array_equal(stamps, pose_stamps_ns(ScanSpec()))
    np.testing.assert_array_equal(rate, true_rate)
    np.testing.assert_array_equal(force, true_force)


def test_its_noise_is_that_of_the_data_sheet_at_200_readings_a_second() -> None:
    gyro, force = _errors(SPEC)

    # Differences of neighbours: no bias in them. 0.014 deg/s and 175 ug a root hertz, 100 Hz.
    assert np.diff(gyro, axis=0).std() / np.sqrt(2) == pytest.approx(np.radians(0.14), rel=0.05)
    assert np.diff(force, axis=0).std() / np.sqrt(2) == pytest.approx(1.75e-3, rel=0.05)


def test_its_biases_are_its_own_and_stay() -> None:
    firsts, lasts = [], []
    for seed in range(12):
        gyro, _ = _errors(ScanSpec(seconds=20.0, imu_noise=1.0, seed=seed))
        firsts.append(gyro[:1000].mean(axis=0))
        lasts.append(gyro[-1000:].mean(axis=0))

    assert np.std(firsts) == pytest.approx(0.003, rel=0.4)
    assert np.abs(np.subtract(firsts, lasts)).max() < 0.001


def test_more_noise_is_the_same_noise_scaled() -> None:
    (gyro, force), (more_gyro, more_force) = (
        _errors(ScanSpec(seconds=2.0, imu_noise=n)) for n in (1.0, 3.0)
    )

    np.testing.assert_allclose(more_gyro, 3 * gyro, rtol=0, atol=1e-12)
    np.testing.assert_allclose(more_force, 3 * force, rtol=0, atol=1e-12)
