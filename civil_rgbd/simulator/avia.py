"""Where a Livox Avia points: two turning prisms, as fitted to the vendor's own pattern.

The vendor gives 4 s of the pattern: 960,000 directions (``scan_mode/avia.npy`` in the package
``mujoco-lidar``, MIT). Six beams, fanned out in elevation, enter the first prism by its oblique
face and leave the second by its own; both prisms are wedges of 18 degrees. This law meets the
vendor's directions within 1e-5 rad everywhere, with the vendor's speeds. Those come back to
the start after 20/3 s, which no motor does: here one of them is a little faster.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.constants import NS_PER_S
from civil_rgbd.simulator.waves import cosine, sine

LINES: Final = 6

VENDOR_HZ: Final = (131.55, -40.8)
"""Turns a second of the first and the second prism in the vendor's pattern."""
# The golden section is as far from every fraction as can be. After 4 s the pattern lies within
# 0.4 deg of the vendor's.
_HZ: Final = (VENDOR_HZ[0], VENDOR_HZ[1] * (1 + 1.6180339887e-5))
_WEDGE_TURNS: Final = 18.0 / 360
_INDEX: Final = 1.8144
_LINE_STEP_TURNS: Final = 0.0156602 / (2 * math.pi)


def avia_directions(
    since_start_ns: NDArray[np.int64], *, turns_hz: tuple[float, float] = _HZ
) -> NDArray[np.float64]:
    """Return where the six beams point at some instants.

    Args:
        since_start_ns: (G,) int64, time since the prisms began to turn.
        turns_hz: turns a second of the two prisms.

    Returns:
        (6 G, 3) float64 unit vectors, LiDAR frame: for each instant lines 0 to 5 in turn.
    """
    t = since_start_ns.astype(np.float64) / NS_PER_S
    first, second = _oblique(turns_hz[0] * t, 0.5), _oblique(turns_hz[1] * t, 0.0)
    fan = ((LINES - 1) / 2 - np.arange(LINES, dtype=np.float64)) * _LINE_STEP_TURNS
    rays = (cosine(fan), np.zeros(LINES), sine(fan))
    # Between the oblique faces lie two that face ahead: what the one does, the other undoes.
    rays = _refracted(rays, first, 1 / _INDEX)
    rays = _refracted(rays, second, _INDEX)
    return np.stack([axis.ravel() for axis in rays], axis=1)


_Vectors = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]


def _oblique(turns: NDArray[np.float64], start_turns: float) -> _Vectors:
    """Return the normals of a turning oblique face, one row an instant."""
    turns = (turns + start_turns)[:, np.newaxis]
    tilt = float(sine(np.array(_WEDGE_TURNS)))
    ahead = np.full_like(turns, float(cosine(np.array(_WEDGE_TURNS))))
    return ahead, tilt * cosine(turns), tilt * sine(turns)


def _refracted(rays: _Vectors, normals: _Vectors, ratio: float) -> _Vectors:
    """Bend unit rays by Snell's law; ``ratio`` is the index before the face by that after it."""
    (x, y, z), (nx, ny, nz) = rays, normals
    facing = x * nx + y * ny + z * nz
    bend = np.sqrt(1 - ratio * ratio * (1 - facing * facing)) - ratio * facing
    return ratio * x + bend * nx, ratio * y + bend * ny, ratio * z + bend * nz
