"""Rays through a site in which things move: each ray at its own instant, or a whole picture."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.simulator.balls import in_disc, projected, towards_ball
from civil_rgbd.simulator.motion import Floats, Mover, placed, unplaced
from civil_rgbd.simulator.scene import SKY, RayCaster, dots
from civil_rgbd.simulator.site import Site


@dataclass(frozen=True, slots=True, eq=False)
class Hits:
    """What rays meet first.

    Attributes:
        distances: (N,) float64 multiples of the ray's direction, 0 for sky.
        triangles: (N,) int32, numbered as :class:`Site` does, or :data:`SKY`.
        cosines: (N,) float64, 1 where a ray meets its surface head on, near 0 where it grazes.
    """

    distances: Floats
    triangles: NDArray[np.int32]
    cosines: Floats


class SiteCaster:
    """Finds what rays meet in a site: one Embree scene for what stands, one for each mover."""

    def __init__(self, site: Site, *, standing: RayCaster | None = None) -> None:
        self.site = site
        self.standing = standing or RayCaster(site.scene)
        self._moving = [
            _Moving(mover, RayCaster(mover.body), first)
            for mover, first in zip(site.movers, site.first_triangles, strict=True)
        ]

    def cast(self, origins_m: Floats, directions: Floats, t_s: Floats) -> Hits:
        """Return what each ray meets at its own instant, exactly.

        Args:
            origins_m: (N, 3) or (1, 3), scene frame.
            directions: (N, 3); the unit of the distance is their length.
            t_s: (N,) seconds since the walk began.
        """
        distances, triangles = self.standing.distances(origins_m, directions)
        facing = dots(self.site.scene.normals[triangles], directions)
        origins_m = np.broadcast_to(origins_m, directions.shape)
        length = np.sqrt(dots(directions, directions))
        for moving in self._moving:
            moving.cast(origins_m, directions, t_s, (distances, triangles, facing))
        cosines = np.where(triangles == SKY, 0.0, np.abs(facing) / length)
        return Hits(distances, triangles, cosines)

    def at(self, t_s: float) -> InstantCaster:
        """Return the rays of one instant, as a picture needs them."""
        return InstantCaster(self, t_s)

    def placed_bodies(self, t_s: float) -> list[PlacedBody]:
        """Return every mover where it is at one instant."""
        return [moving.placed_at(t_s) for moving in self._moving]


@dataclass(frozen=True, slots=True, eq=False)
class PlacedBody:
    """A mover at one instant.

    Attributes:
        first: number of its first triangle.
        caster: of its body, in its own frame.
        place_m: (1, 3).
        heading: (1, 2) cos and sin.
        middle_m: (3,) of its ball, scene frame.
        radius_m: of its ball.
    """

    first: int
    caster: RayCaster
    place_m: Floats
    heading: Floats
    middle_m: Floats
    radius_m: float

    def turned(self, vectors: Floats) -> Floats:
        """Turn (N, 3) vectors of its own frame into the scene's."""
        return placed(vectors, self.heading)

    def inside(self, points_m: Floats) -> Floats:
        """Move (N, 3) points of the scene into its own frame."""
        return unplaced(points_m - self.place_m, self.heading)


class _Moving:
    def __init__(self, mover: Mover, caster: RayCaster, first: int) -> None:
        self._mover, self._caster, self._first = mover, caster, first
        self._middle_m, self._radius_m = mover.sphere

    def placed_at(self, t_s: float) -> PlacedBody:
        place, heading = self._mover.motion.places(np.array([t_s]))
        middle = place[0] + placed(self._middle_m[np.newaxis], heading)[0]
        return PlacedBody(self._first, self._caster, place, heading, middle, self._radius_m)

    def cast(
        self,
        origins_m: Floats,
        directions: Floats,
        t_s: Floats,
        nearest: tuple[Floats, NDArray[np.int32], Floats],
    ) -> None:
        """Put this mover's hits in where they are nearer than what was found."""
        places, headings = self._mover.motion.places(t_s)
        middles = places + placed(np.broadcast_to(self._middle_m, places.shape), headings)
        maybe = np.flatnonzero(_near(middles - origins_m, directions, self._radius_m))
        if not len(maybe):
            return
        distances, triangles, facing = nearest
        inner = unplaced(directions[maybe], headings[maybe])
        start = unplaced(origins_m[maybe] - places[maybe], headings[maybe])
        found, hit = self._caster.distances(start, inner)
        before = triangles[maybe]
        nearer = (hit != SKY) & ((before == SKY) | (found < distances[maybe]))
        rows, hit = maybe[nearer], hit[nearer]
        distances[rows], triangles[rows] = found[nearer], hit + self._first
        facing[rows] = dots(self._caster.scene.normals[hit], inner[nearer])


def _near(towards_m: Floats, directions: Floats, radius_m: float) -> NDArray[np.bool_]:
    """Tell which rays come near a ball whose middle lies (N, 3) from their origins."""
    along, square = dots(towards_m, directions), dots(directions, directions)
    distance2 = dots(towards_m, towards_m)
    inside = distance2 <= radius_m**2
    return inside | ((along > 0) & (distance2 * square - along * along <= radius_m**2 * square))


_Plane = NDArray[np.float32]


def _components(points: _Plane, axis: _Plane) -> _Plane:
    along: _Plane = points[:, 0] * axis[0] + points[:, 1] * axis[1] + points[:, 2] * axis[2]
    return along


def _across(direction: _Plane) -> tuple[_Plane, _Plane]:
    """Return two unit vectors square to a direction and to each other."""
    x, y, z = direction.astype(np.float64).tolist()
    flat = math.hypot(x, y)
    if flat == 0:
        return np.array([1, 0, 0], dtype=np.float32), np.array([0, 1, 0], dtype=np.float32)
    length = math.sqrt(x * x + y * y + z * z)
    level = np.array([-y / flat, x / flat, 0.0])
    steep = np.array([-z * x / flat, -z * y / flat, flat]) / length
    return level.astype(np.float32), steep.astype(np.float32)


class InstantCaster:
    """The rays of one instant: movers stand where they are then.

    Attributes:
        normals: (T, 3) float64 unit, scene frame, of every triangle of the site.
        offsets_m: (T,) float64; a point p lies in the plane when normal . p equals it.
        bodies: the movers, placed.
    """

    def __init__(self, caster: SiteCaster, t_s: float) -> None:
        scene = caster.site.scene
        self._standing = caster.standing
        self.bodies = caster.placed_bodies(t_s)
        self.normals, self.offsets_m = scene.normals, scene.offsets_m
        if self.bodies:
            turned = [body.turned(body.caster.scene.normals) for body in self.bodies]
            offsets = [
                body.caster.scene.offsets_m + dots(normals, body.place_m)
                for body, normals in zip(self.bodies, turned, strict=True)
            ]
            self.normals = np.concatenate([self.normals, *turned])
            self.offsets_m = np.concatenate([self.offsets_m, *offsets])

    def nearest(
        self, origin_m: NDArray[np.float32], directions: NDArray[np.float32]
    ) -> NDArray[np.int32]:
        """Return the first triangle that each ray from one place meets.

        Args:
            origin_m: (1, 3), scene frame.
            directions: (N, 3), any length.

        Returns:
            (N,) int32, :data:`SKY` where a ray meets nothing.
        """
        triangles = self._standing.nearest(origin_m, directions)
        for body in self.bodies:
            maybe = towards_ball(directions, body.middle_m - origin_m[0], body.radius_m)
            if len(maybe):
                self._put_in(body, origin_m, directions[maybe], maybe, triangles)
        return triangles

    def _put_in(
        self,
        body: PlacedBody,
        origin_m: NDArray[np.float32],
        directions: NDArray[np.float32],
        rows: NDArray[np.intp],
        triangles: NDArray[np.int32],
    ) -> None:
        start = unplaced(origin_m - body.place_m, body.heading).astype(np.float32)
        turned = unplaced(directions.astype(np.float64), body.heading).astype(np.float32)
        hit = body.caster.nearest(start, np.ascontiguousarray(turned))
        met = hit != SKY
        rows, hit, directions = rows[met], hit[met] + body.first, directions[met]
        before = triangles[rows]
        nearer = (before == SKY) | (
            self._exact(hit, origin_m, directions) < self._exact(before, origin_m, directions)
        )
        triangles[rows[nearer]] = hit[nearer]

    def _exact(
        self,
        triangles: NDArray[np.int32],
        origin_m: NDArray[np.float32] | Floats,
        directions: NDArray[np.float32] | Floats,
    ) -> Floats:
        n = self.normals[triangles]
        above = self.offsets_m[triangles] - dots(n, origin_m.astype(np.float64))
        below = dots(n, directions.astype(np.float64))
        met = (triangles != SKY) & (below != 0)
        return np.where(met, above / np.where(met, below, 1.0), 0.0)

    def blocked(
        self, origins_m: NDArray[np.float32], direction: NDArray[np.float32]
    ) -> NDArray[np.bool_]:
        """Tell for (N, 3) points whether anything lies in the (3,) direction: (N,) bool."""
        hit = self._standing.blocked(origins_m, direction)
        if self.bodies and len(origins_m):
            # Seen along the direction, every ball is a disc.
            axes = np.stack(_across(direction))
            places, ends = projected(origins_m, axes)
            for body in self.bodies:
                disc = _components(axes, body.middle_m.astype(np.float32))
                maybe = in_disc(places, ends, disc, body.radius_m)
                maybe = maybe[~hit[maybe]]
                if len(maybe):
                    start = body.inside(origins_m[maybe].astype(np.float64)).astype(np.float32)
                    turned = unplaced(direction[np.newaxis].astype(np.float64), body.heading)
                    hit[maybe] = body.caster.blocked(start, turned[0].astype(np.float32))
        return hit

    def distances(self, origins_m: Floats, directions: Floats) -> tuple[Floats, NDArray[np.int32]]:
        """Return how far along each ray from one place the first surface lies, exactly.

        Args:
            origins_m: (1, 3) float64, scene frame.
            directions: (N, 3) float64; the unit of the distance is their length.

        Returns:
            (N,) float64 multiples of the direction, 0 for sky; (N,) int32 triangles.
        """
        triangles = self.nearest(
            origins_m.astype(np.float32), np.ascontiguousarray(directions, dtype=np.float32)
        )
        return self._exact(triangles, origins_m, directions), triangles
