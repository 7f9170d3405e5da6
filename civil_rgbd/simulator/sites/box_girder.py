"""B4: a long concrete box girder over a park trail, walked along below its soffit."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from civil_rgbd.simulator.motion import Stroll
from civil_rgbd.simulator.path import WalkPath
from civil_rgbd.simulator.site import Site
from civil_rgbd.simulator.sites.draft import FAR_M, Draft
from civil_rgbd.simulator.sites.furniture import Railing, put_cones, put_railing, put_sign
from civil_rgbd.simulator.sites.plants import put_bush, put_far_trees, put_tree, put_tufts
from civil_rgbd.simulator.sites.traffic import (
    CAR_PAINTS,
    car,
    cyclist,
    drivers,
    mover,
    put,
    strollers,
)
from civil_rgbd.simulator.spall import SpallPlan

_SUN = (0.28, -0.58, 0.77)
_ENDS_X_M = 46.0
_PIERS_X_M = (-16.0, 16.0)
_HALF_SOFFIT_M, _HALF_WEB_TOP_M, _HALF_DECK_M = 2.6, 3.4, 6.0
_SOFFIT_Z_M, _DEPTH_M, _SLAB_M = 5.6, 1.9, 0.28
_PIER_M = (1.2, 3.4)
_TOP_Z_M = _SOFFIT_Z_M + _DEPTH_M
_DIMENSIONS_M = {
    "length_m": 2 * _ENDS_X_M,
    "span_m": _PIERS_X_M[1] - _PIERS_X_M[0],
    "soffit_z_m": _SOFFIT_Z_M,
    "soffit_width_m": 2 * _HALF_SOFFIT_M,
    "box_depth_m": _DEPTH_M,
    "deck_width_m": 2 * _HALF_DECK_M,
    "overhang_z_m": _TOP_Z_M - _SLAB_M,
    "pier_length_m": _PIER_M[0],
    "pier_width_m": _PIER_M[1],
}


def box_girder_site(seed: int) -> Site:
    """Draw B4; the seed places plants, cars and people."""
    rng = np.random.default_rng([seed, 4])
    draft = Draft()
    _girder(draft)
    _supports(draft)
    _ground(draft)
    put_cones(draft, [(-3.0, 4.6), (-4.5, 4.9)], z_m=0.0)
    put_sign(draft, (9.0, -6.6), z_m=0.0, turned=False, material="blue")
    for x, ahead in ((-12.0, 1), (4.0, 1), (20.0, 1)):
        if rng.random() < 0.8:  # most slots are taken
            put(draft, car(CAR_PAINTS[int(rng.integers(5))]), (x, -15.2, 0.0), ahead)
    _green(draft, rng)
    ride = Stroll((0.0, 6.1, 0.0), 60.0, -0.2, 0.014, rng.random())
    movers = [
        *drivers(rng, [(-13.0, 1), (-10.0, -1)], z_m=0.0),
        *strollers(rng, [((4.0, 7.75), 14.0, 0.2), ((-10.0, 7.0), 8.0, 0.15)], z_m=0.0),
        mover("cyclist-1", cyclist("red"), ride),
    ]
    corners = ((-28, -3.6), (24, -3.6), (27, 0), (24, 3.4), (-26, 3.4), (-30, 0))
    path = WalkPath(
        tuple((float(x), y, 0.0) for x, y in corners), look_left_deg=6.0, look_up_deg=10.0
    )
    scene = draft.scene("B4", _DIMENSIONS_M, _SUN)
    return Site(scene, tuple(movers), tuple(draft.spalls), path)


def _girder(draft: Draft) -> None:
    run = (-_ENDS_X_M, _ENDS_X_M)
    low, over, web = _SOFFIT_Z_M, _TOP_Z_M - _SLAB_M, 0.3
    hollows = (
        SpallPlan("B4-3", (40.5, 1.4), 0.80, 0.55, 0.050, 43),
        SpallPlan("B4-4", (52.0, 3.9), 0.45, 0.35, 0.040, 44),
        SpallPlan("B4-5", (58.2, 1.9), 1.20, 0.60, 0.060, 45),
    )
    soffit = (-_HALF_SOFFIT_M, _HALF_SOFFIT_M)
    draft.box("soffit", "soffit", (run, soffit, (low, low + 0.25)), {"-z": hollows})
    for side in (-1, 1):
        # Inclined webs: outlines are y, z.
        outline = np.array([
            (side * _HALF_SOFFIT_M, low), (side * _HALF_WEB_TOP_M, over),
            (side * (_HALF_WEB_TOP_M - web), over), (side * (_HALF_SOFFIT_M - web), low + 0.25),
        ])  # fmt: skip
        for start, end in _runs(run):
            draft.bar("web", "slab", outline[::side], along=0, span_m=(start, end))
    draft.box("overhang", "slab", (run, (-_HALF_DECK_M, _HALF_DECK_M), (over, _TOP_Z_M)))
    for side in (-1, 1):
        y = side * (_HALF_DECK_M - 0.2)
        draft.box("kerb", "slab", (run, (y - 0.2, y + 0.2), (_TOP_Z_M, _TOP_Z_M + 0.3)))
        for start, end in _runs(run):
            rail = Railing(bar_m=0.02, spacing_m=0.15)
            put_railing(draft, rail, x_m=(start, end), y_m=(y, y), z_m=_TOP_Z_M + 0.3)


def _runs(run: tuple[float, float]) -> list[tuple[float, float]]:
    return list(pairwise(np.linspace(*run, 9).tolist()))


def _supports(draft: Draft) -> None:
    half_x, half_y = _PIER_M[0] / 2, _PIER_M[1] / 2
    spalls = {
        -16.0: {"+x": (SpallPlan("B4-1", (1.6, 1.5), 0.60, 0.45, 0.055, 41),)},
        16.0: {
            "-x": (SpallPlan("B4-2", (1.9, 1.3), 0.90, 0.70, 0.070, 42),),
            "+y": (SpallPlan("B4-6", (0.6, 2.0), 0.30, 0.42, 0.035, 46),),
        },
    }
    for x, hollows in spalls.items():
        spans = ((x - half_x, x + half_x), (-half_y, half_y), (0.0, _SOFFIT_Z_M - 0.15))
        draft.box("pier", "wall", spans, hollows)
        for y in (-1.0, 1.0):
            pad = ((x - 0.3, x + 0.3), (y - 0.3, y + 0.3), (_SOFFIT_Z_M - 0.15, _SOFFIT_Z_M))
            draft.box("bearing", "rubber", pad)
    for side in (-1, 1):
        front, back = side * (_ENDS_X_M - 1.2), side * (_ENDS_X_M + 1.5)
        wall = ((front, back), (-_HALF_DECK_M - 0.4, _HALF_DECK_M + 0.4), (0.0, _SOFFIT_Z_M))
        hollow = SpallPlan(f"B4-{7 if side < 0 else 8}", (5.0, 1.6), 0.70, 0.50, 0.060, 47 + side)
        draft.box("abutment", "wall", wall, {"+x" if side < 0 else "-x": (hollow,)})
        step = ((side * _ENDS_X_M, back), wall[1], (_SOFFIT_Z_M, _TOP_Z_M))
        draft.box("abutment", "wall", step)
        # The embankment runs on along x; its slopes fall to both sides. Outlines are y, z.
        slope = [(-16.0, 0.0), (16.0, 0.0), (6.4, _TOP_Z_M), (-6.4, _TOP_Z_M)]
        draft.bar("embankment", "grass", slope, along=0, span_m=(back, side * FAR_M))


def _ground(draft: Draft) -> None:
    for x in ((-FAR_M, -50.0), (-50.0, 50.0), (50.0, FAR_M)):
        draft.level("grass", "grass", x, (-FAR_M, -16.2))
        draft.level("road", "road", x, (-16.2, -8.6))
        draft.level("grass", "grass", x, (-8.6, -4.6))
        draft.level("ground", "gravel", x, (-4.6, 4.6))
        draft.level("grass", "grass", x, (4.6, 5.6))
        draft.level("trail", "footway", x, (5.6, 8.2))
        draft.level("grass", "grass", x, (8.2, FAR_M))
    fence = Railing(height_m=1.1, bar_m=0.016, spacing_m=0.12, material="dark")
    for start in (-30.0, -6.0, 10.0):
        put_railing(draft, fence, x_m=(start, start + 12.0), y_m=(9.0, 9.0), z_m=0.0)


def _green(draft: Draft, rng: np.random.Generator) -> None:
    for index in range(22):
        near = index < 6  # the first few stand near
        x = rng.uniform(-40, 40) if near else rng.uniform(-130, 130)
        away = rng.uniform(12.5, 18) if near else rng.uniform(20, 50)
        y = -away - 8 if index % 2 else away
        put_tree(draft, rng, (x, y, 0.0), sun=_SUN, near=near)
    put_far_trees(draft, rng, gap_y_m=16.0)
    for index in range(20):
        y = rng.uniform(-8.0, -5.6) if index % 2 else rng.uniform(9.9, 12.0)
        place = (rng.uniform(-38, 38), y, 0.0)
        put_bush(draft, rng, place, radius_m=rng.uniform(0.35, 0.9), sun=_SUN)
    xs = rng.uniform(-40, 40, 110)
    ys = np.where(rng.random(110) < 0.5, rng.uniform(4.7, 5.4, 110), rng.uniform(-5.6, -4.7, 110))
    put_tufts(draft, rng, np.stack([xs, ys, np.zeros(110)], axis=1), sun=_SUN)
