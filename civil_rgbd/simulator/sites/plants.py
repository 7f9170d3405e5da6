"""Trees, bushes, tufts and ivy: many small leaves, each a triangle that faces the sun."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from civil_rgbd.simulator.scene import Face
from civil_rgbd.simulator.sites.draft import Draft, octagon
from civil_rgbd.simulator.waves import cosine, sine

Sun = tuple[float, float, float]


def leaves(
    rng: np.random.Generator,
    spots_m: NDArray[np.float64],
    *,
    size_m: float,
    sun: Sun,
) -> list[Face]:
    """Return a leaf at each of (N, 3) spots, turned at random; its lit side faces the sun."""
    count = len(spots_m)
    a, b = rng.normal(size=(2, count, 3))
    # Spelt out, as libraries' sums may differ in the last bit.
    a /= np.sqrt(a[:, 0] ** 2 + a[:, 1] ** 2 + a[:, 2] ** 2)[:, np.newaxis]
    along = a[:, 0] * b[:, 0] + a[:, 1] * b[:, 1] + a[:, 2] * b[:, 2]
    b = b - along[:, np.newaxis] * a
    b /= np.sqrt(b[:, 0] ** 2 + b[:, 1] ** 2 + b[:, 2] ** 2)[:, np.newaxis]
    n = np.cross(a, b)
    away = n[:, 0] * sun[0] + n[:, 1] * sun[1] + n[:, 2] * sun[2] < 0
    b[away] *= -1
    size = size_m * rng.uniform(0.6, 1.3, (count, 1))
    corners = np.stack(
        [spots_m - a * size * 0.5 - b * size * 0.4, spots_m + a * size * 0.6,
         spots_m - a * size * 0.3 + b * size * 0.6], axis=1,
    )  # fmt: skip
    return [Face("plant", "leaf", leaf) for leaf in corners]


def _in_ball(rng: np.random.Generator, count: int, *, hollow: float) -> NDArray[np.float64]:
    v = rng.normal(size=(count, 3))
    v /= np.sqrt(v[:, 0] ** 2 + v[:, 1] ** 2 + v[:, 2] ** 2)[:, np.newaxis]
    return v * rng.uniform(hollow, 1.0, (count, 1))


def put_bush(
    draft: Draft, rng: np.random.Generator, place_m: ArrayLike, *, radius_m: float, sun: Sun
) -> None:
    """Put a bush on the ground: a dark heart, leaves all about it."""
    place = np.asarray(place_m, dtype=np.float64)
    radii = radius_m * rng.uniform(0.8, 1.2, 3)
    draft.add(
        _crown(place - np.array([0, 0, 0.05]), radii * [0.75, 0.75, 0.8], "bush", rings=_BUSH)
    )
    spots = _in_ball(rng, 150, hollow=0.7) * radii + place + [0, 0, radii[2] * 0.75]
    spots = spots[spots[:, 2] > place[2] + 0.03]
    draft.add(leaves(rng, spots, size_m=0.11 + 0.06 * radius_m, sun=sun))


def put_tree(
    draft: Draft, rng: np.random.Generator, place_m: ArrayLike, *, sun: Sun, near: bool
) -> None:
    """Put a tree up; a near one has more and smaller leaves."""
    place = np.asarray(place_m, dtype=np.float64)
    height = rng.uniform(2.2, 3.4)
    radii = np.array([1.0, 1.0, 1.15]) * rng.uniform(1.6, 2.8)
    x, y, z = place.tolist()
    trunk = (z - 0.2, z + height + float(radii[2]) * 0.4)
    draft.column("tree", "bark", (x, y), radius_m=rng.uniform(0.12, 0.24), z_m=trunk)
    draft.add(_crown(place + np.array([0, 0, height]), radii * 0.85, "bush", rings=_TREE))
    count, size = (420, 0.3) if near else (110, 0.6)
    spots = _in_ball(rng, count, hollow=0.72) * radii + place + [0, 0, height + radii[2] * 0.8]
    draft.add(leaves(rng, spots, size_m=size, sun=sun))


def put_far_trees(draft: Draft, rng: np.random.Generator, *, gap_y_m: float) -> None:
    """Ring the ground with woods, but for a gap along x so many metres to both sides of y = 0."""
    for turn in (np.arange(110) + rng.uniform(0, 0.8, 110)) / 110:
        far = rng.uniform(100, 145)
        x, y = far * cosine(np.array([turn]))[0], far * sine(np.array([turn]))[0]
        size = np.array([1.0, 1.0, 1.2]) * rng.uniform(3.5, 6.5)
        if abs(y) > gap_y_m + 8:
            draft.add(_crown(np.array([x, y, -0.5]), size, "foliage", rings=_TREE))


def put_tufts(
    draft: Draft, rng: np.random.Generator, places_m: NDArray[np.float64], *, sun: Sun
) -> None:
    """Put tufts of long grass down at (N, 3) places."""
    feet = np.repeat(places_m, 7, axis=0) + rng.normal(0, 0.05, (7 * len(places_m), 3)) * [1, 1, 0]
    lean, height = rng.normal(0, 0.08, feet.shape) * [1, 1, 0], rng.uniform(0.15, 0.4, len(feet))
    turn = rng.normal(size=(len(feet), 2))
    turn *= (0.015 / np.sqrt(turn[:, 0] ** 2 + turn[:, 1] ** 2))[:, np.newaxis]
    side = np.stack([turn[:, 0], turn[:, 1], np.zeros(len(feet))], axis=1)
    tips = feet + lean + np.stack([np.zeros(len(feet)), np.zeros(len(feet)), height], axis=1)
    for foot, across, tip in zip(feet, side, tips, strict=True):
        blade = np.stack([foot - across, foot + across, tip])
        n = np.cross(blade[1] - blade[0], blade[2] - blade[0])
        lit = n[0] * sun[0] + n[1] * sun[1] + n[2] * sun[2] >= 0
        draft.add([Face("plant", "leaf", blade if lit else blade[::-1])])


def put_ivy(
    draft: Draft, rng: np.random.Generator, spots_m: NDArray[np.float64], *, sun: Sun
) -> None:
    """Let ivy leaves hang at (N, 3) spots, such as just off a wall."""
    draft.add(leaves(rng, spots_m, size_m=0.12, sun=sun))


_TREE = ((0.45, 0.0), (0.95, 0.45), (0.9, 1.1), (0.4, 1.65))
_BUSH = ((0.7, 0.0), (1.0, 0.5), (0.8, 1.2), (0.4, 1.6))


def _crown(
    foot_m: NDArray[np.float64],
    size_m: NDArray[np.float64],
    material: str,
    *,
    rings: tuple[tuple[float, float], ...],
) -> list[Face]:
    stack = [
        np.stack([*(octagon() * radius).T, np.full(8, height)], axis=1) * size_m + foot_m
        for radius, height in rings
    ]
    faces = [Face("plant", material, stack[0][::-1]), Face("plant", material, stack[-1])]
    for lower, upper in pairwise(stack):
        faces += [
            Face("plant", material, np.stack([lower[i - 1], lower[i], upper[i], upper[i - 1]]))
            for i in range(8)
        ]
    return faces
