"""A scene of plane faces, and the rays that meet it."""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import ArrayLike, NDArray

if TYPE_CHECKING:
    import trimesh

SKY: Final = -1
"""Triangle index of a ray that meets nothing."""

SUN: Final = (-0.42, -0.48, 0.77)
"""Where the sun stands unless a scene says otherwise."""

THREADS: Final = min(2, os.cpu_count() or 1)
"""So many cast rays at once: Embree, numba, OpenCV and most of numpy free the GIL."""

_HIDDEN = -1  # what Embree's occlusion query answers for a free ray


@dataclass(frozen=True, slots=True, eq=False)
class Face:
    """A plane convex polygon.

    Attributes:
        part: what it belongs to, such as ``girder``.
        material: key of :data:`civil_rgbd.simulator.texture.MATERIALS`.
        corners_m: (K, 3) float64, scene frame, anticlockwise as seen from outside.
    """

    part: str
    material: str
    corners_m: NDArray[np.float64]

    @property
    def normal(self) -> NDArray[np.float64]:
        """(3,) unit, pointing outside."""
        a, b, c = self.corners_m[:3, np.newaxis]
        unit: NDArray[np.float64] = unit_normals(a, b, c)[0]
        return unit


def unit_normals(
    a: NDArray[np.float64], b: NDArray[np.float64], c: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the unit normals (F, 3) of the planes through (F, 3) corners, anticlockwise."""
    n = np.cross(b - a, c - a)
    length = np.sqrt(n[:, 0] ** 2 + n[:, 1] ** 2 + n[:, 2] ** 2)
    return n / length[:, np.newaxis]


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """What stands around the walker. Frame: x along the walk, y to its left, z up; metres.

    Attributes:
        name: of the bridge.
        faces: all of them.
        dimensions_m: true lengths by name.
        sun: direction to the sun; length 1 within 0.1 %.
        seamless: textures run on from face to face of one plane, rather than begin at each.
        triangles_m: (T, 3, 3) float64, the faces cut into fans.
        face_of_triangle: (T,) int32.
        normals: (T, 3) float64, unit.
        offsets_m: (T,) float64; a point p lies in the plane when normal . p equals it.
    """

    name: str
    faces: tuple[Face, ...]
    dimensions_m: dict[str, float] = field(default_factory=dict)
    sun: tuple[float, float, float] = SUN
    seamless: bool = False
    triangles_m: NDArray[np.float64] = field(init=False)
    face_of_triangle: NDArray[np.int32] = field(init=False)
    normals: NDArray[np.float64] = field(init=False)
    offsets_m: NDArray[np.float64] = field(init=False)

    def __post_init__(self) -> None:
        fans = [
            (index, face.corners_m[[0, k, k + 1]])
            for index, face in enumerate(self.faces)
            for k in range(1, len(face.corners_m) - 1)
        ]
        owners = np.array([index for index, _ in fans], dtype=np.int32)
        first = np.stack([face.corners_m[:3] for face in self.faces])
        normals = unit_normals(first[:, 0], first[:, 1], first[:, 2])[owners]
        triangles = np.stack([triangle for _, triangle in fans])
        set_once = object.__setattr__  # frozen: derived fields are set here and never again
        set_once(self, "triangles_m", triangles)
        set_once(self, "face_of_triangle", owners)
        set_once(self, "normals", normals)
        set_once(self, "offsets_m", dots(normals, triangles[:, 0]))

    def mesh(self) -> trimesh.Trimesh:
        """Return the scene as one mesh, for export."""
        import trimesh

        vertices = self.triangles_m.reshape(-1, 3)
        return trimesh.Trimesh(vertices, np.arange(len(vertices)).reshape(-1, 3), process=False)


class RayCaster:
    """Finds what rays meet: Embree names the triangle, float64 gives the exact distance."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self._embree = EmbreeScene(robust=True)  # robust: no ray slips between two triangles
        TriangleMesh(self._embree, np.ascontiguousarray(scene.triangles_m, dtype=np.float32))

    def nearest(
        self, origins_m: NDArray[np.float32], directions: NDArray[np.float32]
    ) -> NDArray[np.int32]:
        """Return the first triangle that each ray meets.

        Args:
            origins_m: (N, 3) or (1, 3), scene frame.
            directions: (N, 3), any length.

        Returns:
            (N,) int32, :data:`SKY` where a ray meets nothing.
        """
        triangles: NDArray[np.int32] = self._embree.run(
            np.broadcast_to(origins_m, directions.shape), directions
        )
        return triangles

    def blocked(
        self, origins_m: NDArray[np.float32], direction: NDArray[np.float32]
    ) -> NDArray[np.bool_]:
        """Tell for (N, 3) points whether anything lies in the (3,) direction: (N,) bool."""
        directions = np.broadcast_to(direction, origins_m.shape)
        found = self._embree.run(np.ascontiguousarray(origins_m), directions, query="OCCLUDED")
        hit: NDArray[np.bool_] = found != _HIDDEN
        return hit

    def distances(
        self, origins_m: NDArray[np.float64], directions: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
        """Return how far along each ray the first surface lies, exactly.

        Args:
            origins_m: (N, 3) or (1, 3) float64, scene frame.
            directions: (N, 3) float64; the unit of the distance is their length.

        Returns:
            (N,) float64 multiples of the direction, 0 for sky; (N,) int32 triangles.
        """
        triangles = self.nearest(
            origins_m.astype(np.float32), np.ascontiguousarray(directions, dtype=np.float32)
        )
        n = self.scene.normals[triangles]
        above = self.scene.offsets_m[triangles] - dots(n, origins_m)
        below = dots(n, directions)
        met = (triangles != SKY) & (below != 0)
        return np.where(met, above / np.where(met, below, 1.0), 0.0), triangles


def dots(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the dot products of (N, 3) and (N, 3) or (1, 3) vectors: (N,), spelt out, no BLAS."""
    product: NDArray[np.float64] = a[:, 0] * b[:, 0] + a[:, 1] * b[:, 1] + a[:, 2] * b[:, 2]
    return product


def polygon(part: str, material: str, corners_m: ArrayLike) -> Face:
    """Return a face from its corners, anticlockwise as seen from outside."""
    return Face(part, material, np.asarray(corners_m, dtype=np.float64))


def prism(
    part: str, material: str, outline_m: ArrayLike, *, along: int, start_m: float, end_m: float
) -> list[Face]:
    """Extrude a convex outline along an axis.

    Args:
        part: what it belongs to.
        material: of all its faces.
        outline_m: (K, 2) corners in the other two axes, in cyclic order (y z, z x or x y),
            anticlockwise.
        along: 0, 1 or 2 for x, y or z.
        start_m: where it begins on that axis.
        end_m: where it ends, beyond ``start_m``.
    """
    outline = np.asarray(outline_m, dtype=np.float64)
    first, second = (along + 1) % 3, (along + 2) % 3

    def lifted(at_m: float) -> NDArray[np.float64]:
        corners = np.empty((len(outline), 3))
        corners[:, first], corners[:, second], corners[:, along] = *outline.T, at_m
        return corners

    low, high = lifted(start_m), lifted(end_m)
    sides = [
        np.stack([low[i], low[j], high[j], high[i]])
        for i, j in zip(range(len(outline)), [*range(1, len(outline)), 0], strict=True)
    ]
    return [Face(part, material, corners) for corners in (low[::-1], high, *sides)]


def box(part: str, material: str, low_m: Iterable[float], high_m: Iterable[float]) -> list[Face]:
    """Return the six faces of a box between two corners."""
    (x0, y0, z0), (x1, y1, z1) = low_m, high_m
    outline = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
    return prism(part, material, outline, along=2, start_m=z0, end_m=z1)
