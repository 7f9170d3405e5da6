"""From what each pixel's ray meets to the colour that the camera records."""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from civil_rgbd.simulator.light import SUN, SUN_LIGHT, LightMap, bake
from civil_rgbd.simulator.scene import SKY, RayCaster, dots
from civil_rgbd.simulator.texture import (
    LEVELS,
    MATERIALS,
    STAIN_TEXEL_M,
    TILE_PX,
    atlas,
    sky_picture,
)

_BLOCK_PX: Final = (
    25_600  # at a time: steps find their input in the cache; cv2.remap takes < 32,768
)
_EXPOSURE: Final = np.float32(1.15)
_SUN_TINT: Final = (1.06, 1.0, 0.90)
_SKY_TINT: Final = (0.94, 1.0, 1.08)
_SKY_BLUE: Final = (0.50, 0.68, 0.95)
_SENSOR_NOISE: Final = np.float32(1.6)  # grey values
_TEXEL_BITS: Final = 5  # cv2.remap's own: a texel has 32 parts
_LIFT_M: Final = 3e-3  # shadow rays start this far off the surface

# Rows of the table that says for each triangle how it is painted.
_N, _ALONG, _UP = slice(0, 3), slice(3, 6), slice(6, 9)
_DISTANCE, _U, _V, _SUNLIT, _TEXELS, _STAIN = 9, 10, 11, 12, 13, 14
_LIGHT_LEFT, _LIGHT_TOP, _LIGHT_U, _LIGHT_V, _MATERIAL = 15, 16, 17, 18, 19
_COLUMNS = 20

Plane = NDArray[np.float32]


class Painter:
    """Paints pictures of one scene; textures and light are worked out once."""

    def __init__(self, caster: RayCaster) -> None:
        self._caster = caster
        self._light = bake(caster)
        self._table = _face_table(caster, self._light)

    def paint(
        self,
        rays: NDArray[np.float64],
        focal_px: float,
        T_scene_camera: NDArray[np.float64],
        rng: np.random.Generator | None = None,
    ) -> NDArray[np.uint8]:
        """Return the picture that a camera takes.

        Args:
            rays: (2, H, W) float64, X / Z and Y / Z of every pixel, optical frame.
            focal_px: pixels a radian, which decides how fine a texture must be.
            T_scene_camera: (4, 4).
            rng: of the sensor's noise; None for none.

        Returns:
            (H, W, 3) uint8, red green blue.
        """
        height, width = rays.shape[1:]
        flat = rays.reshape(2, -1).astype(np.float32)
        rows = self._seen_from(T_scene_camera[:3, 3])
        picture = np.empty((height * width, 3), dtype=np.uint8)
        for start in range(0, height * width, _BLOCK_PX):
            block = slice(start, min(start + _BLOCK_PX, height * width))
            colour = self._block(flat[:, block], focal_px, T_scene_camera, rows)
            if rng is not None:
                grain = rng.random(len(colour), dtype=np.float32)
                grain += rng.random(len(colour), dtype=np.float32)
                colour += (_SENSOR_NOISE * 2) * (grain - 1)[:, np.newaxis]
            np.clip(colour, 0, 255, out=colour)
            picture[block] = colour + np.float32(0.5)
        return picture.reshape(height, width, 3)

    def _seen_from(self, place_m: NDArray[np.float64]) -> Plane:
        """Fill in the columns that depend on where the camera is."""
        scene, axes = self._caster.scene, self._light.axes
        owner, here = scene.face_of_triangle, place_m[np.newaxis]
        rows = self._table.copy()
        rows[_DISTANCE] = scene.offsets_m - dots(scene.normals, here)
        rows[_U] = (dots(axes.along, here) - axes.low_m[:, 0])[owner]
        rows[_V] = (dots(axes.up, here) - axes.low_m[:, 1])[owner]
        return rows

    def _block(
        self, rays: Plane, focal_px: float, T_scene_camera: NDArray[np.float64], table: Plane
    ) -> Plane:
        R, place = T_scene_camera[:3, :3].astype(np.float32), T_scene_camera[:3, 3]
        d = np.stack([R[i, 0] * rays[0] + R[i, 1] * rays[1] + R[i, 2] for i in range(3)])
        origin = place.astype(np.float32)
        triangles = self._caster.nearest(origin[np.newaxis], np.ascontiguousarray(d.T))
        rows = table.take(triangles, axis=1, mode="wrap")  # the sky's -1 wraps; it is painted over
        facing = _dots(rows[_N], d)
        length = np.sqrt(1 + rays[0] * rays[0] + rays[1] * rays[1])
        sky = triangles == SKY
        facing[sky] = -1
        t = rows[_DISTANCE] / facing
        u, v = rows[_U] + t * _dots(rows[_ALONG], d), rows[_V] + t * _dots(rows[_UP], d)
        blur_m = t / np.sqrt(np.maximum(np.abs(facing) / length, np.float32(0.02)))
        colour = _albedo(rows, u, v, blur_m / np.float32(focal_px))
        colour *= self._daylight(rows, u, v, spots=(origin, d, t), sky=sky)
        np.divide(colour, colour * np.float32(0.55) + 1, out=colour)  # bright parts saturate softly
        np.sqrt(colour, out=colour)
        colour *= np.float32(255 * 1.18)
        if sky.any():
            colour[sky] = _sky(d[:, sky] / length[sky])
        return colour

    def _daylight(
        self,
        rows: Plane,
        u: Plane,
        v: Plane,
        *,
        spots: tuple[Plane, Plane, Plane],
        sky: NDArray[np.bool_],
    ) -> Plane:
        """Return (N, 3): how much light of each colour falls on each spot."""
        around = _bilinear(
            self._light.light,
            rows[_LIGHT_LEFT] + u * rows[_LIGHT_U],
            rows[_LIGHT_TOP] + v * rows[_LIGHT_V],
        )
        sun = rows[_SUNLIT].copy()
        sun[sky] = 0
        towards = np.flatnonzero(sun > 0)
        origin, d, t = spots
        lift = np.float32(_LIFT_M) * rows[_N, towards]
        at = origin[:, np.newaxis] + t[towards] * d[:, towards] + lift
        sun[towards[self._caster.blocked(at.T, SUN.astype(np.float32))]] = 0
        light = np.empty((len(u), 3), dtype=np.float32)
        for k in range(3):
            light[:, k] = np.float32(_SUN_TINT[k]) * sun + np.float32(_SKY_TINT[k]) * around
        light *= _EXPOSURE
        return light


def _dots(a: Plane, b: Plane) -> Plane:
    product: Plane = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    return product


def _face_table(caster: RayCaster, light: LightMap) -> Plane:
    scene, names = caster.scene, list(MATERIALS)
    owner = scene.face_of_triangle
    material = np.array([names.index(face.material) for face in scene.faces])[owner]
    kinds = [MATERIALS[name] for name in names]
    table = np.zeros((_COLUMNS, len(owner)), dtype=np.float32)
    table[_N] = scene.normals.T
    table[_ALONG], table[_UP] = light.axes.along[owner].T, light.axes.up[owner].T
    table[_SUNLIT] = np.maximum(dots(scene.normals, SUN[np.newaxis]), 0) * SUN_LIGHT
    table[_TEXELS] = np.array([TILE_PX / kind.tile_m for kind in kinds])[material]
    table[_STAIN] = np.array([kind.stain for kind in kinds])[material]
    table[_LIGHT_LEFT], table[_LIGHT_TOP] = light.lefts_px[owner], light.tops_px[owner]
    table[_LIGHT_U], table[_LIGHT_V] = light.cells_per_m[owner].T
    table[_MATERIAL] = material
    return table


def _albedo(rows: Plane, u: Plane, v: Plane, pixel_m: Plane) -> Plane:
    """Look textures up at plane coordinates (N,) metres, as coarse as (N,) metres a pixel asks."""
    pictures = atlas()
    across, down = u * rows[_TEXELS], v * rows[_TEXELS]
    # frexp: the power of two above; the level whose texel is at most a pixel wide.
    _, level = np.frexp(np.maximum(pixel_m * rows[_TEXELS], np.float32(0.5)))
    level = np.clip(level - 1, 0, LEVELS - 1)
    kind = rows[_MATERIAL].astype(np.intp)
    size = np.float32(TILE_PX)
    shrink = np.ldexp(np.float32(1), -level)
    columns = (across - np.floor(across / size) * size) * shrink - np.float32(0.5)
    lines = (down - np.floor(down / size) * size) * shrink - np.float32(0.5)
    texels = _lookup(
        pictures.albedo,
        columns + pictures.lefts_px[kind, level],
        lines + pictures.tops_px[kind, level],
    ).astype(np.float32)
    texels *= np.float32(1 / 255)
    texels *= texels  # stored as square roots
    across, down = u * np.float32(1 / STAIN_TEXEL_M), v * np.float32(1 / STAIN_TEXEL_M)
    stain = _lookup(
        pictures.stain,
        across - np.floor(across / size) * size + np.float32(0.5),
        down - np.floor(down / size) * size + np.float32(0.5),
    ).astype(np.float32)
    texels *= (1 + rows[_STAIN] * (stain * np.float32(1 / 128) - 1))[:, np.newaxis]
    return texels


def _lookup(picture: NDArray[np.uint8], columns: Plane, lines: Plane) -> NDArray[np.uint8]:
    # In fixed point, which OpenCV interpolates in whole numbers: the same on every processor.
    column, line = (
        (places * np.float32(1 << _TEXEL_BITS) + np.float32(0.5)).astype(np.int32)
        for places in (columns, lines)
    )
    whole = np.empty((1, len(columns), 2), dtype=np.int16)
    whole[0, :, 0], whole[0, :, 1] = column >> _TEXEL_BITS, line >> _TEXEL_BITS
    mask = (1 << _TEXEL_BITS) - 1
    parts = ((line & mask) << _TEXEL_BITS) + (column & mask)
    found = cv2.remap(picture, whole, parts.astype(np.uint16)[np.newaxis], cv2.INTER_LINEAR)
    texels: NDArray[np.uint8] = found[0]
    return texels


def _bilinear(values: Plane, columns: Plane, lines: Plane) -> Plane:
    # In numpy: OpenCV interpolates floats with other last bits on other processors.
    height, width = values.shape
    i = np.clip(columns, 0, width - np.float32(1.001)).astype(np.intp)
    j = np.clip(lines, 0, height - np.float32(1.001)).astype(np.intp)
    x, y = np.clip(columns - i, 0, 1), np.clip(lines - j, 0, 1)
    flat, at = values.ravel(), j * width + i
    upper = flat[at] + (flat[at + 1] - flat[at]) * x
    lower = flat[at + width] + (flat[at + width + 1] - flat[at + width]) * x
    between: Plane = upper + (lower - upper) * y
    return between


def _sky(directions: Plane) -> Plane:
    """Return (N, 3) grey values for (3, N) unit directions: haze below, blue above, clouds."""
    height = np.maximum(directions[2], 0)
    scale = np.float32(0.16 * TILE_PX) / (height + np.float32(0.22))
    veil = _bilinear(
        sky_picture(),
        directions[0] * scale + np.float32(TILE_PX / 2),
        directions[1] * scale + np.float32(TILE_PX / 2),
    )
    haze = 1 - np.sqrt(height) * np.float32(0.95)
    white = np.maximum(veil, haze)
    colour = np.empty((len(height), 3), dtype=np.float32)
    for k in range(3):
        blue = np.float32(_SKY_BLUE[k])
        colour[:, k] = 238 * (blue + (1 - blue) * white)
    return colour
