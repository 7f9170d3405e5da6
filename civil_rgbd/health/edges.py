"""Where depth jumps, does the picture have an edge? One image and the points around its instant."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from civil_rgbd.geometry.camera import LensCamera, PinholeCamera, source_pixels
from civil_rgbd.geometry.transforms import transform_points

_WIDTH_PX: Final = 640
"""Images are looked at in this width: an edge is then some two pixels wide."""
_CELL_PX: Final = 4
_REACH_CELLS: Final = 2
_NEAREST_M: Final = 0.5
_JUMP_SHARE: Final = 0.1
_JUMP_M: Final = 0.5
"""A rim is a point with a neighbour more than a tenth of its depth and half a metre behind it."""
_AROUND_PX: Final = 15.0
_SPREAD_PX: Final = 2.0  # a rim is known to one cell, not to a pixel
_FLOOR: Final = 10.0  # grey levels: noise of a flat wall is no edge


@dataclass(frozen=True, slots=True, eq=False)
class EdgePicture:
    """How strongly each pixel differs from its neighbours, beside its surroundings.

    Attributes:
        camera: the pinhole of both maps.
        upright: (H, W) float32, across columns.
        level: (H, W) float32, across rows.
    """

    camera: PinholeCamera
    upright: NDArray[np.float32]
    level: NDArray[np.float32]


def edge_picture(rgb: NDArray[np.uint8], camera: LensCamera) -> EdgePicture:
    """Undistort and shrink an image, and find its edges.

    Args:
        rgb: (H, W, 3) uint8, as taken.
        camera: that took it.
    """
    stored = camera.pinhole.scaled(min(1.0, _WIDTH_PX / camera.pinhole.width_px))
    source = source_pixels(camera, stored)
    grey = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY)
    blurred = cv2.GaussianBlur(grey, (0, 0), max(0.5, 0.4 * rgb.shape[1] / stored.width_px))
    small = cv2.remap(blurred, source.columns, source.rows, cv2.INTER_LINEAR).astype(np.float32)
    maps = [_edges(cv2.Sobel(small, cv2.CV_32F, dx, 1 - dx), source.exists) for dx in (1, 0)]
    return EdgePicture(stored, maps[0], maps[1])


def _edges(slopes: NDArray[np.float32], exists: NDArray[np.bool_]) -> NDArray[np.float32]:
    real = cv2.erode(exists.astype(np.float32), np.ones((5, 5)))  # the lens' border is no edge
    steep = cv2.GaussianBlur(np.abs(slopes) * real, (0, 0), _SPREAD_PX)
    around = cv2.GaussianBlur(steep, (0, 0), _AROUND_PX)
    edges: NDArray[np.float32] = steep / (around + _FLOOR)
    return edges


@dataclass(frozen=True, slots=True, eq=False)
class EdgeSamples:
    """What one picture says of one way of mounting the camera.

    Attributes:
        points: how many there are.
        in_view: how many of them fall into the image.
        at_rims: (R,) edge strength where depth jumps, over the mean under all points in view: 1 is
            what chance gives.
    """

    points: int
    in_view: int
    at_rims: NDArray[np.float32]


def sample_edges(
    picture: EdgePicture, points_lidar: NDArray[np.floating], T_camera_lidar: NDArray[np.float64]
) -> EdgeSamples:
    """Project points, and read the edge strength where their depth jumps.

    Args:
        picture: of the image.
        points_lidar: (N, 3) metres.
        T_camera_lidar: (4, 4) LiDAR frame to camera optical frame.
    """
    camera = picture.camera
    points = transform_points(T_camera_lidar, points_lidar)
    points = points[points[:, 2] > _NEAREST_M]
    u = np.floor(camera.fx_px * points[:, 0] / points[:, 2] + camera.cx_px + 0.5)
    v = np.floor(camera.fy_px * points[:, 1] / points[:, 2] + camera.cy_px + 0.5)
    inside = (u >= 0) & (u < camera.width_px) & (v >= 0) & (v < camera.height_px)
    u, v, depth_m = u[inside].astype(int), v[inside].astype(int), points[inside, 2]
    if not len(u):
        return EdgeSamples(len(points_lidar), 0, np.zeros(0, np.float32))
    front_m, columns, rows = _nearest_a_cell(u, v, depth_m, camera)
    seen, found = np.isfinite(front_m), [np.zeros(0, np.float32)]
    for edges, axis in ((picture.upright, 1), (picture.level, 0)):
        by_chance = edges[rows[seen], columns[seen]].mean()
        if by_chance > 0:
            rim = _rims(front_m, axis)
            found.append(edges[rows[rim], columns[rim]] / by_chance)
    return EdgeSamples(len(points_lidar), len(u), np.concatenate(found))


def _nearest_a_cell(
    u: NDArray[np.int_], v: NDArray[np.int_], depth_m: NDArray[np.float64], camera: PinholeCamera
) -> tuple[NDArray[np.float64], NDArray[np.int_], NDArray[np.int_]]:
    """Return depth, column and row of the nearest point of each cell; infinite depth without."""
    shape = (camera.height_px // _CELL_PX + 1, camera.width_px // _CELL_PX + 1)
    far_first = np.argsort(-depth_m, kind="stable")
    u, v, depth_m = u[far_first], v[far_first], depth_m[far_first]
    cells = v // _CELL_PX, u // _CELL_PX
    front_m = np.full(shape, np.inf)
    columns, rows = np.zeros(shape, dtype=int), np.zeros(shape, dtype=int)
    front_m[cells], columns[cells], rows[cells] = depth_m, u, v  # the last, nearest one stays
    return front_m, columns, rows


def _rims(front_m: NDArray[np.float64], axis: int) -> NDArray[np.bool_]:
    """Cells with a neighbour along an axis that lies well behind them."""
    rim = np.zeros(front_m.shape, dtype=np.bool_)
    for side in (-1, 1):
        behind_m = np.full(front_m.shape, np.inf)
        for step in range(1, _REACH_CELLS + 1):
            there = _moved(front_m, -side * step, axis)
            behind_m = np.where(np.isfinite(behind_m), behind_m, there)
        rim |= np.isfinite(behind_m) & (behind_m > front_m * (1 + _JUMP_SHARE) + _JUMP_M)
    return rim


def _moved(values: NDArray[np.float64], step: int, axis: int) -> NDArray[np.float64]:
    moved = np.full(values.shape, np.inf)
    into, out_of = _slices(step, values.shape[axis])
    if axis:
        moved[:, into] = values[:, out_of]
    else:
        moved[into] = values[out_of]
    return moved


def _slices(step: int, size: int) -> tuple[slice, slice]:
    return slice(max(step, 0), size + min(step, 0)), slice(max(-step, 0), size - max(step, 0))
