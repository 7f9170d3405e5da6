"""From what each pixel's ray meets to the colour that the camera records."""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from civil_rgbd.simulator.light import SUN_LIGHT, FaceAxes, LightMap, bake, face_axes, openness
from civil_rgbd.simulator.scene import SKY, RayCaster, Scene, dots
from civil_rgbd.simulator.site import Site
from civil_rgbd.simulator.site_rays import InstantCaster, SiteCaster
from civil_rgbd.simulator.texture import (
    LEVELS,
    MATERIALS,
    STAIN_TEXEL_M,
    TILE_PX,
    Atlas,
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
_LIGHT_LEFT, _LIGHT_TOP, _LIGHT_U, _LIGHT_V, _MATERIAL, _GAIN = 15, 16, 17, 18, 19, 20
_COLUMNS = 21

Plane = NDArray[np.float32]


class Painter:
    """Paints pictures of one site; textures and light are worked out once."""

    def __init__(self, caster: RayCaster | SiteCaster) -> None:
        if isinstance(caster, RayCaster):
            caster = SiteCaster(Site(caster.scene), standing=caster)
        self._caster = caster
        self._light = bake(caster.standing)
        self._sun = np.asarray(caster.site.scene.sun)
        kinds = tuple(name for name in MATERIALS if name in set(caster.site.materials.tolist()))
        self._pictures = atlas(kinds)
        bodies = [mover.body for mover in caster.site.movers]
        self._axes = [face_axes(body.faces, seamless=True) for body in bodies]
        tables = [_face_table(caster.site.scene, self._light.axes, kinds)]
        tables += [
            _face_table(body, axes, kinds) for body, axes in zip(bodies, self._axes, strict=True)
        ]
        _light_up(tables, self._light, caster.site.scene)
        self._table = np.concatenate(tables, axis=1)

    def paint(
        self,
        rays: NDArray[np.float64],
        focal_px: float,
        T_scene_camera: NDArray[np.float64],
        rng: np.random.Generator | None = None,
        *,
        t_s: float = 0.0,
        exposure: float = 1.0,
    ) -> NDArray[np.uint8]:
        """Return the picture that a camera takes.

        Args:
            rays: (2, H, W) float64, X / Z and Y / Z of every pixel, optical frame.
            focal_px: pixels a radian, which decides how fine a texture must be.
            T_scene_camera: (4, 4).
            rng: of the sensor's noise; None for none.
            t_s: the instant, seconds since the walk began.
            exposure: 1 suits the scene; above it, pictures come out too bright.

        Returns:
            (H, W, 3) uint8, red green blue.
        """
        height, width = rays.shape[1:]
        flat = rays.reshape(2, -1).astype(np.float32)
        caster = self._caster.at(t_s)
        rows = self._seen_from(T_scene_camera[:3, 3], caster)
        picture = np.empty((height * width, 3), dtype=np.uint8)
        for start in range(0, height * width, _BLOCK_PX):
            block = slice(start, min(start + _BLOCK_PX, height * width))
            look = (caster, focal_px, T_scene_camera, np.float32(exposure))
            colour = self._block(flat[:, block], rows, look)
            if rng is not None:
                grain = rng.random(len(colour), dtype=np.float32)
                grain += rng.random(len(colour), dtype=np.float32)
                colour += (_SENSOR_NOISE * 2) * (grain - 1)[:, np.newaxis]
            np.clip(colour, 0, 255, out=colour)
            picture[block] = colour + np.float32(0.5)
        return picture.reshape(height, width, 3)

    def _seen_from(self, place_m: NDArray[np.float64], caster: InstantCaster) -> Plane:
        """Fill in the columns that depend on where the camera and the movers are."""
        scene, here = self._caster.site.scene, place_m[np.newaxis]
        rows = self._table.copy()
        rows[_DISTANCE] = caster.offsets_m - dots(caster.normals, here)
        standing = slice(0, len(scene.face_of_triangle))
        _put_coordinates(rows[:, standing], scene, self._light.axes, here)
        for body, axes in zip(caster.bodies, self._axes, strict=True):
            scene = body.caster.scene
            columns = slice(body.first, body.first + len(scene.face_of_triangle))
            own = rows[:, columns]
            _put_coordinates(own, scene, axes, body.inside(here))
            normals = caster.normals[columns]
            own[_N] = normals.T
            own[_ALONG] = body.turned(axes.along)[scene.face_of_triangle].T
            own[_UP] = body.turned(axes.up)[scene.face_of_triangle].T
            own[_SUNLIT] = np.maximum(dots(normals, self._sun[np.newaxis]), 0) * SUN_LIGHT
            own[_GAIN] = openness(self._caster.standing, body.middle_m, normals)
        return rows

    def _block(
        self,
        rays: Plane,
        table: Plane,
        look: tuple[InstantCaster, float, NDArray[np.float64], np.float32],
    ) -> Plane:
        caster, focal_px, T_scene_camera, exposure = look
        R, place = T_scene_camera[:3, :3].astype(np.float32), T_scene_camera[:3, 3]
        d = np.stack([R[i, 0] * rays[0] + R[i, 1] * rays[1] + R[i, 2] for i in range(3)])
        origin = place.astype(np.float32)
        triangles = caster.nearest(origin[np.newaxis], np.ascontiguousarray(d.T))
        rows = table.take(triangles, axis=1, mode="wrap")  # the sky's -1 wraps; it is painted over
        facing = _dots(rows[_N], d)
        length = np.sqrt(1 + rays[0] * rays[0] + rays[1] * rays[1])
        sky = triangles == SKY
        facing[sky] = -1
        t = rows[_DISTANCE] / facing
        u, v = rows[_U] + t * _dots(rows[_ALONG], d), rows[_V] + t * _dots(rows[_UP], d)
        blur_m = t / np.sqrt(np.maximum(np.abs(facing) / length, np.float32(0.02)))
        colour = _albedo(self._pictures, rows, (u, v), blur_m / np.float32(focal_px))
        colour *= self._daylight(rows, (u, v), (origin, d, t), caster=caster, sky=sky)
        colour *= exposure
        np.divide(colour, colour * np.float32(0.55) + 1, out=colour)  # bright parts saturate softly
        np.sqrt(colour, out=colour)
        colour *= np.float32(255 * 1.18)
        if sky.any():
            colour[sky] = _sky(d[:, sky] / length[sky]) * exposure
        return colour

    def _daylight(
        self,
        rows: Plane,
        uv: tuple[Plane, Plane],
        spots: tuple[Plane, Plane, Plane],
        *,
        caster: InstantCaster,
        sky: NDArray[np.bool_],
    ) -> Plane:
        """Return (N, 3): how much light of each colour falls on each spot."""
        u, v = uv
        around = _bilinear(
            self._light.light,
            rows[_LIGHT_LEFT] + u * rows[_LIGHT_U],
            rows[_LIGHT_TOP] + v * rows[_LIGHT_V],
        )
        around *= rows[_GAIN]
        sun = rows[_SUNLIT].copy()
        sun[sky] = 0
        towards = np.flatnonzero(sun > 0)
        origin, d, t = spots
        lift = np.float32(_LIFT_M) * rows[_N, towards]
        at = origin[:, np.newaxis] + t[towards] * d[:, towards] + lift
        sun[towards[caster.blocked(at.T, self._sun.astype(np.float32))]] = 0
        light = np.empty((len(u), 3), dtype=np.float32)
        for k in range(3):
            light[:, k] = np.float32(_SUN_TINT[k]) * sun + np.float32(_SKY_TINT[k]) * around
        light *= _EXPOSURE
        return light


def _dots(a: Plane, b: Plane) -> Plane:
    product: Plane = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    return product


def _face_table(scene: Scene, axes: FaceAxes, kinds: tuple[str, ...]) -> Plane:
    owner = scene.face_of_triangle
    material = np.array([kinds.index(face.material) for face in scene.faces])[owner]
    surfaces = [MATERIALS[name] for name in kinds]
    table = np.zeros((_COLUMNS, len(owner)), dtype=np.float32)
    table[_N] = scene.normals.T
    table[_ALONG], table[_UP] = axes.along[owner].T, axes.up[owner].T
    sun = np.asarray(scene.sun)[np.newaxis]
    table[_SUNLIT] = np.maximum(dots(scene.normals, sun), 0) * SUN_LIGHT
    table[_TEXELS] = np.array([TILE_PX / kind.tile_m for kind in surfaces])[material]
    table[_STAIN] = np.array([kind.stain for kind in surfaces])[material]
    table[_MATERIAL], table[_GAIN] = material, 1
    return table


def _light_up(tables: list[Plane], light: LightMap, scene: Scene) -> None:
    table, *moving = tables
    for body in moving:
        body[_LIGHT_TOP] = light.open_row_px
    owner = scene.face_of_triangle
    table[_LIGHT_LEFT], table[_LIGHT_TOP] = light.lefts_px[owner], light.tops_px[owner]
    table[_LIGHT_U], table[_LIGHT_V] = light.cells_per_m[owner].T


def _put_coordinates(
    rows: Plane, scene: Scene, axes: FaceAxes, here_m: NDArray[np.float64]
) -> None:
    owner = scene.face_of_triangle
    rows[_U] = (dots(axes.along, here_m) - axes.texture_m[:, 0])[owner]
    rows[_V] = (dots(axes.up, here_m) - axes.texture_m[:, 1])[owner]


def _albedo(pictures: Atlas, rows: Plane, uv: tuple[Plane, Plane], pixel_m: Plane) -> Plane:
    """Look textures up at plane coordinates (N,) metres, as coarse as (N,) metres a pixel asks."""
    u, v = uv
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
