"""Which pixels hide behind a front, one neighbourhood at a time."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray


def hidden(
    depth_m: NDArray[np.float32],
    surface_m: NDArray[np.float32],
    *,
    closing_px: int,
    rim_px: int,
    margin_m: float,
    margin_share: float,
) -> NDArray[np.bool_]:
    """Return (H, W) bool: the pixels with depth that lie behind the closed front.

    Args:
        depth_m: (H, W), 0 = nothing measured.
        surface_m: (H, W), the least depth that any point has there, inf = none.
        closing_px: side of the neighbourhood of the minimum.
        rim_px: how much further, on each side, that of the maximum reaches.
        margin_m: of depth.
        margin_share: of the front's depth.
    """
    half = closing_px // 2
    front = neighbourhoods(neighbourhoods(surface_m, half, min), half + rim_px, max)
    out = np.zeros(depth_m.shape, dtype=np.bool_)
    for row, column in np.ndindex(depth_m.shape):
        nearest = float(front[row, column])
        if math.isfinite(nearest):
            limit = nearest * (1.0 + margin_share) + margin_m
            out[row, column] = float(depth_m[row, column]) > limit
    return out


def neighbourhoods(
    values: NDArray[np.float32], half: int, of: Callable[[list[float]], float]
) -> NDArray[np.float32]:
    """Apply a function to the square around each pixel, as far as it lies in the image."""
    out = np.empty_like(values)
    for row, column in np.ndindex(values.shape):
        rows = slice(max(row - half, 0), row + half + 1)
        columns = slice(max(column - half, 0), column + half + 1)
        out[row, column] = of(values[rows, columns].ravel().tolist())
    return out
