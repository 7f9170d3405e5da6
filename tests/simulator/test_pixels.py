"""Compiled passes against slow twins: numpy, and OpenCV's lookup in whole numbers."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from civil_rgbd.simulator import pixels
from civil_rgbd.simulator.pixels import (
    Pictures,
    aimed,
    coloured,
    places_met,
    recorded,
)
from civil_rgbd.simulator.scene import SKY
from civil_rgbd.simulator.texture import LEVELS, STAIN_TEXEL_M, TILE_PX, atlas, sky_picture

Plane = NDArray[np.float32]
_F = np.float32

COUNT = 4000
FOCAL_PX, EXPOSURE = 600.0, 1.2
PICTURES = Pictures(
    atlas(("wall", "grass", "sign")),
    np.random.default_rng(4).random((40, 50), dtype=np.float32),
    sky_picture(),
    EXPOSURE,
)
ORIGIN = np.array([1.5, -2.0, 1.6], dtype=np.float32)


def _table(count: int) -> Plane:
    rng = np.random.default_rng(1)
    table = np.zeros((count, pixels.COLUMNS), dtype=np.float32)
    table[:, :9] = rng.standard_normal((count, 9))
    table[:, pixels.DISTANCE] = rng.uniform(-9, 9, count)
    table[:, pixels.U] = rng.uniform(-20, 20, count)
    table[:, pixels.V] = rng.uniform(-20, 20, count)
    table[:, pixels.SUNLIT] = np.maximum(rng.uniform(-1, 1.6, count), 0)
    table[:, pixels.TEXELS] = rng.uniform(100, 400, count)
    table[:, pixels.STAIN] = rng.uniform(0, 1, count)
    table[:, pixels.LIGHT_LEFT] = rng.uniform(5, 30, count)
    table[:, pixels.LIGHT_TOP] = rng.uniform(5, 30, count)
    table[:, pixels.LIGHT_U : pixels.LIGHT_V + 1] = rng.uniform(0, 2, (count, 2))
    table[:, pixels.MATERIAL] = rng.integers(0, 3, count)
    table[:, pixels.GAIN] = rng.uniform(0.5, 1, count)
    return table


def _look() -> tuple[Plane, tuple[NDArray[np.int32], Plane, Plane]]:
    rng = np.random.default_rng(2)
    rays = rng.uniform(-1, 1, (2, COUNT)).astype(np.float32)
    R = rng.uniform(-1, 1, (3, 3)).astype(np.float32)
    triangles = rng.integers(SKY, 60, COUNT).astype(np.int32)
    triangles[:300] = SKY
    return _table(60), (triangles, rays, aimed(rays, R))


def _lookup(picture: NDArray[np.uint8], columns: Plane, lines: Plane) -> Plane:
    column, line = ((at * _F(32) + _F(0.5)).astype(np.int32) for at in (columns, lines))
    whole = np.stack([column >> 5, line >> 5], axis=1)[np.newaxis].astype(np.int16)
    parts = ((line & 31) << 5) + (column & 31)
    found = cv2.remap(picture, whole, parts.astype(np.uint16)[np.newaxis], cv2.INTER_LINEAR)
    return found[0].astype(np.float32)


def _bilinear(values: Plane, columns: Plane, lines: Plane) -> NDArray[np.float64]:
    height, width = values.shape
    i = np.clip(columns, 0, width - _F(1.001)).astype(np.intp)
    j = np.clip(lines, 0, height - _F(1.001)).astype(np.intp)
    x, y = np.clip(columns - i, 0, 1), np.clip(lines - j, 0, 1)
    upper = values[j, i] + (values[j, i + 1] - values[j, i]) * x
    lower = values[j + 1, i] + (values[j + 1, i + 1] - values[j + 1, i]) * x
    between: NDArray[np.float64] = upper + (lower - upper) * y
    return between


def _rest(at: Plane) -> Plane:
    rest: Plane = at - np.floor(at / _F(TILE_PX)) * _F(TILE_PX)
    return rest


def _twin_places(
    table: Plane, triangles: NDArray[np.int32], rays: Plane, d: Plane
) -> tuple[Plane, Plane]:
    rows, (x, y, z) = table[triangles].T, d.T
    facing = rows[0] * x + rows[1] * y + rows[2] * z
    t = rows[pixels.DISTANCE] / facing
    u = rows[pixels.U] + t * (rows[3] * x + rows[4] * y + rows[5] * z)
    v = rows[pixels.V] + t * (rows[6] * x + rows[7] * y + rows[8] * z)
    length = np.sqrt(1 + rays[0] * rays[0] + rays[1] * rays[1])
    blur_m = t / np.sqrt(np.maximum(np.abs(facing) / length, _F(0.02)))
    spots = ORIGIN[:, np.newaxis] + t * d.T + _F(3e-3) * rows[:3]
    lit = (triangles != SKY) & (rows[pixels.SUNLIT] > 0)
    return np.stack([u, v, blur_m / _F(FOCAL_PX)]), spots[:, lit].T


def _twin_albedo(rows: Plane, u: Plane, v: Plane, width_m: Plane) -> Plane:
    pictures = PICTURES.atlas
    _, level = np.frexp(np.maximum(width_m * rows[pixels.TEXELS], _F(0.5)))
    level = np.clip(level - 1, 0, LEVELS - 1)
    kind, shrink = rows[pixels.MATERIAL].astype(np.intp), np.ldexp(_F(1), -level)
    columns = _rest(u * rows[pixels.TEXELS]) * shrink - _F(0.5) + pictures.lefts_px[kind, level]
    lines = _rest(v * rows[pixels.TEXELS]) * shrink - _F(0.5) + pictures.tops_px[kind, level]
    texels = _lookup(pictures.albedo, columns, lines) * _F(1 / 255)
    across, down = u * _F(1 / STAIN_TEXEL_M), v * _F(1 / STAIN_TEXEL_M)
    stain = _lookup(pictures.stain, _rest(across) + _F(0.5), _rest(down) + _F(0.5))
    factor = 1 + rows[pixels.STAIN] * (stain * _F(1 / 128) - 1)
    return texels * texels * factor[:, np.newaxis]


def _twin_sky(directions: Plane) -> Plane:
    height = np.maximum(directions[2], 0)
    scale = _F(0.16 * TILE_PX) / (height + _F(0.22))
    at = (directions[k] * scale + _F(TILE_PX / 2) for k in (0, 1))
    white = np.maximum(_bilinear(PICTURES.sky, *at), 1 - np.sqrt(height) * _F(0.95))
    blues = (_F(blue) for blue in (0.50, 0.68, 0.95))
    colours = [238 * (blue + (1 - blue) * white) for blue in blues]
    return np.stack(colours, axis=1).astype(np.float32) * _F(EXPOSURE)


def _twin_colours(
    table: Plane, triangles: NDArray[np.int32], rays: Plane, d: Plane, shaded: NDArray[np.bool_]
) -> Plane:
    rows = table[triangles].T
    (u, v, width_m), _ = _twin_places(table, triangles, rays, d)
    sun = np.where(triangles == SKY, _F(0), rows[pixels.SUNLIT])
    sun[np.flatnonzero(sun > 0)[shaded]] = 0
    left = rows[pixels.LIGHT_LEFT] + u * rows[pixels.LIGHT_U]
    top = rows[pixels.LIGHT_TOP] + v * rows[pixels.LIGHT_V]
    around = _bilinear(PICTURES.light, left, top) * rows[pixels.GAIN]
    tints = ((1.06, 0.94), (1.0, 1.0), (0.90, 1.08))
    light = np.stack([_F(a) * sun + _F(b) * around for a, b in tints], axis=1).astype(np.float32)
    colour = _twin_albedo(rows, u, v, width_m) * (light * _F(1.15)) * _F(EXPOSURE)
    colour = np.sqrt(colour / (colour * _F(0.55) + 1)) * _F(255 * 1.18)
    sky = triangles == SKY
    length = np.sqrt(1 + rays[0] * rays[0] + rays[1] * rays[1])
    colour[sky] = _twin_sky(d.T[:, sky] / length[sky])
    return colour


def test_rays_meet_where_numpy_says() -> None:
    table, (triangles, rays, directions) = _look()

    places, spots = places_met(table, (triangles, rays, directions), ORIGIN, FOCAL_PX)

    expected, lit = _twin_places(table, triangles, rays, directions)
    met = triangles != SKY
    assert places[:, met].tobytes() == expected[:, met].tobytes()
    assert spots.tobytes() == np.ascontiguousarray(lit).tobytes()


def test_every_bit_of_the_colours_is_what_numpy_and_opencv_make_of_them() -> None:
    table, seen = _look()
    places, spots = places_met(table, seen, ORIGIN, FOCAL_PX)
    shaded = np.random.default_rng(5).random(len(spots)) < 0.3

    colours = coloured(table, seen, places, shaded, PICTURES)

    assert colours.tobytes() == _twin_colours(table, *seen, shaded).tobytes()
    assert 0 < np.count_nonzero(shaded) < len(shaded)


def test_a_ray_within_its_triangles_plane_does_no_harm() -> None:
    table = _table(1)
    table[0, :3] = 0, 0, 1
    rays = np.zeros((2, 1), dtype=np.float32)
    seen = (np.zeros(1, dtype=np.int32), rays, np.array([[1, 0, 0]], dtype=np.float32))

    places, spots = places_met(table, seen, ORIGIN, FOCAL_PX)

    shaded = np.zeros(len(spots), dtype=np.bool_)
    assert coloured(table, seen, places, shaded, PICTURES).shape == (1, 3)


def test_grain_is_added_and_greys_are_clipped() -> None:
    values = np.array([[-3, 0, 100], [100.4, 254.9, 300]], dtype=np.float32)
    grain = np.array([[1, 0], [1, 0]], dtype=np.float32)

    assert recorded(values, np.empty((2, 0), dtype=np.float32)).tolist() == [
        [0, 0, 100],
        [100, 255, 255],
    ]
    assert recorded(values, grain).tolist() == [[0, 3, 103], [97, 252, 255]]
