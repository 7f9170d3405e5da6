"""Small planes in point clouds: the cells of a grid whose points lie flat."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

CELL_M: Final = 0.5
"""Girder flanges and bearings fit in; ten points of a scan do too, some ten metres away."""

FEWEST_POINTS: Final = 8
_FLATNESS: Final = 0.05
_MOST_DOUBT_RAD2: Final = 0.02**2
_REACH: Final = 1 << 20  # cells from the origin: 500 km


@dataclass(frozen=True, slots=True, eq=False)
class Cells:
    """Sums over the points of each cell; adding two of them adds their points.

    Attributes:
        keys: (C,) int64, ascending, one number a cell.
        counts: (C,) points.
        sums_m: (C, 3), relative to the cell's middle.
        squares_m2: (C, 6): xx xy xz yy yz zz, relative to the cell's middle.
    """

    keys: NDArray[np.int64]
    counts: NDArray[np.float64]
    sums_m: NDArray[np.float64]
    squares_m2: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Planes:
    """The flat cells.

    Attributes:
        keys: (K,) int64, ascending.
        middles_m: (K, 3) mean of the points.
        normals: (K, 3) unit; which way they point means nothing.
        doubt: (K,) variance of the direction of each normal, rad^2.
    """

    keys: NDArray[np.int64]
    middles_m: NDArray[np.float64]
    normals: NDArray[np.float64]
    doubt: NDArray[np.float64]


def keys_of(points_m: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the cell of each of (N, 3) points as one number: (N,) int64."""
    cell = np.floor(points_m / CELL_M).astype(np.int64) + _REACH
    key: NDArray[np.int64] = (cell[:, 0] << 42) | (cell[:, 1] << 21) | cell[:, 2]
    return key


def cells_of(points_m: NDArray[np.float64]) -> Cells:
    """Sum (N, 3) points cell by cell."""
    keys, cell = np.unique(keys_of(points_m), return_inverse=True)
    offset = points_m - _centres(keys)[cell]
    x, y, z = offset.T
    columns = [x, y, z, x * x, x * y, x * z, y * y, y * z, z * z]
    sums = _summed(cell, columns, len(keys))
    counts = np.bincount(cell, minlength=len(keys)).astype(np.float64)
    return Cells(keys, counts, sums[:, :3], sums[:, 3:])


def merged(parts: list[Cells]) -> Cells:
    """Add sums of the same cells."""
    keys, cell = np.unique(np.concatenate([part.keys for part in parts]), return_inverse=True)
    table = np.concatenate(
        [np.column_stack([part.counts, part.sums_m, part.squares_m2]) for part in parts]
    )
    sums = _summed(cell, list(table.T), len(keys))
    return Cells(keys, sums[:, 0], sums[:, 1:4], sums[:, 4:])


def _summed(
    cell: NDArray[np.intp], columns: list[NDArray[np.float64]], count: int
) -> NDArray[np.float64]:
    table = np.empty((count, len(columns)))
    for k, column in enumerate(columns):
        table[:, k] = np.bincount(cell, column, count)
    return table


def planes_of(cells: Cells) -> Planes:
    """Fit a plane to each cell, and keep those that fit: flat, and wide in both directions."""
    many = cells.counts >= FEWEST_POINTS
    n = cells.counts[many, np.newaxis]
    mean = cells.sums_m[many] / n
    xx, xy, xz, yy, yz, zz = (cells.squares_m2[many] / n).T
    second = np.stack([xx, xy, xz, xy, yy, yz, xz, yz, zz], axis=1).reshape(-1, 3, 3)
    spread, axes = np.linalg.eigh(second - mean[:, :, np.newaxis] * mean[:, np.newaxis, :])
    doubt = spread[:, 0].clip(min=0.0) / np.maximum(n[:, 0] * spread[:, 1], 1e-12)
    flat = (spread[:, 0] < _FLATNESS * spread[:, 1]) & (doubt < _MOST_DOUBT_RAD2)
    keys = cells.keys[many]
    return Planes(keys[flat], (mean + _centres(keys))[flat], axes[flat, :, 0], doubt[flat])


def _centres(keys: NDArray[np.int64]) -> NDArray[np.float64]:
    mask = (1 << 21) - 1
    cell = np.stack([keys >> 42, (keys >> 21) & mask, keys & mask], axis=1) - _REACH
    centres: NDArray[np.float64] = (cell + 0.5) * CELL_M
    return centres
