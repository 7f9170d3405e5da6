"""The way that an inspector walks through a scene, as data, and where he is along it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

_SPACING_M: Final = 1.5
_FEWEST_CORNERS: Final = 3


@dataclass(frozen=True)
class WalkPath:
    """A closed way past and under a bridge; a bridge's scene brings its own.

    The way is a smooth curve that cuts the corners: where the straight lines between them keep off
    the walls, so does the walk. It is walked round and round, so where it turns back it does so
    over two corners that lie 1.5 m or more apart.

    Attributes:
        corners_m: (x, y, z) of the ground under the feet, scene frame, in the order of walking.
        look_left_deg: where the sensors point, to the left of the way, in the mean.
        look_up_deg: and above the level.
        sweep_left_deg: how far the walker looks around to either side of that.
        sweep_up_deg: and up and down.
        chest_m: the IMU's height above the ground.
    """

    corners_m: tuple[tuple[float, float, float], ...]
    look_left_deg: float = 12.0
    look_up_deg: float = 8.0
    sweep_left_deg: float = 25.0
    sweep_up_deg: float = 9.0
    chest_m: float = 1.35

    def __post_init__(self) -> None:
        if len(self.corners_m) < _FEWEST_CORNERS:
            raise ValueError(f"a way of {len(self.corners_m)} corners leads nowhere")

    @cached_property
    def _knots_m(self) -> NDArray[np.float64]:
        corners = np.asarray(self.corners_m, dtype=np.float64)
        sides = np.diff(corners, axis=0, append=corners[:1])
        lengths = np.sqrt(sides[:, 0] ** 2 + sides[:, 1] ** 2 + sides[:, 2] ** 2)
        ends = np.cumsum(lengths)
        count = max(int(ends[-1] / _SPACING_M + 0.5), 4)
        places = np.arange(count) * (ends[-1] / count)
        side = np.searchsorted(ends, places, side="right")
        share = (places - (ends - lengths)[side]) / lengths[side]
        knots: NDArray[np.float64] = corners[side] + share[:, np.newaxis] * sides[side]
        return knots

    @cached_property
    def length_m(self) -> float:
        """Once around, along the straight lines between the corners."""
        corners = np.asarray(self.corners_m, dtype=np.float64)
        sides = np.diff(corners, axis=0, append=corners[:1])
        return float(np.sqrt(sides[:, 0] ** 2 + sides[:, 1] ** 2 + sides[:, 2] ** 2).sum())

    def ground(self, way_m: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return where the feet are after so much of the way, and where they head.

        Args:
            way_m: (N,) metres from the first corner; any number of rounds.

        Returns:
            places (N, 3) metres; derivatives (N, 3) by the way, shorter than 1 in bends.
        """
        knots = self._knots_m
        spacing = self.length_m / len(knots)
        place = way_m / spacing
        before = np.floor(place)
        u = (place - before)[:, np.newaxis]
        index = before.astype(np.int64)
        a, b, c, d = (knots[(index + k) % len(knots)] for k in (-1, 0, 1, 2))
        # A uniform cubic B-spline: position, speed and acceleration go on without a jump. Products
        # rather than powers, which differ in the last bit from one processor to another.
        v, u2 = 1 - u, u * u
        at = (
            v * v * v * a
            + (4 - 6 * u2 + 3 * u2 * u) * b
            + (1 + 3 * u + 3 * u2 - 3 * u2 * u) * c
            + u2 * u * d
        ) / 6
        slope = (-v * v * a + (3 * u2 - 4 * u) * b + (1 + 2 * u - 3 * u2) * c + u2 * d) / 2
        return at, slope / spacing
