"""Daylight on a scene: the sun, and what of the sky and the surroundings each spot sees."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.simulator.scene import SKY, Face, RayCaster, dots
from civil_rgbd.simulator.texture import MATERIALS
from civil_rgbd.simulator.waves import cosine, sine

SUN: Final = np.array([-0.42, -0.48, 0.77])
"""Direction to the sun, scene frame; length 1 within 0.1 %."""
SUN_LIGHT: Final = 1.6
"""Sunlight on a surface that faces the sun; the open sky gives 1."""

_LIFT_M = 2e-3  # rays start this far off the surface that they leave
_RAYS = 32
_CELL_M = 0.5
_MOST_CELLS = 40
_GROUND_AMBIENT = 0.35  # what lit-up surroundings throw back besides the sun's light


@dataclass(frozen=True, slots=True, eq=False)
class FaceAxes:
    """Each face's own plane coordinates: u along, v up (or x and y on level faces).

    Attributes:
        along: (F, 3) float64 unit vectors.
        up: (F, 3) float64 unit vectors.
        low_m: (F, 2) smallest u, v of each face.
        high_m: (F, 2) largest u, v.
    """

    along: NDArray[np.float64]
    up: NDArray[np.float64]
    low_m: NDArray[np.float64]
    high_m: NDArray[np.float64]


def face_axes(faces: tuple[Face, ...]) -> FaceAxes:
    """Choose plane coordinates for every face."""
    normals = np.stack([face.normal for face in faces])
    level = np.abs(normals[:, 2]) > 0.9
    flat = np.sqrt(normals[:, 0] ** 2 + normals[:, 1] ** 2)
    safe = np.where(level, 1.0, flat)
    along = np.stack([-normals[:, 1] / safe, normals[:, 0] / safe, np.zeros(len(faces))], axis=1)
    along[level] = [1.0, 0.0, 0.0]
    up = np.cross(normals, along)
    spans = [
        np.stack([dots(face.corners_m, a[np.newaxis]), dots(face.corners_m, u[np.newaxis])], axis=1)
        for face, a, u in zip(faces, along, up, strict=True)
    ]
    return FaceAxes(
        along,
        up,
        np.stack([span.min(axis=0) for span in spans]),
        np.stack([span.max(axis=0) for span in spans]),
    )


@dataclass(frozen=True, slots=True, eq=False)
class LightMap:
    """How much light but the sun's reaches every spot of every face.

    Attributes:
        axes: plane coordinates of the faces.
        light: (H, W) float32, 1 = the open sky.
        lefts_px: (F,) column of each face's first cell; its middle is u = low.
        tops_px: (F,) row of each face's first cell.
        cells_per_m: (F, 2) along u and v.
    """

    axes: FaceAxes
    light: NDArray[np.float32]
    lefts_px: NDArray[np.float32]
    tops_px: NDArray[np.float32]
    cells_per_m: NDArray[np.float32]


def bake(caster: RayCaster) -> LightMap:
    """Send rays from a grid on every face and gather what they find."""
    faces = caster.scene.faces
    axes = face_axes(faces)
    extent = axes.high_m - axes.low_m
    cells = np.clip(np.ceil(extent / _CELL_M).astype(int) + 1, 2, _MOST_CELLS)
    lefts, tops, size = _packed(cells)
    points, normals, rows, columns = [], [], [], []
    for i, face in enumerate(faces):
        u = np.linspace(axes.low_m[i, 0], axes.high_m[i, 0], cells[i, 0])
        v = np.linspace(axes.low_m[i, 1], axes.high_m[i, 1], cells[i, 1])
        uu, vv = (grid.ravel() for grid in np.meshgrid(u, v))
        n = face.normal
        on_plane = dots(n[np.newaxis], face.corners_m[:1])
        spot = uu[:, np.newaxis] * axes.along[i] + vv[:, np.newaxis] * axes.up[i]
        points.append(spot + (on_plane + _LIFT_M) * n)
        normals.append(np.broadcast_to(n, spot.shape))
        row, column = np.divmod(np.arange(len(uu)), cells[i, 0])
        rows.append(row + tops[i])
        columns.append(column + lefts[i])
    light = np.ones(size, dtype=np.float32)
    light[np.concatenate(rows), np.concatenate(columns)] = _gathered(
        caster, np.concatenate(points), np.concatenate(normals)
    )
    return LightMap(
        axes,
        light,
        lefts.astype(np.float32),
        tops.astype(np.float32),
        ((cells - 1) / extent).astype(np.float32),
    )


def _packed(
    cells: NDArray[np.int64],
) -> tuple[NDArray[np.int64], NDArray[np.int64], tuple[int, int]]:
    """Lay rectangles on shelves: the tallest first, left to right."""
    width = 1024
    lefts, tops = np.zeros(len(cells), dtype=int), np.zeros(len(cells), dtype=int)
    left = top = shelf = 0
    for i in np.argsort(-cells[:, 1], kind="stable"):
        if left + cells[i, 0] > width:
            left, top, shelf = 0, top + shelf, 0
        lefts[i], tops[i] = left, top
        left, shelf = left + int(cells[i, 0]), max(shelf, int(cells[i, 1]))
    return lefts, tops, (top + shelf, width)


def _gathered(
    caster: RayCaster, points_m: NDArray[np.float64], normals: NDArray[np.float64]
) -> NDArray[np.float32]:
    scene = caster.scene
    albedo = np.array(
        [sum(MATERIALS[face.material].colour) / 3 for face in scene.faces], dtype=np.float32
    )[scene.face_of_triangle]
    sunlit = np.maximum(dots(scene.normals, SUN[np.newaxis]), 0).astype(np.float32) * np.float32(
        SUN_LIGHT
    )
    origins = points_m.astype(np.float32)
    total = np.zeros(len(points_m), dtype=np.float32)
    for direction in _sphere(_RAYS):
        # A unit normal plus a point on the unit sphere: directions weighted by the cosine.
        d = (normals + direction).astype(np.float32)
        hit = caster.nearest(origins, d)
        found = np.where(hit == SKY, np.float32(1.0), 0)
        seen = np.flatnonzero(hit != SKY)
        n, k = scene.normals[hit[seen]], hit[seen]
        t = (scene.offsets_m[k] - dots(n, points_m[seen])) / dots(n, d[seen])
        spot = points_m[seen] + t[:, np.newaxis] * d[seen] + _LIFT_M * n
        in_sun = (sunlit[k] > 0) & ~caster.blocked(spot.astype(np.float32), SUN.astype(np.float32))
        found[seen] = albedo[k] * (sunlit[k] * in_sun + np.float32(_GROUND_AMBIENT))
        total += found
    return total / np.float32(_RAYS)


def _sphere(count: int) -> NDArray[np.float64]:
    """Return (count, 3) unit vectors spread evenly (a Fibonacci lattice)."""
    k = np.arange(count) + 0.5
    z = 1 - 2 * k / count
    turns, radius = k * (math.sqrt(5) - 1) / 2, np.sqrt(1 - z * z)
    # 0.999: the vector opposite a normal must not cancel it.
    return 0.999 * np.stack([radius * cosine(turns), radius * sine(turns), z], axis=1)
