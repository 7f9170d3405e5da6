"""Edges that the LiDAR sees: neighbouring points whose depth jumps, as a camera would see them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numba
import numpy as np
from numpy.typing import NDArray

from civil_rgbd.geometry.camera import PinholeCamera
from civil_rgbd.geometry.transforms import inverse
from civil_rgbd.health.nearest import nearest_a_cell
from civil_rgbd.health.sampling import Posed, Stretch, camera_poses, image_stamps
from civil_rgbd.health.views import Views

Floats = NDArray[np.float64]

_IMAGES: Final = 28
_IMAGES_A_STRETCH: Final = 3
_WITHIN_NS: Final = 250_000_000
_CELL_PX: Final = 2
_REACH_CELLS: Final = 3
_JUMP_SHARE, _JUMP_M = 0.1, 0.4
_ALIKE_SHARE: Final = 0.04
_MOST_EDGES: Final = 800  # of an image


@dataclass(frozen=True, slots=True, eq=False)
class DepthEdges:
    """Edges that the LiDAR saw, and the pictures that should show them.

    Attributes:
        rays: (E, 3) float64 directions in the camera, z = 1.
        upright: (E,) bool: the depth changes along a row.
        picture: (E,) int64, which picture.
        pictures: (P, H, W) uint8.
        camera: their pinhole.
    """

    rays: Floats
    upright: NDArray[np.bool_]
    picture: NDArray[np.int64]
    pictures: NDArray[np.uint8]
    camera: PinholeCamera


def depth_edges(
    recording: Posed, stretches: Sequence[Stretch], views: Views, shift_s: float
) -> DepthEdges:
    """Find the depth edges around some images of each stretch.

    Args:
        recording: with poses.
        stretches: of it.
        views: of its images.
        shift_s: to be added to the images' stamps beyond what the rig says.
    """
    stamps_ns, camera = image_stamps(recording) + round(shift_s * 1e9), views.camera
    pictures: list[NDArray[np.uint8]] = []
    parts: list[tuple[Floats, NDArray[np.bool_], int]] = []
    wanted = int(np.clip(_IMAGES // max(1, len(stretches)), 1, _IMAGES_A_STRETCH))
    for stretch in stretches:
        for index in stretch.images[1 :: max(1, len(stretch.images) // wanted)]:
            grey = views.at(index)
            if grey is None:
                continue
            near = np.abs(stretch.stamps_ns - stamps_ns[index]) < _WITHIN_NS
            T_map_camera = camera_poses(recording, stamps_ns[index : index + 1])[0]
            points_map = stretch.points_map[near]
            rays, upright = edges_seen(points_map, inverse(T_map_camera), camera)
            step = max(1, len(rays) // _MOST_EDGES)
            parts.append((rays[::step], upright[::step], len(pictures)))
            pictures.append(grey)
    shape = (0, camera.height_px, camera.width_px)
    return DepthEdges(
        np.concatenate([np.zeros((0, 3)), *(rays for rays, _, _ in parts)]),
        np.concatenate([np.zeros(0, np.bool_), *(upright for _, upright, _ in parts)]),
        np.concatenate([np.zeros(0, np.int64), *(np.full(len(r), n) for r, _, n in parts)]),
        np.stack(pictures) if pictures else np.zeros(shape, np.uint8),
        camera,
    )


def edges_seen(
    points_map: Floats, T_camera_map: Floats, camera: PinholeCamera
) -> tuple[Floats, NDArray[np.bool_]]:
    """Find where neighbouring points lie at different depths, as a camera sees them.

    Args:
        points_map: (N, 3) metres.
        T_camera_map: (4, 4) map to camera.
        camera: its pinhole.

    Returns:
        directions (E, 3) in the camera, z = 1; and whether the depth changes along a row (E,).
    """
    table = nearest_a_cell(points_map, T_camera_map, camera, _CELL_PX)
    along = _between(table)
    down = _between(np.ascontiguousarray(table.transpose(0, 2, 1)))
    at = np.concatenate([along, down])
    upright = np.arange(len(at)) < len(along)
    rays = np.column_stack([
        (at[:, 0] - camera.cx_px) / camera.fx_px,
        (at[:, 1] - camera.cy_px) / camera.fy_px,
        np.ones(len(at)),
    ])  # fmt: skip
    return rays, upright


def _between(table: Floats) -> Floats:
    """Return the pixels (E, 2) between neighbours of a row whose depths jump.

    Args:
        table: (3, H, W): column, row and depth of the nearest point of each cell, 0 without.
    """
    found = np.empty((table.shape[1] * table.shape[2], 2))
    return found[: _walk_rows(table, found)]


@numba.njit(cache=True)
def _walk_rows(table, found):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202  # a kernel: numba infers
    count = 0
    last = np.zeros(4, dtype=np.int64)
    for row in range(table.shape[1]):
        filled = 0
        for column in range(table.shape[2]):
            if table[2, row, column] == 0:
                continue
            # The last four filled cells: two on either side of what may be an edge.
            last[0], last[1], last[2], last[3] = last[1], last[2], last[3], column
            filled += 1
            if filled < 4 or last[2] - last[1] > _REACH_CELLS:
                continue
            if last[3] - last[2] > 2 * _REACH_CELLS or last[1] - last[0] > 2 * _REACH_CELLS:
                continue
            a, b = table[2, row, last[1]], table[2, row, last[2]]
            before, after = table[2, row, last[0]], table[2, row, last[3]]
            if abs(a - b) < _JUMP_SHARE * min(a, b) + _JUMP_M:
                continue
            if abs(before - a) > _ALIKE_SHARE * a or abs(after - b) > _ALIKE_SHARE * b:
                continue  # a single far point between near ones is seen through a gap
            for k in range(2):
                found[count, k] = (table[k, row, last[1]] + table[k, row, last[2]]) / 2
            count += 1
    return count
