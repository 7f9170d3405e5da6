"""Transforms in words, so that a person can see whether they are the right way round."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray


def extrinsics_in_words(T_a_camera: NDArray[np.float64], *, seen_from: str = "LiDAR") -> str:
    """Say where the camera sits and looks, seen from another sensor.

    Args:
        T_a_camera: (4, 4) camera optical frame to the other sensor's frame.
        seen_from: the other sensor.

    >>> T = np.array([[0., 0, 1, 0.1], [-1, 0, 0, 0], [0, -1, 0, -0.05], [0, 0, 0, 1]])
    >>> words = extrinsics_in_words(T).split(", looks along its ")
    >>> print(words[0])
    the camera sits at x 0.100, y 0.000, z -0.050 m of the LiDAR
    >>> print(words[1])
    +x (0.0 deg off), its right is -y (0.0 deg off), its down is -z (0.0 deg off)
    """
    axes = [_axis_in_words(T_a_camera[:3, column]) for column in (2, 0, 1)]
    return (
        f"the camera sits at {_place(T_a_camera)} of the {seen_from}, looks along its "
        f"{axes[0]}, its right is {axes[1]}, its down is {axes[2]}"
    )


def mounting_in_words(T_a_b: NDArray[np.float64], *, what: str, seen_from: str) -> str:
    """Say where a sensor sits on another, and where its axes point there.

    Args:
        T_a_b: (4, 4) frame of ``what`` to frame of ``seen_from``.
        what: the sensor that is looked at.
        seen_from: the sensor it is looked at from.

    >>> print(mounting_in_words(np.eye(4), what="LiDAR", seen_from="IMU"))
    the LiDAR sits at x 0.000, y 0.000, z 0.000 m of the IMU, its axes are parallel to the IMU's
    """
    start = f"the {what} sits at {_place(T_a_b)} of the {seen_from}"
    if bool((np.abs(T_a_b[:3, :3] - np.eye(3)) < 1e-6).all()):
        return f"{start}, its axes are parallel to the {seen_from}'s"
    axes = [_axis_in_words(T_a_b[:3, column]) for column in range(3)]
    return f"{start}, its x points along {axes[0]}, its y along {axes[1]}, its z along {axes[2]}"


def _place(T_a_b: NDArray[np.float64]) -> str:
    x, y, z = T_a_b[:3, 3] + 0.0  # + 0.0: no -0.000
    return f"x {x:.3f}, y {y:.3f}, z {z:.3f} m"


def _axis_in_words(direction: NDArray[np.float64]) -> str:
    axis = int(np.argmax(np.abs(direction)))
    sign = "+" if direction[axis] > 0 else "-"
    off_deg = math.degrees(math.acos(min(1.0, abs(float(direction[axis])))))
    return f"{sign}{'xyz'[axis]} ({off_deg:.1f} deg off)"
