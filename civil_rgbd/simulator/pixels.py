"""The sums behind each pixel, one pass over a picture's rays: where they meet, what is seen there.

Compiled, in the very order and width of every sum that golden recordings were made with; without
fastmath, so that no processor rounds them otherwise.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numba
import numpy as np
from numpy.typing import NDArray

from civil_rgbd.simulator.scene import SKY
from civil_rgbd.simulator.texture import LEVELS, STAIN_TEXEL_M, TILE_PX, Atlas

Plane = NDArray[np.float32]

# Columns of the table that says for each triangle how it is painted.
N, ALONG, UP = slice(0, 3), slice(3, 6), slice(6, 9)
DISTANCE, U, V, SUNLIT, TEXELS, STAIN = 9, 10, 11, 12, 13, 14
LIGHT_LEFT, LIGHT_TOP, LIGHT_U, LIGHT_V, MATERIAL, GAIN = 15, 16, 17, 18, 19, 20
COLUMNS: Final = 21

_ONE, _HALF, _WHITE = np.float32(1), np.float32(0.5), np.float32(255)
_EXPOSURE: Final = np.float32(1.15)
_SUN_TINT: Final = tuple(map(np.float32, (1.06, 1.0, 0.90)))
_SKY_TINT: Final = tuple(map(np.float32, (0.94, 1.0, 1.08)))
_SKY_BLUE: Final = tuple(map(np.float32, (0.50, 0.68, 0.95)))
_SKY_RISE, _SKY_SCALE = np.float32(0.22), np.float32(0.16 * TILE_PX)
_SKY_MIDDLE, _HAZE, _BRIGHT_SKY = np.float32(TILE_PX / 2), np.float32(0.95), 238.0
_GRAIN: Final = np.float32(1.6) * 2  # the sensor's noise, grey values
_SOFTNESS, _GREYS = np.float32(0.55), np.float32(255 * 1.18)
_LEAST_SLANT: Final = np.float32(0.02)
_LIFT_M: Final = np.float32(3e-3)  # shadow rays start this far off the surface
_TILE, _PER_TILE, _ALBEDO_STEP = np.float32(TILE_PX), np.float32(1 / TILE_PX), np.float32(1 / 255)
_STAINS_PER_M, _STAIN_STEP = np.float32(1 / STAIN_TEXEL_M), np.float32(1 / 128)
_SHRINK: Final = np.ldexp(np.float32(1), -np.arange(LEVELS))
_PARTS: Final = np.float32(32)  # of a texel, each way
_EDGE: Final = np.float32(1.001)


@dataclass(frozen=True, slots=True, eq=False)
class Pictures:
    """All that pixels are looked up in.

    Attributes:
        atlas: textures of the materials.
        light: (H, W) float32, the light map.
        sky: (H, W) float32, clouds.
        exposure: 1 = right.
    """

    atlas: Atlas
    light: Plane
    sky: Plane
    exposure: float


def aimed(rays: Plane, R_scene_camera: Plane) -> Plane:
    """Return the directions (N, 3) float32, scene frame, of (2, N) X / Z and Y / Z."""
    directions = np.empty((rays.shape[1], 3), dtype=np.float32)
    _aim(rays, R_scene_camera, directions)
    return directions


def places_met(
    table: Plane, seen: tuple[NDArray[np.int32], Plane, Plane], origin_m: Plane, focal_px: float
) -> tuple[Plane, Plane]:
    """Return where rays meet their triangles.

    Args:
        table: (T, COLUMNS) how each triangle is painted.
        seen: triangles (N,), or :data:`SKY`; rays (2, N); their directions (N, 3).
        origin_m: (3,) of all rays.
        focal_px: pixels a radian.

    Returns:
        (3, N) float32: u and v on the triangle's face, and how wide a pixel is there, metres; what
        the sky's are is not said. (S, 3) float32: where shadow rays start, just off the surface,
        one for each ray that meets what faces the sun.
    """
    places = np.empty((3, len(seen[0])), dtype=np.float32)
    spots = np.empty_like(seen[2])
    return places, spots[: _meet(table, seen, (origin_m, np.float32(focal_px)), places, spots)]


def coloured(
    table: Plane,
    seen: tuple[NDArray[np.int32], Plane, Plane],
    places_m: Plane,
    shaded: NDArray[np.bool_],
    pictures: Pictures,
) -> Plane:
    """Return how bright the sensor finds what the rays meet.

    Args:
        table: (T, COLUMNS) how each triangle is painted.
        seen: triangles (N,), or :data:`SKY`; rays (2, N); their directions (N, 3).
        places_m: (3, N), of :func:`places_met`.
        shaded: (S,) which of its spots see no sun.
        pictures: textures, light, sky, and the exposure.

    Returns:
        (N, 3) float32 grey values, red green blue, perhaps beyond 255.
    """
    values = np.empty((len(seen[0]), 3), dtype=np.float32)
    exposure = np.float32(pictures.exposure)
    textures = pictures.atlas
    _texture(
        table, seen[0], places_m, (textures.albedo, textures.lefts_px, textures.tops_px), values
    )
    _stain(table, seen[0], places_m, textures.stain, values)
    _light_up(table, (seen[0], places_m, shaded), pictures.light, exposure, values)
    _saturate(values.reshape(-1))
    _put_sky(seen, pictures.sky, exposure, values)
    return values


def recorded(values: Plane, grain: Plane) -> NDArray[np.uint8]:
    """Return (N, 3) grey values as stored: uint8, with noise from (2, N) 0 to 1; (2, 0): none."""
    picture = np.empty(values.shape, dtype=np.uint8)
    _record(values, grain, picture)
    return picture


@numba.njit(cache=True, nogil=True)
def _aim(rays, R, directions):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202  # a kernel: numba infers
    for i in range(len(directions)):
        x, y = rays[0, i], rays[1, i]
        for k in range(3):
            directions[i, k] = R[k, 0] * x + R[k, 1] * y + R[k, 2]


# No row is sliced off a table, and what is called takes numbers: counting references to arrays
# would take longer than the sums.
@numba.njit(cache=True, nogil=True, error_model="numpy")
def _meet(table, seen, look, places, spots):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202  # a kernel: numba infers
    triangles, rays, directions = seen
    origin, focal_px = look
    count = 0
    for i in range(len(triangles)):
        row = max(triangles[i], 0)
        x, y, z = directions[i, 0], directions[i, 1], directions[i, 2]
        facing = table[row, 0] * x + table[row, 1] * y + table[row, 2] * z
        t = table[row, DISTANCE] / facing
        along = table[row, 3] * x + table[row, 4] * y + table[row, 5] * z
        up = table[row, 6] * x + table[row, 7] * y + table[row, 8] * z
        slant = abs(facing) / _length(rays[0, i], rays[1, i])
        places[0, i] = table[row, U] + t * along
        places[1, i] = table[row, V] + t * up
        places[2, i] = t / math.sqrt(max(slant, _LEAST_SLANT)) / focal_px
        if triangles[i] != SKY and table[row, SUNLIT] > 0:
            spots[count, 0] = origin[0] + t * x + _LIFT_M * table[row, 0]
            spots[count, 1] = origin[1] + t * y + _LIFT_M * table[row, 1]
            spots[count, 2] = origin[2] + t * z + _LIFT_M * table[row, 2]
            count += 1
    return count


@numba.njit(cache=True, nogil=True)
def _texture(table, triangles, places, pictures, out):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202  # a kernel: numba infers
    albedo, lefts, tops = pictures
    height, width, _ = albedo.shape
    for i in range(len(triangles)):
        row = max(triangles[i], 0)
        texels = table[row, TEXELS]
        # As coarse as the pixel asks: the level whose texel is at most a pixel wide.
        level, wide = 0, places[2, i] * texels
        for k in range(1, LEVELS):
            level += wide >= np.float32(1 << k)
        kind = np.int64(table[row, MATERIAL])
        column = _rest(places[0, i] * texels) * _SHRINK[level] - _HALF + lefts[kind, level]
        line = _rest(places[1, i] * texels) * _SHRINK[level] - _HALF + tops[kind, level]
        a, x = _texel(column, width)
        b, y = _texel(line, height)
        for k in range(3):
            upper = _mixed(albedo[b, a, k], albedo[b, a + 1, k], x)
            lower = _mixed(albedo[b + 1, a, k], albedo[b + 1, a + 1, k], x)
            root = np.float32((_mixed(upper, lower, y) + 512) >> 10) * _ALBEDO_STEP
            out[i, k] = root * root  # stored as square roots


@numba.njit(cache=True, nogil=True)
def _stain(table, triangles, places, stains, out):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202  # a kernel: numba infers
    height, width = stains.shape
    for i in range(len(triangles)):
        a, x = _texel(_rest(places[0, i] * _STAINS_PER_M) + _HALF, width)
        b, y = _texel(_rest(places[1, i] * _STAINS_PER_M) + _HALF, height)
        upper = _mixed(stains[b, a], stains[b, a + 1], x)
        lower = _mixed(stains[b + 1, a], stains[b + 1, a + 1], x)
        stain = np.float32((_mixed(upper, lower, y) + 512) >> 10)
        factor = _ONE + table[max(triangles[i], 0), STAIN] * (stain * _STAIN_STEP - _ONE)
        for k in range(3):
            out[i, k] *= factor


@numba.njit(cache=True, nogil=True)
def _light_up(table, seen, lights, exposure, out):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202  # a kernel: numba infers
    triangles, places, shaded = seen
    asked = 0
    for i in range(len(triangles)):
        row = max(triangles[i], 0)
        sun = table[row, SUNLIT]
        if triangles[i] != SKY and sun > 0:
            sun = np.float32(0) if shaded[asked] else sun
            asked += 1
        left = table[row, LIGHT_LEFT] + places[0, i] * table[row, LIGHT_U]
        top = table[row, LIGHT_TOP] + places[1, i] * table[row, LIGHT_V]
        around = _between(lights, left, top) * np.float64(table[row, GAIN])
        for k in range(3):
            light = np.float64(_SUN_TINT[k] * sun) + np.float64(_SKY_TINT[k]) * around
            out[i, k] = out[i, k] * (np.float32(light) * _EXPOSURE) * exposure


# A pass of its own, as processors take many of these roots at once.
@numba.njit(cache=True, nogil=True, error_model="numpy")
def _saturate(values):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202  # a kernel: numba infers
    for i in range(len(values)):
        # Bright parts saturate softly.
        values[i] = math.sqrt(values[i] / (values[i] * _SOFTNESS + _ONE)) * _GREYS


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _put_sky(seen, clouds, exposure, out):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202  # a kernel: numba infers
    triangles, rays, directions = seen
    for i in range(len(triangles)):
        if triangles[i] == SKY:
            length = _length(rays[0, i], rays[1, i])
            x, y = directions[i, 0] / length, directions[i, 1] / length
            # Haze below, blue above, clouds.
            height = max(directions[i, 2] / length, np.float32(0))
            scale = _SKY_SCALE / (height + _SKY_RISE)
            veil = _between(clouds, x * scale + _SKY_MIDDLE, y * scale + _SKY_MIDDLE)
            white = max(veil, np.float64(_ONE - math.sqrt(height) * _HAZE))
            for k in range(3):
                blue = _SKY_BLUE[k]
                grey = np.float64(blue) + np.float64(_ONE - blue) * white
                out[i, k] = np.float32(_BRIGHT_SKY * grey) * exposure


@numba.njit(cache=True, nogil=True)
def _record(values, grain, picture):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202  # a kernel: numba infers
    for i in range(len(values)):
        noise = np.float32(0)
        if grain.shape[1]:
            noise = _GRAIN * (grain[0, i] + grain[1, i] - _ONE)
        for k in range(3):
            value = min(max(values[i, k] + noise, np.float32(0)), _WHITE)
            picture[i, k] = np.uint8(np.int32(value + _HALF))


@numba.njit(cache=True, nogil=True)
def _length(x, y):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202  # a kernel: numba infers
    return math.sqrt(_ONE + x * x + y * y)


@numba.njit(cache=True, nogil=True)
def _rest(place):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202  # a kernel: numba infers
    return place - np.floor(place * _PER_TILE) * _TILE


@numba.njit(cache=True, nogil=True)
def _texel(place, count):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202  # a kernel: numba infers
    # In fixed point, as OpenCV's remap has it: the same on every processor.
    parts = np.int32(place * _PARTS + _HALF)
    # A ray that lies in its triangle's plane meets it nowhere: any texel will do.
    return min(max(parts >> 5, np.int32(0)), count - 2), parts & 31


@numba.njit(cache=True, nogil=True)
def _mixed(first, second, part):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202  # a kernel: numba infers
    return np.int32(first) * (np.int32(32) - part) + np.int32(second) * part


@numba.njit(cache=True, nogil=True)
def _between(values, column, line):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202  # a kernel: numba infers
    height, width = values.shape
    i = np.int64(min(max(column, np.float32(0)), np.float32(width) - _EDGE))
    j = np.int64(min(max(line, np.float32(0)), np.float32(height) - _EDGE))
    # What is no number becomes the least whole number there is.
    i, j = max(i, np.int64(0)), max(j, np.int64(0))
    x = min(max(np.float64(column) - np.float64(i), 0.0), 1.0)
    y = min(max(np.float64(line) - np.float64(j), 0.0), 1.0)
    a, b, c, d = values[j, i], values[j, i + 1], values[j + 1, i], values[j + 1, i + 1]
    upper = np.float64(a) + np.float64(b - a) * x
    lower = np.float64(c) + np.float64(d - c) * x
    return upper + (lower - upper) * y
