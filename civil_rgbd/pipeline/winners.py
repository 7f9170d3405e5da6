"""Which return won each pixel, how many fell into it, and which pixels only saw out of range."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numba
import numpy as np
from numpy.typing import NDArray

from civil_rgbd.domain.recipe import DepthStage
from civil_rgbd.geometry.camera import PinholeCamera
from civil_rgbd.pipeline.accumulate import PointWindow
from civil_rgbd.pipeline.render import projection_rows

NO_WINNER: Final = -1


@dataclass(frozen=True, slots=True, eq=False)
class Winners:
    """The returns behind a rendered depth, before anything is removed from it.

    Attributes:
        point: (H, W) int32, the winning return's place among the window's points, segment after
            segment; :data:`NO_WINNER` without one.
        returns: (H, W) int32, how many fell into the pixel and the depth range.
        out_of_range: (H, W) bool, where some fell into the pixel, but out of the depth range.
        pixels: (P,) int32, the pixel (row-major) that each point fell into; -1 for none.
        depths_m: (P,) float64, its depth, not rounded.
    """

    point: NDArray[np.int32]
    returns: NDArray[np.int32]
    out_of_range: NDArray[np.bool_]
    pixels: NDArray[np.int32]
    depths_m: NDArray[np.float64]


def find_winners(
    window: PointWindow,
    *,
    T_camera_local: NDArray[np.float64],
    camera: PinholeCamera,
    limits: DepthStage,
) -> Winners:
    """Project the points of a window once more, and keep who won.

    Args:
        window: as it was rendered.
        T_camera_local: (4, 4) local frame to camera optical frame.
        camera: the pinhole.
        limits: the depth range.

    Returns:
        the winners: of points in one pixel the nearest, of equally near ones the first.
    """
    size = (camera.height_px, camera.width_px)
    pixels = np.empty(window.count, dtype=np.int32)
    depths_m = np.empty(window.count)
    out_of_range = np.zeros(size, dtype=np.bool_)
    rows, first = projection_rows(T_camera_local, camera), 0
    for points_local in window.segments:
        last = first + points_local.shape[1]
        _project(
            *points_local,
            rows,
            (camera.width_px, camera.height_px),
            (limits.min_m, limits.max_m),
            (pixels[first:last], depths_m[first:last], out_of_range.reshape(-1)),
        )
        first = last
    point = np.full(size, NO_WINNER, dtype=np.int32)
    returns = np.zeros(size, dtype=np.int32)
    _win(pixels, depths_m, point.reshape(-1), returns.reshape(-1))
    return Winners(point, returns, out_of_range, pixels, depths_m)


def returns_within(winners: Winners, reach_m: NDArray[np.float64]) -> NDArray[np.int32]:
    """Count the returns of each pixel that lie behind its winner by no more than a reach.

    Args:
        winners: of a frame.
        reach_m: (H, W) float64.

    Returns:
        (H, W) int32: at least 1 where there is a winner.
    """
    count = np.zeros(winners.point.shape, dtype=np.int32)
    _count_within(
        winners.pixels,
        winners.depths_m,
        winners.point.reshape(-1),
        np.ascontiguousarray(reach_m).reshape(-1),
        count.reshape(-1),
    )
    return count


# The same sums in the same order as the renderer's: the same bits, so the same pixel.
@numba.njit(cache=True, nogil=True, error_model="numpy")
def _project(xs, ys, zs, rows, size, limits, out):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202, PLR0917  # a kernel
    pixels, depths_m, out_of_range = out
    u_end, v_end = np.float64(size[0]), np.float64(size[1])
    for i in range(len(xs)):
        x, y, z = np.float64(xs[i]), np.float64(ys[i]), np.float64(zs[i])
        depth = rows[2, 0] * x + rows[2, 1] * y + rows[2, 2] * z + rows[2, 3]
        per_depth = 1.0 / depth
        across = rows[0, 0] * x + rows[0, 1] * y + rows[0, 2] * z + rows[0, 3]
        down = rows[1, 0] * x + rows[1, 1] * y + rows[1, 2] * z + rows[1, 3]
        u, v = np.floor(across * per_depth + 0.5), np.floor(down * per_depth + 0.5)
        depths_m[i] = depth
        pixels[i] = -1
        if depth > 0.0 and 0.0 <= u < u_end and 0.0 <= v < v_end:
            pixel = np.int32(v * u_end + u)
            if limits[0] <= depth <= limits[1]:
                pixels[i] = pixel
            else:
                out_of_range[pixel] = True


@numba.njit(cache=True, nogil=True)
def _win(pixels, depths_m, point, returns):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202  # a kernel: numba infers
    for i in range(len(pixels)):
        pixel = pixels[i]
        if pixel >= 0:
            returns[pixel] += 1
            best = point[pixel]
            if best < 0 or depths_m[i] < depths_m[best]:
                point[pixel] = i


@numba.njit(cache=True, nogil=True)
def _count_within(pixels, depths_m, point, reach_m, count):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202  # a kernel: numba infers
    for i in range(len(pixels)):
        pixel = pixels[i]
        if pixel >= 0 and depths_m[i] <= depths_m[point[pixel]] + reach_m[pixel]:
            count[pixel] += 1
