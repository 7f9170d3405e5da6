"""Sines, cosines and rotations from angles, spelt out: every processor computes the same bits."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from civil_rgbd.geometry.transforms import unit_quaternion

_TERMS: Final = 11  # x^23 / 23! < 3e-18 at pi / 2


def sine_and_cosine(
    angle_rad: ArrayLike,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the sine and the cosine of angles of any shape; errors stay below 1e-15.

    >>> sine, cosine = sine_and_cosine([0.0, math.pi / 6])
    >>> [round(float(value), 12) for value in (*sine, *cosine)]
    [0.0, 0.5, 1.0, 0.866025403784]
    """
    angle = np.asarray(angle_rad, dtype=np.float64)
    turns = np.floor(angle / math.pi + 0.5)
    x = angle - turns * math.pi  # -pi / 2 to pi / 2
    sign = 1.0 - 2.0 * np.remainder(turns, 2.0)
    square = x * x
    sine, cosine = np.zeros_like(x), np.zeros_like(x)
    for n in range(_TERMS, -1, -1):
        alternating = -1.0 if n % 2 else 1.0
        sine = alternating / math.factorial(2 * n + 1) + square * sine
        cosine = alternating / math.factorial(2 * n) + square * cosine
    return sign * x * sine, sign * cosine


def quaternions_from_rotation_vectors(vectors_rad: NDArray[np.float64]) -> NDArray[np.float64]:
    """Turn rotation vectors (axis times angle) into unit quaternions.

    Args:
        vectors_rad: (N, 3).

    Returns:
        (N, 4) float64, order xyzw, w >= 0.
    """
    vx, vy, vz = (vectors_rad[:, axis].astype(np.float64) for axis in range(3))
    angle = np.sqrt(vx * vx + vy * vy + vz * vz)
    sine, cosine = sine_and_cosine(0.5 * angle)
    # sin(a / 2) / a tends to a half; below this angle it is one in float64.
    share = np.where(angle > 1e-8, sine / np.where(angle > 1e-8, angle, 1.0), 0.5)
    return unit_quaternion(np.stack([share * vx, share * vy, share * vz, cosine], axis=1))


def rotation_from_roll_pitch_yaw(
    roll_deg: float, pitch_deg: float, yaw_deg: float
) -> NDArray[np.float64]:
    """Return Rz(yaw) Ry(pitch) Rx(roll), (3, 3) float64.

    >>> (rotation_from_roll_pitch_yaw(0.0, 0.0, 90.0) + 0.0).round(9).tolist()
    [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    """
    angles = np.array([roll_deg, pitch_deg, yaw_deg]) * (math.pi / 180)
    (sr, sp, sy), (cr, cp, cy) = sine_and_cosine(angles)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )
