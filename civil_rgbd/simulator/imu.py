"""What the recording's IMU says: the truth, or with the noise and the biases of a real one."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.simulator.spec import ScanSpec
from civil_rgbd.simulator.walk import POSE_RATE_HZ, imu_readings, pose_stamps_ns

# The BMI088 inside the Avia: its data sheet's noise densities over the 100 Hz that 200 readings a
# second can carry; biases as they remain after its own calibration.
_BANDWIDTH_HZ: Final = POSE_RATE_HZ / 2
_GYRO_NOISE_RAD_S: Final = math.radians(0.014) * math.sqrt(_BANDWIDTH_HZ)
_FORCE_NOISE_G: Final = 175e-6 * math.sqrt(_BANDWIDTH_HZ)
_GYRO_BIAS_RAD_S: Final = 0.003
_FORCE_BIAS_G: Final = 0.003
_BIAS_WALK_SHARE: Final = 0.01  # of the bias, after a second; an assumption


def recorded_imu(
    spec: ScanSpec,
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """Return what the IMU measures, with ``imu_noise`` times the errors of the Avia's.

    Returns:
        stamps (P,) int64, 200 Hz; angular velocity (P, 3) rad/s; specific force (P, 3) in g; IMU
        frame.
    """
    stamps = pose_stamps_ns(spec)
    rate, force = imu_readings(spec, stamps)
    if not spec.imu_noise:
        return stamps, rate, force
    rng = np.random.default_rng([spec.seed, 4])
    gyro = _error(rng, len(stamps), _GYRO_NOISE_RAD_S, _GYRO_BIAS_RAD_S)
    accelerometer = _error(rng, len(stamps), _FORCE_NOISE_G, _FORCE_BIAS_G)
    return stamps, rate + spec.imu_noise * gyro, force + spec.imu_noise * accelerometer


def _error(rng: np.random.Generator, count: int, noise: float, bias: float) -> NDArray[np.float64]:
    """Return (count, 3) errors: white noise, a constant bias and its random walk."""
    step = _BIAS_WALK_SHARE / math.sqrt(POSE_RATE_HZ)
    walk = np.cumsum(rng.standard_normal((count, 3)) * step, axis=0)
    constant = rng.standard_normal(3)
    return noise * rng.standard_normal((count, 3)) + bias * (constant + walk)
