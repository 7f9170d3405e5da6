"""The coloured points of frames, in the map; all of them, or one for each small cube."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.errors import UsageError
from civil_rgbd.exporters.poses import transform_of
from civil_rgbd.exporters.report import ExportOptions
from civil_rgbd.exporters.selection import Chosen
from civil_rgbd.geometry.transforms import transform_points

_BITS: Final = 21
_REACH: Final = 1 << (_BITS - 1)
"""Cubes that fit beside the first one, in each direction."""


@dataclass(frozen=True, slots=True, eq=False)
class ColouredPoints:
    """Points with colours.

    Attributes:
        points_map: (N, 3) float64, metres, map frame.
        rgb: (N, 3) uint8.
    """

    points_map: NDArray[np.float64]
    rgb: NDArray[np.uint8]


def points_of(one: Chosen, options: ExportOptions) -> Iterator[ColouredPoints]:
    """Yield the points of a bridge: frame by frame, or at the end one for each cube.

    Args:
        one: the bridge and its frames.
        options: with ``voxel_m`` the points of a cube become one, their mean, and so their colours.

    Raises:
        FormatError: a frame is damaged.
        UsageError: the cubes are too small for the bridge's extent.
    """
    cubes = None if options.voxel_m is None else _Cubes(options.voxel_m)
    for row in one.rows:
        depth_m, rgb = one.bridge.read_depth(row), one.bridge.read_rgb(row)
        camera = one.bridge.camera
        v, u = np.nonzero(depth_m)
        z = depth_m[v, u].astype(np.float64)
        x, y = (u - camera.cx_px) / camera.fx_px * z, (v - camera.cy_px) / camera.fy_px * z
        points_map = transform_points(transform_of(row), np.stack([x, y, z], axis=1))
        options.on_frame()
        if cubes is not None:
            cubes.add(points_map, rgb[v, u])
        elif len(points_map):
            yield ColouredPoints(points_map, rgb[v, u])
    if cubes is not None:
        yield from cubes.means()


class _Cubes:
    """Sums of positions and colours by cube; what is new is merged when it outgrows the rest."""

    def __init__(self, edge_m: float) -> None:
        self._edge_m = edge_m
        self._origin: NDArray[np.int64] | None = None
        self._keys = np.zeros(0, dtype=np.int64)
        self._sums = np.zeros((0, 7))  # x y z r g b, and how many
        self._new: list[tuple[NDArray[np.int64], NDArray[np.float64]]] = []
        self._waiting = 0

    def add(self, points_map: NDArray[np.float64], rgb: NDArray[np.uint8]) -> None:
        """Add (N, 3) points in metres with (N, 3) colours."""
        if not len(points_map):
            return
        cubes = np.floor(points_map / self._edge_m).astype(np.int64)
        if self._origin is None:
            self._origin = cubes[0]
        steps = cubes - self._origin + _REACH
        if steps.min() < 0 or steps.max() >= 2 * _REACH:
            raise UsageError(
                f"cubes of {self._edge_m} m are too small for this extent: more than {_REACH} fit "
                "in a row",
                where="--voxel-m",
                fix="take larger ones",
            )
        keys = (steps[:, 0] << (2 * _BITS)) | (steps[:, 1] << _BITS) | steps[:, 2]
        values = np.concatenate([points_map, rgb, np.ones((len(keys), 1))], axis=1)
        self._new.append(_merged(keys, values))
        self._waiting += len(self._new[-1][0])
        if self._waiting > max(len(self._keys), 1_000_000):
            self._merge()

    def means(self) -> Iterator[ColouredPoints]:
        """Yield the mean point of every cube, by cube; nothing where no point was added."""
        self._merge()
        if len(self._keys):
            means = self._sums[:, :6] / self._sums[:, 6:]
            yield ColouredPoints(means[:, :3], np.floor(means[:, 3:] + 0.5).astype(np.uint8))

    def _merge(self) -> None:
        keys = np.concatenate([self._keys, *(keys for keys, _ in self._new)])
        values = np.concatenate([self._sums, *(values for _, values in self._new)])
        self._keys, self._sums = _merged(keys, values)
        self._new, self._waiting = [], 0


def _merged(
    keys: NDArray[np.int64], values: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    if not len(keys):
        return keys, values
    order = np.argsort(keys, kind="stable")
    keys, values = keys[order], values[order]
    starts = np.flatnonzero(np.concatenate([[True], keys[1:] != keys[:-1]]))
    return keys[starts], np.add.reduceat(values, starts, axis=0)
