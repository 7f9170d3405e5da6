"""Kernels: poses between poses, and points moved by the pose at their own time.

Sine and arcsine are spelt out, since libraries pick theirs by processor and differ in the last
bit; with additions, products, quotients and square roots alone, which IEEE 754 rounds exactly,
every machine computes the same bits. For the same reason there is no fastmath.
"""

from __future__ import annotations

import math
from typing import Final

import numba
import numpy as np

_SMALL_ANGLE_RAD: Final = 1e-8  # below this sin x = x in float64: slerp becomes linear
_SINE_TERMS: Final = tuple((-1.0) ** n / math.factorial(2 * n + 1) for n in range(11))


@numba.njit(cache=True)
def _sin(x):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202  # a kernel: numba infers
    """Sine by its Taylor series to x^21, for 0 <= x <= pi/2: error below 3e-16."""
    square = x * x
    series = _SINE_TERMS[10]
    for n in range(9, -1, -1):
        series = series * square + _SINE_TERMS[n]
    return x * series


@numba.njit(cache=True)
def _arcsin(y):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202  # a kernel: numba infers
    """Arcsine by Newton's method on :func:`_sin`, for 0 <= y <= sqrt(1/2)."""
    x = y * (1.0 + y * y / 6.0)
    for _ in range(4):
        sine = _sin(x)
        x += (y - sine) / math.sqrt(1.0 - sine * sine)
    return x


@numba.njit(cache=True)
def _arc(a, b):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202  # a kernel: numba infers
    """The shorter way from quaternion a to b: which sign of b, and the angle, 0 to pi/2."""
    dot = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]
    sign = -1.0 if dot < 0.0 else 1.0
    chord = 0.0
    for k in range(4):
        step = sign * b[k] - a[k]
        chord += step * step
    return sign, 2.0 * _arcsin(0.5 * math.sqrt(chord))


@numba.njit(cache=True)
def _weights(share, angle):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202  # a kernel: numba infers
    """How much of each end: slerp (Shoemake 1985)."""
    if angle < _SMALL_ANGLE_RAD:
        return 1.0 - share, share
    whole = _sin(angle)
    return _sin((1.0 - share) * angle) / whole, _sin(share * angle) / whole


@numba.njit(cache=True)
def _segment_of(stamp, stamps, guess):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202  # a kernel: numba infers
    """The last pose at or before an instant; most often that of the instant before."""
    last = len(stamps) - 1
    if stamps[guess] <= stamp and (guess == last or stamp < stamps[guess + 1]):
        return guess
    return max(0, np.searchsorted(stamps, stamp, side="right") - 1)


@numba.njit(cache=True)
def poses_between(instants, stamps, translations, quaternions, out_translations, out_quaternions):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN201, PLR0917  # a kernel: numba infers
    """Interpolate: translation linearly, rotation by slerp.

    Args:
        instants: (M,) int64 ns, inside the trajectory.
        stamps: (P,) int64 ns, ascending.
        translations: (P, 3) float64.
        quaternions: (P, 4) float64, unit.
        out_translations: (M, 3) float64, written.
        out_quaternions: (M, 4) float64, unit, written.
    """
    last = len(stamps) - 1
    segment, known = 0, -1
    sign, angle = 1.0, 0.0
    for i in range(len(instants)):
        segment = _segment_of(instants[i], stamps, segment)
        after = min(segment + 1, last)
        if segment != known:
            sign, angle = _arc(quaternions[segment], quaternions[after])
            known = segment
        duration = max(stamps[after] - stamps[segment], 1)
        share = np.float64(instants[i] - stamps[segment]) / np.float64(duration)
        for k in range(3):
            start = translations[segment, k]
            out_translations[i, k] = start + share * (translations[after, k] - start)
        weight, other = _weights(share, angle)
        square = 0.0
        for k in range(4):
            q = weight * quaternions[segment, k] + other * sign * quaternions[after, k]
            out_quaternions[i, k] = q
            square += q * q
        norm = math.sqrt(square)
        for k in range(4):
            out_quaternions[i, k] /= norm


@numba.njit(cache=True)
def move_points(points, T_body_points, translations, quaternions, origin, out):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN201, PLR0917  # a kernel: numba infers
    """Put each point into the map by its own pose.

    Args:
        points: (N, 3) float32 or float64, metres, sensor frame.
        T_body_points: (4, 4) float64, sensor frame to body.
        translations: (N, 3) or (1, 3) float64 metres, map frame: of the body.
        quaternions: (N, 4) or (1, 4) float64, unit, xyzw: body to map.
        origin: (3,) float64 metres, map frame: subtracted before the cast to float32.
        out: (3, N) float32, written: metres relative to ``origin``, one row an axis.
    """
    T = T_body_points
    for i in range(len(points)):
        x, y, z = np.float64(points[i, 0]), np.float64(points[i, 1]), np.float64(points[i, 2])
        bx = T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3]
        by = T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3]
        bz = T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3]
        p = i if len(quaternions) > 1 else 0
        qx, qy, qz, qw = quaternions[p, 0], quaternions[p, 1], quaternions[p, 2], quaternions[p, 3]
        # v + 2 w (q x v) + 2 q x (q x v)
        tx = 2.0 * (qy * bz - qz * by)
        ty = 2.0 * (qz * bx - qx * bz)
        tz = 2.0 * (qx * by - qy * bx)
        out[0, i] = bx + qw * tx + (qy * tz - qz * ty) + (translations[p, 0] - origin[0])
        out[1, i] = by + qw * ty + (qz * tx - qx * tz) + (translations[p, 1] - origin[1])
        out[2, i] = bz + qw * tz + (qx * ty - qy * tx) + (translations[p, 2] - origin[2])
