"""Sines and turns that every processor computes with the same bits."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

_TERMS: Final = 11  # Taylor terms: below 3e-16 up to a quarter turn


def sine(turns: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the sine of angles given in whole turns.

    Spelt out, as libraries pick their sine by processor and differ in the last bit.

    Args:
        turns: (...,) angles, 1.0 = 360 degrees.

    Returns:
        (...,) float64.

    >>> sine(np.array([0.0, 0.25, 0.5, 0.75])).round(12).tolist()
    [0.0, 1.0, 0.0, -1.0]
    """
    folded = turns - np.rint(turns)
    folded = np.where(folded > 0.25, 0.5 - folded, folded)
    folded = np.where(folded < -0.25, -0.5 - folded, folded)
    x = folded * (2 * math.pi)
    square = x * x
    series = np.ones_like(x)
    for n in range(2 * (_TERMS - 1), 0, -2):
        series = 1 - series * square / (n * (n + 1))
    return x * series


def cosine(turns: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the cosine of angles (...,) given in whole turns, float64.

    >>> cosine(np.array([0.0, 0.5])).round(12).tolist()
    [1.0, -1.0]
    """
    return sine(turns + 0.25)


def turn_about(axis: int, angles_rad: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the quaternions (N, 4), xyzw, of (N,) turns about axis 0, 1 or 2 (x, y or z)."""
    half_turns = angles_rad / (4 * math.pi)
    q = np.zeros((len(angles_rad), 4))
    q[:, axis], q[:, 3] = sine(half_turns), cosine(half_turns)
    return q


def turn_towards(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the quaternions (N, 4), xyzw, about z that take the x axis to (N,) headings (x, y)."""
    length = np.sqrt(x * x + y * y)
    cos, sin = x / length, y / length
    # Half-angle formulas, each used on the side where it does not cancel.
    ahead = cos >= 0
    larger = np.sqrt((1 + np.abs(cos)) / 2)
    smaller = sin / (2 * larger)
    q = np.zeros((len(x), 4))
    q[:, 2], q[:, 3] = np.where(ahead, smaller, larger), np.where(ahead, larger, smaller)
    return q


def chain_turns(*quaternions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Multiply quaternions (N, 4), xyzw, from left to right: the last turns first."""
    product = quaternions[0]
    for q in quaternions[1:]:
        ax, ay, az, aw = (product[..., i] for i in range(4))
        bx, by, bz, bw = (q[..., i] for i in range(4))
        product = np.stack(
            [
                aw * bx + ax * bw + ay * bz - az * by,
                aw * by - ax * bz + ay * bw + az * bx,
                aw * bz + ax * by - ay * bx + az * bw,
                aw * bw - ax * bx - ay * by - az * bz,
            ],
            axis=-1,
        )
    return product
