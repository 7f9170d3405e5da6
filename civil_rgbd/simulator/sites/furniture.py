"""What people put up about a bridge: railings, lamps, signs, houses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from civil_rgbd.simulator.sites.draft import Draft, Span


@dataclass(frozen=True, slots=True)
class Railing:
    """A guard of upright bars between two rails.

    Attributes:
        height_m: of its top above its foot.
        bar_m: width of a bar.
        spacing_m: from bar to bar.
        post_m: width of a post.
        post_spacing_m: from post to post, about.
        material: of all of it.
    """

    height_m: float = 1.1
    bar_m: float = 0.018
    spacing_m: float = 0.13
    post_m: float = 0.06
    post_spacing_m: float = 2.4
    material: str = "galvanised"


def put_railing(draft: Draft, railing: Railing, *, x_m: Span, y_m: Span, z_m: float) -> None:
    """Put a railing up along x or along y: the other of the two spans has no length."""
    axis = 0 if x_m[0] != x_m[1] else 1
    (start, end), across = sorted((x_m, y_m)[axis]), (x_m, y_m)[1 - axis][0]
    top, half = z_m + railing.height_m, railing.post_m / 2

    def put(run: Span, width_m: float, z: Span) -> None:
        side = (across - width_m / 2, across + width_m / 2)
        spans = (run, side, z) if axis == 0 else (side, run, z)
        draft.box("railing", railing.material, spans)

    put((start, end), 0.05, (top - 0.05, top))
    put((start, end), 0.035, (z_m + 0.1, z_m + 0.135))
    posts = np.linspace(start + half, end - half, max(round((end - start) / 2.4), 1) + 1)
    for post in posts.tolist():
        put((post - half, post + half), railing.post_m, (z_m, top - 0.05))
    bar = railing.bar_m / 2
    for left, right in zip(posts[:-1].tolist(), posts[1:].tolist(), strict=True):
        count = max(round((right - left) / railing.spacing_m) - 1, 1)
        for k in range(count):
            middle = left + (right - left) * (k + 1) / (count + 1)
            put((middle - bar, middle + bar), railing.bar_m, (z_m + 0.135, top - 0.05))


def put_lamp(draft: Draft, place_m: Span, *, height_m: float, arm_m: float, z_m: float) -> None:
    """Put a street lamp up, its arm along y."""
    x, y = place_m
    draft.column("lamp", "galvanised", place_m, radius_m=0.09, z_m=(z_m, z_m + height_m))
    arm = (y, y + arm_m)
    draft.box("lamp", "galvanised", ((x - 0.04, x + 0.04), arm, (height_m, height_m + 0.08)))
    head = (y + arm_m, y + arm_m * 1.4)
    draft.box("lamp", "white", ((x - 0.15, x + 0.15), head, (height_m, height_m + 0.14)))


def put_sign(draft: Draft, place_m: Span, *, z_m: float, turned: bool, material: str) -> None:
    """Put a road sign up, facing along x, to the front or to the back."""
    x, y = place_m
    draft.column("sign", "galvanised", place_m, radius_m=0.035, z_m=(z_m, z_m + 2.9))
    front = x - 0.05 if not turned else x + 0.035
    plate = ((front, front + 0.015), (y - 0.32, y + 0.32), (z_m + 2.15, z_m + 2.85))
    draft.box("sign", material, plate)


def put_house(draft: Draft, x_m: Span, y_m: Span, *, height_m: float) -> None:
    """Put a plain block of a house up, with rows of windows on all sides."""
    draft.box("house", "brick", (x_m, y_m, (0.0, height_m)))
    for floor in np.arange(1.0, height_m - 1.6, 2.9).tolist():
        z = (floor, floor + 1.5)
        for axis, spans in ((0, (x_m, y_m)), (1, (y_m, x_m))):
            (start, end), walls = sorted(spans[0]), sorted(spans[1])
            for left in np.arange(start + 1.0, end - 1.8, 2.6).tolist():
                for wall, out in ((walls[0], -0.06), (walls[1], 0.06)):
                    window, depth = (left, left + 1.2), (wall + out, wall - out)
                    pane = (window, depth, z) if axis == 0 else (depth, window, z)
                    draft.box("house", "glass", pane)


def put_cones(draft: Draft, places_m: list[Span], *, z_m: float) -> None:
    """Put traffic cones down."""
    for x, y in places_m:
        draft.box("cone", "rubber", ((x - 0.18, x + 0.18), (y - 0.18, y + 0.18), (z_m, z_m + 0.04)))
        draft.column("cone", "orange", (x, y), radius_m=0.12, z_m=(z_m + 0.04, z_m + 0.3))
        draft.column("cone", "white", (x, y), radius_m=0.085, z_m=(z_m + 0.3, z_m + 0.5))
        draft.column("cone", "orange", (x, y), radius_m=0.05, z_m=(z_m + 0.5, z_m + 0.75))
