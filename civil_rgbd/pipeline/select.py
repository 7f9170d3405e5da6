"""Which images become frames: the camera must have moved."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray


def far_enough(
    positions_map: NDArray[np.float64], *, min_displacement_m: float
) -> NDArray[np.intp]:
    """Keep the first position, then each one far enough from the previously kept one.

    Args:
        positions_map: (M, 3) camera positions in metres, map frame, in time order.
        min_displacement_m: a position is kept when it lies strictly further than this from the
            one kept before it; 0 keeps every position.

    Returns:
        (K,) indices of the kept positions, ascending.

    >>> far_enough(np.array([[0.0, 0, 0], [0.1, 0, 0], [0.25, 0, 0]]), min_displacement_m=0.1)
    array([0, 2])
    """
    if min_displacement_m == 0:
        return np.arange(len(positions_map))
    kept: list[int] = []
    last: list[float] | None = None
    for index, here in enumerate(positions_map.tolist()):
        if last is None or _distance_m(here, last) > min_displacement_m:
            last = here
            kept.append(index)
    return np.array(kept, dtype=np.intp)


def _distance_m(a: list[float], b: list[float]) -> float:
    # Not math.dist: its last bit is another in some versions of Python.
    x, y, z = a[0] - b[0], a[1] - b[1], a[2] - b[2]
    return math.sqrt(x * x + y * y + z * z)
