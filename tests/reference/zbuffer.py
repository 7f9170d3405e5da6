"""The slow, obvious twin of ``render_depth``: shares no code with it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

BOUNDARY_PX = 1e-9
"""Nearer to a rounding boundary than this, two orders of summing may choose another pixel."""


@dataclass(frozen=True)
class Pinhole:
    """Size and intrinsics in pixels."""

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float


def project(
    points_local: NDArray[np.float32], T_camera_local: NDArray[np.float64], camera: Pinhole
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return u, v in pixels and depth in metres, (N,) float64 each, of (N, 3) points.

    The depth is summed x, y, z, translation, as the fast one does: so depths are equal bit by bit.
    """
    x, y, z = points_local.astype(np.float64).T
    in_camera = [row[0] * x + row[1] * y + row[2] * z + row[3] for row in T_camera_local[:3]]
    with np.errstate(divide="ignore", invalid="ignore"):
        u = camera.fx * in_camera[0] / in_camera[2] + camera.cx
        v = camera.fy * in_camera[1] / in_camera[2] + camera.cy
    return u, v, in_camera[2]


def zbuffer(
    points_local: NDArray[np.float32],
    T_camera_local: NDArray[np.float64],
    camera: Pinhole,
    *,
    min_m: float,
    max_m: float,
    step_m: float,
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Draw one point after another.

    Returns:
        depth (H, W) float32 metres, 0 = nothing; and (H, W) bool: pixels that a point within
        ``BOUNDARY_PX`` of a rounding boundary touches, on either side of it.
    """
    depth_m = np.zeros((camera.height, camera.width), dtype=np.float32)
    doubtful = np.zeros((camera.height, camera.width), dtype=np.bool_)
    u_px, v_px, z_m = project(points_local, T_camera_local, camera)
    for u, v, z in zip(u_px.tolist(), v_px.tolist(), z_m.tolist(), strict=True):
        if not min_m <= z <= max_m:
            continue
        stored = np.float32(math.floor(z / step_m + 0.5) * step_m) if step_m else np.float32(z)
        columns = {math.floor(u + 0.5 + nudge) for nudge in (-BOUNDARY_PX, BOUNDARY_PX)}
        rows = {math.floor(v + 0.5 + nudge) for nudge in (-BOUNDARY_PX, BOUNDARY_PX)}
        inside = [
            (row, column)
            for row in rows
            for column in columns
            if 0 <= column < camera.width and 0 <= row < camera.height
        ]
        if len(columns) * len(rows) > 1:
            for pixel in inside:
                doubtful[pixel] = True
        elif inside and (depth_m[inside[0]] == 0 or stored < depth_m[inside[0]]):
            depth_m[inside[0]] = stored
    return depth_m, doubtful


def zbuffer_by_minimum_at(
    points_local: NDArray[np.float32],
    T_camera_local: NDArray[np.float64],
    camera: Pinhole,
    *,
    min_m: float,
    max_m: float,
    step_m: float,
) -> NDArray[np.float32]:
    """The same in numpy's words, as most people write it: depth (H, W) float32 metres."""
    u, v, depth = project(points_local, T_camera_local, camera)
    in_depth = (depth >= min_m) & (depth <= max_m)
    columns, rows, depth = np.floor(u[in_depth] + 0.5), np.floor(v[in_depth] + 0.5), depth[in_depth]
    inside = (columns >= 0) & (columns < camera.width) & (rows >= 0) & (rows < camera.height)
    pixels = (rows[inside] * camera.width + columns[inside]).astype(np.int64)
    nearest = np.full(camera.width * camera.height, np.inf, dtype=np.float32)
    stored = np.floor(depth[inside] / step_m + 0.5) * step_m if step_m else depth[inside]
    np.minimum.at(nearest, pixels, stored.astype(np.float32))
    nearest[np.isinf(nearest)] = 0.0
    return nearest.reshape(camera.height, camera.width)
