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


def without_gone(
    surface_m: NDArray[np.float32],
    depth_m: NDArray[np.float32],
    *,
    gone_px: int,
    margin_m: float,
    margin_share: float,
) -> NDArray[np.float32]:
    """Return the surface (H, W) without the older points that the frame's own have seen behind.

    Args:
        surface_m: (H, W), the least depth that any point has there, inf = none.
        depth_m: (H, W), of the frame's own points, 0 = none.
        gone_px: side of the neighbourhood, 0 = leave the surface as it is.
        margin_m: of depth.
        margin_share: of the surface's depth.
    """
    out = surface_m.copy()
    half = gone_px // 2
    for row, column in np.ndindex(depth_m.shape) if gone_px else ():
        rows = slice(max(row - half, 0), row + half + 1)
        columns = slice(max(column - half, 0), column + half + 1)
        limit = float(surface_m[row, column]) * (1.0 + margin_share) + margin_m
        own = [depth for depth in depth_m[rows, columns].ravel().tolist() if depth > 0]
        if own and all(depth > limit for depth in own):
            own_here = float(depth_m[row, column])
            out[row, column] = own_here if own_here > 0 else math.inf
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
