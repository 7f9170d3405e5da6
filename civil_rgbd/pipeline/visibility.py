"""Pixels that show what the camera cannot see: far returns between those of a near surface.

The LiDAR measured from other places than the camera's, and its returns are sparse: where a far one
falls into a gap between those of a pier, it wins the pixel, and the pier has a hole in it. More
points than the frame's show the pier's front more densely; a morphological closing of their depth
(the least of each neighbourhood, then the largest of those) fills what holes remain. The second
neighbourhood is wider than the first, so that a front must surround a pixel to hide it: beside an
outline, and on ground seen at a grazing angle, nothing is taken away. How far apart the points of
a front fall goes with the focal length, and so do the neighbourhoods; an outline is as sharp in any
image, and so the second is wider by as many pixels in each.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable

import cv2
import numba
import numpy as np
from numpy.typing import NDArray

from civil_rgbd.constants import NO_DEPTH_M
from civil_rgbd.domain.recipe import CLOSING_FX_PX, DepthStage, VisibilityStage
from civil_rgbd.geometry.camera import PinholeCamera
from civil_rgbd.pipeline.render import draw_nearest


def nearest_surface(
    depth_m: NDArray[np.float32],
    others: Iterable[NDArray[np.float32]],
    *,
    T_camera_local: NDArray[np.float64],
    camera: PinholeCamera,
    limits: DepthStage,
) -> NDArray[np.float32]:
    """Return the least depth that a frame's points and some others have in each pixel.

    Args:
        depth_m: (H, W) float32, metres, 0 = nothing measured: of the frame's points.
        others: (3, n) float32 each, metres, local frame: more points that may hide some.
        T_camera_local: (4, 4) local frame to camera optical frame.
        camera: the pinhole.
        limits: depth range of the points that count.

    Returns:
        (H, W) float32, metres; inf where no point is.
    """
    nearest = np.empty(depth_m.size + 1, dtype=np.float32)
    _begin(depth_m.ravel(), np.float32(NO_DEPTH_M), nearest)
    unrounded = dataclasses.replace(limits, step_m=0.0)
    draw_nearest(
        others, T_camera_local=T_camera_local, camera=camera, stage=unrounded, nearest=nearest
    )
    return nearest[:-1].reshape(depth_m.shape)


def forget_gone(
    surface_m: NDArray[np.float32],
    depth_m: NDArray[np.float32],
    *,
    camera: PinholeCamera,
    stage: VisibilityStage,
) -> None:
    """Let older points hide nothing where all of the frame's own around them lie behind.

    What moved away still stands in the older points; the frame's own have seen what was behind.

    Args:
        surface_m: (H, W) float32, from :func:`nearest_surface`. Changed in place.
        depth_m: (H, W) float32, metres, 0 = nothing measured: of the frame's points.
        camera: the pinhole.
        stage: how far around, and how far behind.
    """
    if not stage.gone_px:
        return
    flat_m = np.empty(depth_m.size + 1, dtype=np.float32)
    _begin(depth_m.ravel(), np.float32(NO_DEPTH_M), flat_m)
    own_m = flat_m[:-1].reshape(depth_m.shape)
    # Beyond the image the pixels of its edge: those that the neighbourhood has anyway.
    around_m = cv2.erode(
        own_m, _square(_scaled_px(stage.gone_px, camera)), borderType=cv2.BORDER_REPLICATE
    )
    _forget(surface_m, own_m, around_m, stage.margin_m, 1.0 + stage.margin_share)


def closed_front(
    surface_m: NDArray[np.float32], *, camera: PinholeCamera, stage: VisibilityStage
) -> NDArray[np.float32]:
    """Return how far one can see: the nearest surface with its holes closed.

    Args:
        surface_m: (H, W) float32, from :func:`nearest_surface`.
        camera: the pinhole: a hole between two points is as many pixels wide as its focal length.
        stage: how holes are closed.

    Returns:
        (H, W) float32, metres; inf where nothing hides anything.
    """
    # Minima and maxima only: exact, whatever instructions the processor has. What lies outside of
    # the image counts for neither.
    closing_px = _scaled_px(stage.closing_px, camera)
    grown = cv2.erode(surface_m, _square(closing_px))
    return np.asarray(cv2.dilate(grown, _square(closing_px + 2 * stage.rim_px)))


def remove_hidden(
    depth_m: NDArray[np.float32], front_m: NDArray[np.float32], *, stage: VisibilityStage
) -> int:
    """Empty the pixels that lie behind the front.

    Args:
        depth_m: (H, W) float32, metres, 0 = nothing measured. Changed in place.
        front_m: (H, W) float32, from :func:`closed_front`.
        stage: how far behind the front a pixel must lie.

    Returns:
        how many pixels were emptied.
    """
    removed: int = _remove(
        depth_m, front_m, stage.margin_m, 1.0 + stage.margin_share, np.float32(NO_DEPTH_M)
    )
    return removed


def _scaled_px(side_px: int, camera: PinholeCamera) -> int:
    """Return the side of a square in pixels of this camera; odd, and 1 only if it is 1."""
    reach_px = side_px // 2
    if not reach_px:
        return 1
    scaled_px = math.floor(reach_px * camera.fx_px / CLOSING_FX_PX + 0.5)
    return 2 * max(scaled_px, 1) + 1


def _square(side_px: int) -> NDArray[np.uint8]:
    return np.ones((side_px, side_px), dtype=np.uint8)


@numba.njit(cache=True, nogil=True)
def _begin(depth_m, no_depth_m, nearest):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202  # a kernel: numba infers
    for i in range(len(depth_m)):
        nearest[i] = depth_m[i] if depth_m[i] != no_depth_m else np.float32(np.inf)
    nearest[len(depth_m)] = np.float32(np.inf)


# In float64 and without fastmath: no processor rounds it otherwise.
@numba.njit(cache=True, nogil=True)
def _remove(depth_m, front_m, margin_m, times, no_depth_m):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202  # a kernel: numba infers
    removed = 0
    rows, columns = depth_m.shape
    for row in range(rows):
        for column in range(columns):
            limit_m = np.float64(front_m[row, column]) * times + margin_m
            if np.float64(depth_m[row, column]) > limit_m:
                depth_m[row, column] = no_depth_m
                removed += 1
    return removed


@numba.njit(cache=True, nogil=True)
def _forget(surface_m, own_m, around_m, margin_m, times):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202  # a kernel: numba infers
    rows, columns = surface_m.shape
    for row in range(rows):
        for column in range(columns):
            limit_m = np.float64(surface_m[row, column]) * times + margin_m
            if limit_m < np.float64(around_m[row, column]) < np.inf:
                surface_m[row, column] = own_m[row, column]
