"""From what each pixel's ray meets to the colour that the camera records."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.simulator.light import SUN_LIGHT, FaceAxes, LightMap, bake, face_axes, openness
from civil_rgbd.simulator.pixels import (
    ALONG,
    COLUMNS,
    DISTANCE,
    GAIN,
    LIGHT_LEFT,
    LIGHT_TOP,
    LIGHT_U,
    LIGHT_V,
    MATERIAL,
    STAIN,
    SUNLIT,
    TEXELS,
    UP,
    N,
    Pictures,
    Plane,
    U,
    V,
    aimed,
    coloured,
    places_met,
    recorded,
)
from civil_rgbd.simulator.scene import RayCaster, Scene, dots
from civil_rgbd.simulator.site import Site
from civil_rgbd.simulator.site_rays import InstantCaster, SiteCaster
from civil_rgbd.simulator.texture import MATERIALS, TILE_PX, atlas, sky_picture

_BLOCK_PX: Final = 25_600  # at a time: each step finds its input in the cache


_Look = tuple[InstantCaster, float, NDArray[np.float64], Pictures]


class Painter:
    """Paints pictures of one site; textures and light are worked out once."""

    def __init__(self, caster: RayCaster | SiteCaster) -> None:
        if isinstance(caster, RayCaster):
            caster = SiteCaster(Site(caster.scene), standing=caster)
        self._caster = caster
        kinds = tuple(name for name in MATERIALS if name in set(caster.site.materials.tolist()))
        with ThreadPoolExecutor(1) as beside:
            drawn = beside.submit(atlas, kinds)  # while the light is worked out
            self._light = bake(caster.standing)
            self._atlas = drawn.result()
        self._sun = np.asarray(caster.site.scene.sun)
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
        table = np.ascontiguousarray(self._seen_from(T_scene_camera[:3, 3], caster).T)
        pictures = Pictures(self._atlas, self._light.light, sky_picture(), exposure)
        look = (caster, focal_px, T_scene_camera, pictures)
        picture = np.empty((height * width, 3), dtype=np.uint8)
        for start in range(0, height * width, _BLOCK_PX):
            block = slice(start, min(start + _BLOCK_PX, height * width))
            rays_here = np.ascontiguousarray(flat[:, block])
            grain = np.empty((2, 0 if rng is None else rays_here.shape[1]), dtype=np.float32)
            if rng is not None:
                rng.random(dtype=np.float32, out=grain)
            picture[block] = recorded(self._block(rays_here, table, look), grain)
        return picture.reshape(height, width, 3)

    def _seen_from(self, place_m: NDArray[np.float64], caster: InstantCaster) -> Plane:
        """Fill in the columns that depend on where the camera and the movers are."""
        scene, here = self._caster.site.scene, place_m[np.newaxis]
        rows = self._table.copy()
        rows[DISTANCE] = caster.offsets_m - dots(caster.normals, here)
        standing = slice(0, len(scene.face_of_triangle))
        _put_coordinates(rows[:, standing], scene, self._light.axes, here)
        for body, axes in zip(caster.bodies, self._axes, strict=True):
            scene = body.caster.scene
            columns = slice(body.first, body.first + len(scene.face_of_triangle))
            own = rows[:, columns]
            _put_coordinates(own, scene, axes, body.inside(here))
            normals = caster.normals[columns]
            own[N] = normals.T
            own[ALONG] = body.turned(axes.along)[scene.face_of_triangle].T
            own[UP] = body.turned(axes.up)[scene.face_of_triangle].T
            own[SUNLIT] = np.maximum(dots(normals, self._sun[np.newaxis]), 0) * SUN_LIGHT
            own[GAIN] = openness(self._caster.standing, body.middle_m, normals)
        return rows

    def _block(self, rays: Plane, table: Plane, look: _Look) -> Plane:
        caster, focal_px, T_scene_camera, pictures = look
        directions = aimed(rays, T_scene_camera[:3, :3].astype(np.float32))
        origin = T_scene_camera[:3, 3].astype(np.float32)
        triangles = caster.nearest(origin[np.newaxis], directions)
        seen = (triangles, rays, directions)
        places, spots = places_met(table, seen, origin, focal_px)
        shaded = caster.blocked(spots, self._sun.astype(np.float32))
        return coloured(table, seen, places, shaded, pictures)


def _face_table(scene: Scene, axes: FaceAxes, kinds: tuple[str, ...]) -> Plane:
    owner = scene.face_of_triangle
    material = np.array([kinds.index(face.material) for face in scene.faces])[owner]
    surfaces = [MATERIALS[name] for name in kinds]
    table = np.zeros((COLUMNS, len(owner)), dtype=np.float32)
    table[N] = scene.normals.T
    table[ALONG], table[UP] = axes.along[owner].T, axes.up[owner].T
    sun = np.asarray(scene.sun)[np.newaxis]
    table[SUNLIT] = np.maximum(dots(scene.normals, sun), 0) * SUN_LIGHT
    table[TEXELS] = np.array([TILE_PX / kind.tile_m for kind in surfaces])[material]
    table[STAIN] = np.array([kind.stain for kind in surfaces])[material]
    table[MATERIAL], table[GAIN] = material, 1
    return table


def _light_up(tables: list[Plane], light: LightMap, scene: Scene) -> None:
    table, *moving = tables
    for body in moving:
        body[LIGHT_TOP] = light.open_row_px
    owner = scene.face_of_triangle
    table[LIGHT_LEFT], table[LIGHT_TOP] = light.lefts_px[owner], light.tops_px[owner]
    table[LIGHT_U], table[LIGHT_V] = light.cells_per_m[owner].T


def _put_coordinates(
    rows: Plane, scene: Scene, axes: FaceAxes, here_m: NDArray[np.float64]
) -> None:
    owner = scene.face_of_triangle
    rows[U] = (dots(axes.along, here_m) - axes.texture_m[:, 0])[owner]
    rows[V] = (dots(axes.up, here_m) - axes.texture_m[:, 1])[owner]
