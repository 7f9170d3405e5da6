"""Daylight on a scene: the sun, and what of the sky and the surroundings each spot sees."""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.simulator.scene import SKY, THREADS, Face, RayCaster, Scene, dots, unit_normals
from civil_rgbd.simulator.texture import MATERIALS
from civil_rgbd.simulator.waves import cosine, sine

SUN_LIGHT: Final = 1.6
"""Sunlight on a surface that faces the sun; the open sky gives 1."""

_LIFT_M = 2e-3  # rays start this far off the surface that they leave
_RAYS = 32
_CELL_M = 0.5
_MOST_CELLS = 40
_OPEN_ROWS = 2  # below the map: where whatever moves looks its light up
_SMALL_M = 0.35  # a seamless face smaller than this gets one value
_INSET_M = 0.03
_NEAR_M = 25.0  # from the scene's middle; beyond, cells grow with the distance
_UNDERSIDE = 0.25  # of the light on its top, what reaches a mover's underside
_GROUND_AMBIENT = 0.35  # what lit-up surroundings throw back besides the sun's light


@dataclass(frozen=True, slots=True, eq=False)
class FaceAxes:
    """Each face's own plane coordinates: u along, v up (or x and y on level faces).

    Attributes:
        along: (F, 3) float64 unit vectors.
        up: (F, 3) float64 unit vectors.
        low_m: (F, 2) smallest u, v of each face.
        high_m: (F, 2) largest u, v.
        texture_m: (F, 2) the u, v at which textures begin.
    """

    along: NDArray[np.float64]
    up: NDArray[np.float64]
    low_m: NDArray[np.float64]
    high_m: NDArray[np.float64]
    texture_m: NDArray[np.float64]


def face_axes(faces: tuple[Face, ...], *, seamless: bool) -> FaceAxes:
    """Choose plane coordinates for every face; seamless ones share them within a plane."""
    first = np.stack([face.corners_m[:3] for face in faces])
    normals = unit_normals(first[:, 0], first[:, 1], first[:, 2])
    level = np.abs(normals[:, 2]) > 0.9
    flat = np.sqrt(normals[:, 0] ** 2 + normals[:, 1] ** 2)
    safe = np.where(level, 1.0, flat)
    along = np.stack([-normals[:, 1] / safe, normals[:, 0] / safe, np.zeros(len(faces))], axis=1)
    along[level] = [1.0, 0.0, 0.0]
    up = np.cross(normals, along)
    counts = [len(face.corners_m) for face in faces]
    corners, starts = np.concatenate([face.corners_m for face in faces]), np.cumsum([0, *counts])
    spans = [dots(corners, np.repeat(axis, counts, axis=0)) for axis in (along, up)]
    spread = np.stack(spans, axis=1)
    low = np.minimum.reduceat(spread, starts[:-1])
    high = np.maximum.reduceat(spread, starts[:-1])
    return FaceAxes(along, up, low, high, np.zeros_like(low) if seamless else low)


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

    @property
    def open_row_px(self) -> int:
        """A row of open sky, and the one below it too."""
        return len(self.light) - _OPEN_ROWS


def bake(caster: RayCaster) -> LightMap:
    """Send rays from a grid on every face and gather what they find."""
    scene = caster.scene
    axes = face_axes(scene.faces, seamless=scene.seamless)
    extent = axes.high_m - axes.low_m
    coarser = _coarser(scene)[:, np.newaxis]
    cells = np.clip(np.ceil(extent / (_CELL_M * coarser)).astype(int) + 1, 2, _MOST_CELLS)
    lefts, tops, size = _packed(cells)
    first = np.stack([face.corners_m[:3] for face in scene.faces])
    normals = unit_normals(first[:, 0], first[:, 1], first[:, 2])
    heights = dots(normals, first[:, 0])
    light = np.ones((size[0] + _OPEN_ROWS, size[1]), dtype=np.float32)
    small = scene.seamless & (extent / coarser < _SMALL_M).all(axis=1)
    middles = _on_faces(axes, normals, heights, (axes.low_m + axes.high_m) / 2)
    seen = _gathered(caster, middles[small], normals[small])
    for j in (0, 1):
        for i in (0, 1):
            light[tops[small] + j, lefts[small] + i] = seen
    owner, places = _grids(axes, cells, np.flatnonzero(~small), inset=scene.seamless)
    points = _on_faces(axes, normals, heights, places[:, :2], owner)
    row, column = places[:, 2].astype(int), places[:, 3].astype(int)
    light[row + tops[owner], column + lefts[owner]] = _gathered(caster, points, normals[owner])
    cells_per_m = (cells - 1) / extent
    begin = (axes.low_m - axes.texture_m) * cells_per_m
    return LightMap(
        axes,
        light,
        (lefts - begin[:, 0]).astype(np.float32),
        (tops - begin[:, 1]).astype(np.float32),
        cells_per_m.astype(np.float32),
    )


def _coarser(scene: Scene) -> NDArray[np.float64]:
    """Return how much coarser than near the middle each face's light may be: (F,)."""
    if not scene.seamless:
        return np.ones(len(scene.faces))
    first = np.stack([face.corners_m[:3] for face in scene.faces]).mean(axis=1)
    coarser: NDArray[np.float64] = np.maximum(
        np.sqrt(first[:, 0] ** 2 + first[:, 1] ** 2) / _NEAR_M, 1.0
    )
    return coarser


def _grids(
    axes: FaceAxes, cells: NDArray[np.int64], faces: NDArray[np.intp], *, inset: bool
) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """Return of every grid point its face (N,), and u, v, row, column (N, 4)."""
    # Off the edge a little, so that no ray slips out below the face that meets it there.
    edge = np.minimum(_INSET_M, (axes.high_m - axes.low_m) / 8) * inset
    low, high = axes.low_m + edge, axes.high_m - edge
    owner = np.repeat(faces, cells[faces].prod(axis=1))
    begins = np.cumsum([0, *cells[faces].prod(axis=1)])[:-1]
    count = np.arange(len(owner)) - np.repeat(begins, cells[faces].prod(axis=1))
    row, column = np.divmod(count, cells[owner, 0])
    steps = (high - low) / (cells - 1)
    spread = []
    for k, at in enumerate((column, row)):
        # As np.linspace sums it, to the last bit.
        inner = at * steps[owner, k] + low[owner, k]
        spread.append(np.where(at == cells[owner, k] - 1, high[owner, k], inner))
    return owner, np.stack([*spread, row, column], axis=1)


def _on_faces(
    axes: FaceAxes,
    normals: NDArray[np.float64],
    heights_m: NDArray[np.float64],
    uv_m: NDArray[np.float64],
    owner: NDArray[np.intp] | slice = slice(None),
) -> NDArray[np.float64]:
    """Return the points (N, 3) just off the faces at (N, 2) plane coordinates."""
    spot = uv_m[:, :1] * axes.along[owner] + uv_m[:, 1:] * axes.up[owner]
    points: NDArray[np.float64] = (
        spot + (heights_m[owner] + _LIFT_M)[:, np.newaxis] * normals[owner]
    )
    return points


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
    if not len(points_m):
        return np.zeros(0, dtype=np.float32)
    sun = np.asarray(scene.sun)
    albedo = np.array(
        [sum(MATERIALS[face.material].colour) / 3 for face in scene.faces], dtype=np.float32
    )[scene.face_of_triangle]
    sunlit = np.maximum(dots(scene.normals, sun[np.newaxis]), 0).astype(np.float32) * np.float32(
        SUN_LIGHT
    )
    origins = points_m.astype(np.float32)
    total = np.zeros(len(points_m), dtype=np.float32)

    def found(direction: NDArray[np.float64]) -> NDArray[np.float32]:
        # A unit normal plus a point on the unit sphere: directions weighted by the cosine.
        d = (normals + direction).astype(np.float32)
        hit = caster.nearest(origins, d)
        light = np.where(hit == SKY, np.float32(1.0), 0)
        seen = np.flatnonzero(hit != SKY)
        n, k = scene.normals[hit[seen]], hit[seen]
        t = (scene.offsets_m[k] - dots(n, points_m[seen])) / dots(n, d[seen].astype(np.float64))
        spot = points_m[seen] + t[:, np.newaxis] * d[seen] + _LIFT_M * n
        in_sun = (sunlit[k] > 0) & ~caster.blocked(spot.astype(np.float32), sun.astype(np.float32))
        light[seen] = albedo[k] * (sunlit[k] * in_sun + np.float32(_GROUND_AMBIENT))
        return light

    with ThreadPoolExecutor(THREADS) as threads:
        for light in threads.map(found, _sphere(_RAYS)):  # in order: sums of floats depend on it
            total += light
    return total / np.float32(_RAYS)


def _sphere(count: int) -> NDArray[np.float64]:
    """Return (count, 3) unit vectors spread evenly (a Fibonacci lattice)."""
    k = np.arange(count) + 0.5
    z = 1 - 2 * k / count
    turns, radius = k * (math.sqrt(5) - 1) / 2, np.sqrt(1 - z * z)
    # 0.999: the vector opposite a normal must not cancel it.
    return 0.999 * np.stack([radius * cosine(turns), radius * sine(turns), z], axis=1)


def openness(
    caster: RayCaster, middle_m: NDArray[np.float64], normals: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return how much light but the sun's reaches (N, 3) normals about a place: (N,), 1 = open."""
    directions = _sphere(_RAYS)
    above = directions[directions[:, 2] > 0].astype(np.float32)
    free = caster.nearest(middle_m.astype(np.float32)[np.newaxis], above) == SKY
    sky = 0.15 + 0.85 * float(np.count_nonzero(free)) / len(above)
    up = (1 + normals[:, 2]) / 2
    return sky * (_UNDERSIDE + (1 - _UNDERSIDE) * up)
