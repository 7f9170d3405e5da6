"""Points into a depth image: pinhole projection, nearest pixel, smallest depth wins."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from civil_rgbd.constants import NO_DEPTH_M
from civil_rgbd.domain.recipe import DepthStage
from civil_rgbd.geometry.camera import PinholeCamera

_BLOCK = 512  # points projected at a time: their pixels and depths stay in the first-level cache
_STRANDS = 8  # of a block, drawn in turns


@dataclass(frozen=True, slots=True, eq=False)
class RenderedDepth:
    """A depth image and how it came about.

    Attributes:
        depth_m: (H, W) float32, metres along the optical axis, 0 = nothing measured.
        points_in_view: points that fell into the image and the depth range.
    """

    depth_m: NDArray[np.float32]
    points_in_view: int


def render_depth(
    segments: Iterable[NDArray[np.float32]],
    *,
    T_camera_local: NDArray[np.float64],
    camera: PinholeCamera,
    stage: DepthStage,
) -> RenderedDepth:
    """Project points through a pinhole; pixels are floor(u + 0.5), the smallest depth wins.

    Args:
        segments: (3, n) float32 each, metres, local frame, one row an axis.
        T_camera_local: (4, 4) local frame to camera optical frame.
        camera: the pinhole.
        stage: depth range (inclusive, before rounding) and rounding step.

    Returns:
        the depth image.
    """
    # One pixel more than the image has: points that miss it go there.
    nearest = np.full(camera.width_px * camera.height_px + 1, np.inf, dtype=np.float32)
    in_view = draw_nearest(
        segments, T_camera_local=T_camera_local, camera=camera, stage=stage, nearest=nearest
    )
    depth_m = nearest[:-1]
    _to_metres(depth_m, stage.step_m or 1.0, NO_DEPTH_M)
    return RenderedDepth(depth_m.reshape(camera.height_px, camera.width_px), in_view)


def draw_nearest(
    segments: Iterable[NDArray[np.float32]],
    *,
    T_camera_local: NDArray[np.float64],
    camera: PinholeCamera,
    stage: DepthStage,
    nearest: NDArray[np.float32],
) -> int:
    """Project points through a pinhole, and lower the depth of the pixels they fall into.

    Args:
        segments: (3, n) float32 each, metres, local frame, one row an axis.
        T_camera_local: (4, 4) local frame to camera optical frame.
        camera: the pinhole.
        stage: depth range (inclusive, before rounding) and rounding step.
        nearest: (H W + 1,) float32, in rounding steps, or in metres where there is no rounding; inf
            = nothing yet. Changed in place; the last takes the points that miss the image.

    Returns:
        how many points fell into the image and the depth range.
    """
    rows, in_view = projection_rows(T_camera_local, camera), 0
    for points_local in segments:
        in_view += _scatter_nearest(
            *points_local,
            rows,
            (camera.width_px, camera.height_px),
            (stage.min_m, stage.max_m),
            1.0 / stage.step_m if stage.step_m else 0.0,
            nearest,
        )
    return in_view


def projection_rows(
    T_camera_local: NDArray[np.float64], camera: PinholeCamera
) -> NDArray[np.float64]:
    """Fold a pinhole's intrinsics into a transform: (3, 4) rows that give u Z, v Z and Z."""
    R, t = T_camera_local[:3, :3], T_camera_local[:3, 3]
    rows = np.empty((3, 4))
    for row, (f, c) in enumerate(((camera.fx_px, camera.cx_px), (camera.fy_px, camera.cy_px))):
        rows[row, :3], rows[row, 3] = f * R[row] + c * R[2], f * t[row] + c * t[2]
    rows[2, :3], rows[2, 3] = R[2], t[2]
    return rows


# No fastmath and no parallel sums: every processor must compute the same bits. Arithmetic is
# float64 on float32 points: it costs a quarter more than float32, and rounds pixels and depths as
# exactly as the stored points allow. The numpy error model keeps the division free of branches, so
# that the first loop is vectorised; points that miss the image write to one spare pixel at the end,
# so that the last has no branch to mispredict.
@numba.njit(cache=True, nogil=True, error_model="numpy")
def _scatter_nearest(xs, ys, zs, rows, size, limits, steps_per_m, nearest):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202, PLR0917  # a kernel
    u_end, v_end = np.float64(size[0]), np.float64(size[1])
    min_m, max_m = limits
    a0, a1, a2, a3 = rows[0, 0], rows[0, 1], rows[0, 2], rows[0, 3]
    b0, b1, b2, b3 = rows[1, 0], rows[1, 1], rows[1, 2], rows[1, 3]
    c0, c1, c2, c3 = rows[2, 0], rows[2, 1], rows[2, 2], rows[2, 3]
    missed = np.int32(size[0] * size[1])
    rounded = steps_per_m > 0.0
    pixels = np.empty(_BLOCK, dtype=np.int32)
    depths = np.empty(_BLOCK, dtype=np.float32)
    in_view = np.int32(0)
    for first in range(0, len(xs), _BLOCK):
        count = min(_BLOCK, len(xs) - first)
        bx, by, bz = xs[first : first + count], ys[first : first + count], zs[first : first + count]
        for i in range(count):
            x, y, z = np.float64(bx[i]), np.float64(by[i]), np.float64(bz[i])
            depth = c0 * x + c1 * y + c2 * z + c3
            per_depth = 1.0 / depth
            u = np.floor((a0 * x + a1 * y + a2 * z + a3) * per_depth + 0.5)
            v = np.floor((b0 * x + b1 * y + b2 * z + b3) * per_depth + 0.5)
            in_depth = (depth >= min_m) & (depth <= max_m)
            seen = in_depth & (u >= 0.0) & (u < u_end) & (v >= 0.0) & (v < v_end)
            pixels[i] = np.int32(v * u_end + u if seen else np.float64(missed))
            # Rounded here, in float64; rounding keeps order: the nearest stays the nearest.
            steps = np.floor(depth * steps_per_m + 0.5)
            depths[i] = np.float32(steps if rounded else depth)
        pixels[count:] = missed
        for i in range(count):
            in_view += np.int32(pixels[i] != missed)
        # Neighbours of a scan fall into the same pixel: drawn one after the other, each would wait
        # for the one before it. Points half a line apart do not.
        for i in range(_BLOCK // _STRANDS):
            for strand in range(_STRANDS):
                point = i + strand * (_BLOCK // _STRANDS)
                pixel = np.uint32(pixels[point])
                nearest[pixel] = min(depths[point], nearest[pixel])
    return in_view


@numba.njit(cache=True, nogil=True)
def _to_metres(nearest, step_m, no_depth_m):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202  # a kernel: numba infers
    for i in range(len(nearest)):
        steps = nearest[i]
        nearest[i] = np.float32(steps * step_m) if steps < np.inf else np.float32(no_depth_m)
