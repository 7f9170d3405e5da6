"""Rigid things that move: where each is at any instant, in closed form."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.simulator.scene import Scene
from civil_rgbd.simulator.waves import cosine, sine

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Drive:
    """Straight on at one speed, along a stretch that begins anew when it ends.

    Attributes:
        middle_m: of the stretch, x y z.
        heading: (cos, sin) of the direction, from x towards y.
        speed_m_s: along it.
        stretch_m: its length; whoever reaches the end appears at the beginning.
        phase_m: how far along the stretch it is at time 0.
    """

    middle_m: tuple[float, float, float]
    heading: tuple[float, float]
    speed_m_s: float
    stretch_m: float
    phase_m: float

    def places(self, t_s: Floats) -> tuple[Floats, Floats]:
        """Return places (N, 3) metres and headings (N, 2), cos and sin, at (N,) seconds."""
        run = self.phase_m + self.speed_m_s * t_s
        run = run - np.floor(run / self.stretch_m) * self.stretch_m - self.stretch_m / 2
        x, y, z = self.middle_m
        cos, sin = self.heading
        places = np.stack([x + run * cos, y + run * sin, np.full(len(run), z)], axis=1)
        return places, np.broadcast_to(np.array([cos, sin]), (len(run), 2))


@dataclass(frozen=True, slots=True)
class Stroll:
    """Round and round an ellipse whose axes are x and y, facing where one goes.

    Attributes:
        middle_m: of the ellipse, x y z.
        half_x_m: half its length along x.
        half_y_m: half its length along y; below 0 one goes clockwise.
        turns_per_s: times round it a second.
        phase_turns: where one is at time 0.
    """

    middle_m: tuple[float, float, float]
    half_x_m: float
    half_y_m: float
    turns_per_s: float
    phase_turns: float

    def places(self, t_s: Floats) -> tuple[Floats, Floats]:
        """Return places (N, 3) metres and headings (N, 2), cos and sin, at (N,) seconds."""
        turns = self.phase_turns + self.turns_per_s * t_s
        cos, sin = cosine(turns), sine(turns)
        x, y, z = self.middle_m
        places = np.stack(
            [x + self.half_x_m * cos, y + self.half_y_m * sin, np.full(len(cos), z)], axis=1
        )
        headings = np.stack([-self.half_x_m * sin, self.half_y_m * cos], axis=1)
        length = np.sqrt(headings[:, 0] ** 2 + headings[:, 1] ** 2)
        return places, headings / length[:, np.newaxis]


@dataclass(frozen=True, slots=True, eq=False)
class Mover:
    """A rigid thing and its motion.

    Attributes:
        name: unique in its site, such as ``car-2``.
        body: its faces, in its own frame: x ahead, y left, z up, origin on the ground below it.
        motion: of that frame in the scene.
    """

    name: str
    body: Scene
    motion: Drive | Stroll

    @property
    def sphere(self) -> tuple[Floats, float]:
        """Middle (3,) in its own frame, and radius, of a ball that holds it."""
        corners = self.body.triangles_m.reshape(-1, 3)
        middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
        return middle, math.sqrt(float(((corners - middle) ** 2).sum(axis=1).max())) + 1e-6


def placed(vectors: Floats, headings: Floats) -> Floats:
    """Turn (N, 3) vectors of a mover's frame into the scene's, by (N, 2) or (1, 2) headings."""
    cos, sin = headings[:, 0], headings[:, 1]
    x, y = vectors[:, 0], vectors[:, 1]
    return np.stack([cos * x - sin * y, sin * x + cos * y, vectors[:, 2]], axis=1)


def unplaced(vectors: Floats, headings: Floats) -> Floats:
    """Turn (N, 3) vectors of the scene's frame into a mover's, by (N, 2) or (1, 2) headings."""
    return placed(vectors, headings * np.array([1.0, -1.0]))
