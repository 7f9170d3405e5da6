"""Which rays of a picture come near a ball: only these are asked of what moves inside it."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

Plane = NDArray[np.float32]


def towards_ball(
    directions: Plane, middle_m: NDArray[np.float64], radius_m: float
) -> NDArray[np.int64]:
    """Return which rays from one place come near a ball.

    Args:
        directions: (N, 3), any length.
        middle_m: (3,) of the ball, seen from the place.
        radius_m: of the ball.
    """
    middle = middle_m.astype(np.float32)
    rows = np.empty(len(directions), dtype=np.int64)
    return rows[: _towards(directions, middle, np.float32(radius_m), rows)]


def projected(points_m: Plane, axes: Plane) -> tuple[Plane, Plane]:
    """Return (N, 3) points along two axes (2, 3): (N, 2), and where these begin and end: (2, 2)."""
    places = np.empty((len(points_m), 2), dtype=np.float32)
    ends = np.empty((2, 2), dtype=np.float32)
    _project(points_m, axes, places, ends)
    return places, ends


def in_disc(places_m: Plane, ends_m: Plane, disc_m: Plane, radius_m: float) -> NDArray[np.int64]:
    """Return which of :func:`projected` points lie in a disc about (2,)."""
    radius = np.float32(radius_m)
    if (disc_m + radius < ends_m[0]).any() or (disc_m - radius > ends_m[1]).any():
        return np.empty(0, dtype=np.int64)
    rows = np.empty(len(places_m), dtype=np.int64)
    return rows[: _inside(places_m, disc_m, radius, rows)]


@numba.njit(cache=True, nogil=True)
def _towards(directions, middle, radius, rows):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202  # a kernel: numba infers
    a, b, c = middle[0], middle[1], middle[2]
    beyond = a * a + b * b + c * c - radius * radius
    count = 0
    for i in range(len(directions)):
        x, y, z = directions[i, 0], directions[i, 1], directions[i, 2]
        along = x * a + y * b + z * c
        if along > 0 and along * along >= (x * x + y * y + z * z) * beyond:
            rows[count] = i
            count += 1
    return count


@numba.njit(cache=True, nogil=True)
def _project(points, axes, places, ends):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202  # a kernel: numba infers
    for k in range(2):
        a, b, c = axes[k, 0], axes[k, 1], axes[k, 2]
        low, high = np.float32(np.inf), np.float32(-np.inf)
        for i in range(len(points)):
            place = points[i, 0] * a + points[i, 1] * b + points[i, 2] * c
            places[i, k] = place
            low, high = min(low, place), max(high, place)
        ends[0, k], ends[1, k] = low, high


@numba.njit(cache=True, nogil=True)
def _inside(places, disc, radius, rows):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202  # a kernel: numba infers
    count = 0
    for i in range(len(places)):
        u, v = places[i, 0] - disc[0], places[i, 1] - disc[1]
        if u * u + v * v <= radius * radius:
            rows[count] = i
            count += 1
    return count
