"""What most bridges here share: approaches behind the abutments, a road below, green all about."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from civil_rgbd.simulator.sites.draft import FAR_M, Draft, Span
from civil_rgbd.simulator.sites.furniture import put_house
from civil_rgbd.simulator.sites.plants import (
    Sun,
    put_bush,
    put_far_trees,
    put_tree,
    put_tufts,
)

NEAR_M = 30.0
"""Half the stretch along x where the ground is finely lit."""


@dataclass(frozen=True, slots=True)
class Approach:
    """The embankment behind an abutment, and the wing walls that hold its end.

    Attributes:
        wall_y_m: how far from the middle the wing walls' fronts stand, on both sides.
        half_width_m: half the width of its crown along x.
        top_z_m: of its crown.
        foot_x_m: where its slopes meet the ground.
        material: of the wing walls.
    """

    wall_y_m: float
    half_width_m: float
    top_z_m: float
    foot_x_m: float
    material: str


def put_approaches(draft: Draft, approach: Approach) -> None:
    """Put both approaches up, at -y and at +y."""
    reach, foot, top = approach.half_width_m, approach.foot_x_m, approach.top_z_m
    right = [(0.0, reach), (top + 0.2, reach), (0.5, foot), (0.0, foot)]  # z, x
    left = [(z, -x) for z, x in reversed(right)]
    slope = [(0.0, -foot), (top, -reach), (top, reach), (0.0, foot)]
    for side in (-1, 1):
        front, back = side * approach.wall_y_m, side * (approach.wall_y_m + 0.4)
        for outline in (right, left):
            draft.bar("wing", approach.material, outline, along=1, span_m=(front, back))
        draft.bar("embankment", "grass", slope, along=1, span_m=(back, side * FAR_M))


def put_road(
    draft: Draft, *, road_y_m: Span, walk_y_m: float, end_y_m: float, kerb_m: float
) -> None:
    """Put a road down along x, sidewalks on both sides of it, grass beyond.

    Args:
        draft: to draw on.
        road_y_m: the road's edges.
        walk_y_m: width of the sidewalks.
        end_y_m: green verges lie between the sidewalks and this, on both sides.
        kerb_m: height of sidewalks and verges.
    """
    low, high = sorted(road_y_m)
    strips = [
        ("road", "road", (low, high), 0.0),
        ("sidewalk", "footway", (low - walk_y_m, low), kerb_m),
        ("sidewalk", "footway", (high, high + walk_y_m), kerb_m),
    ]
    if end_y_m > high + walk_y_m:
        strips.append(("verge", "gravel", (high + walk_y_m, end_y_m), kerb_m))
    if end_y_m > -low + walk_y_m:
        strips.append(("verge", "gravel", (-end_y_m, low - walk_y_m), kerb_m))
    for x in ((-FAR_M, -NEAR_M), (-NEAR_M, NEAR_M), (NEAR_M, FAR_M)):
        draft.strips(x, strips)
        for side in (-1, 1):
            draft.level("grass", "grass", x, (side * end_y_m, side * FAR_M))


def put_markings(draft: Draft, y_m: float, *, z_m: float, material: str = "white") -> None:
    """Paint dashes along x."""
    for x in np.arange(-60.0, 60.0, 6.0).tolist():
        draft.box("marking", material, ((x, x + 3.0), (y_m - 0.06, y_m + 0.06), (z_m, z_m + 0.004)))


def put_green(
    draft: Draft, rng: np.random.Generator, *, sun: Sun, foot_x_m: float, beside_y_m: float
) -> None:
    """Put trees, bushes, tufts and a few houses about a bridge.

    Args:
        draft: to draw on.
        rng: of where and how big.
        sun: direction to it.
        foot_x_m: bushes stand beyond the embankment's foot.
        beside_y_m: nothing grows nearer to the road's middle than this.
    """
    for index in range(22):
        end, side = 1 if index % 2 else -1, 1 if index % 4 < 2 else -1  # in turn
        near = index < 6
        x = rng.uniform(foot_x_m + 4, foot_x_m + 12) if near else rng.uniform(45, 125)
        y = beside_y_m + (rng.uniform(3.5, 9) if near else rng.uniform(4, 38))
        put_tree(draft, rng, (end * x, side * y, 0.0), sun=sun, near=near)
    for index in range(18):
        end, side = 1 if index % 2 else -1, 1 if index % 4 < 2 else -1  # in turn
        place = (
            end * rng.uniform(foot_x_m + 0.8, foot_x_m + 14),
            side * (beside_y_m + rng.uniform(1.0, 3.5)),
            0.0,
        )
        put_bush(draft, rng, place, radius_m=rng.uniform(0.4, 0.9), sun=sun)
    xs = rng.uniform(foot_x_m, foot_x_m + 14, 60) * np.where(rng.random(60) < 0.5, -1, 1)
    ys = (beside_y_m + rng.uniform(0.1, 0.8, 60)) * np.where(rng.random(60) < 0.5, -1, 1)
    put_tufts(draft, rng, np.stack([xs, ys, np.zeros(60)], axis=1), sun=sun)
    put_far_trees(draft, rng, gap_y_m=beside_y_m)
    for end, side in ((-1, 1), (1, -1), (1, 1)):
        x0, y0 = end * rng.uniform(50, 70), side * (beside_y_m + rng.uniform(14, 20))
        put_house(draft, (x0, x0 + end * 14), (y0, y0 + side * 10), height_m=rng.uniform(5.5, 9.5))
