"""The nearest of many points in each cell of an image: a small depth picture, quickly."""

from __future__ import annotations

import math
from typing import Final

import numba
import numpy as np
from numpy.typing import NDArray

from civil_rgbd.geometry.camera import PinholeCamera

_NEAREST_M: Final = 0.5


def nearest_a_cell(
    points_map: NDArray[np.float64],
    T_camera_map: NDArray[np.float64],
    camera: PinholeCamera,
    cell_px: int,
) -> NDArray[np.float64]:
    """Project points, and keep the nearest one of each cell.

    Args:
        points_map: (N, 3) metres.
        T_camera_map: (4, 4) map to camera.
        camera: its pinhole.
        cell_px: side of a square cell.

    Returns:
        (3, H, W) float64: column and row in pixels, and depth in metres, of the nearest point of
        each cell; depth 0 in cells without.
    """
    shape = (camera.height_px // cell_px + 1, camera.width_px // cell_px + 1)
    table = np.zeros((3, *shape))
    size = np.array([camera.width_px, camera.height_px])
    K = np.array([camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px])
    _fill(points_map, np.ascontiguousarray(T_camera_map), K, size, cell_px, table)
    return table


@numba.njit(cache=True, nogil=True)
def _fill(points, T, K, size, cell_px, table):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202, PLR0917  # a kernel: numba infers
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        depth = T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3]
        if depth <= _NEAREST_M:
            continue
        u = K[0] * (T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3]) / depth + K[2]
        v = K[1] * (T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3]) / depth + K[3]
        if u < 0 or v < 0 or u >= size[0] or v >= size[1]:
            continue
        row, column = math.floor(v / cell_px), math.floor(u / cell_px)
        if table[2, row, column] == 0 or depth < table[2, row, column]:
            table[0, row, column] = u
            table[1, row, column] = v
            table[2, row, column] = depth
