"""B5: a concrete rigid frame with a curved soffit that grows out of its legs, over a road."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from civil_rgbd.simulator.path import WalkPath
from civil_rgbd.simulator.site import Site
from civil_rgbd.simulator.sites.draft import Draft
from civil_rgbd.simulator.sites.furniture import Railing, put_lamp, put_railing, put_sign
from civil_rgbd.simulator.sites.surroundings import (
    Approach,
    put_approaches,
    put_green,
    put_markings,
    put_road,
)
from civil_rgbd.simulator.sites.traffic import CAR_PAINTS, car, drivers, put, strollers
from civil_rgbd.simulator.spall import SpallPlan

_SUN = (0.45, 0.50, 0.74)
_HALF_DECK_M = 8.0  # along x
_LEG_Y_M, _LEG_M = 8.0, 1.1
_SPRING_Z_M, _CROWN_Z_M, _CROWN_M = 3.9, 5.1, 0.55
_FLAT_M = 2.0  # the middle of the soffit is level for so far to both sides
_KERB_M = 0.15
_SEGMENTS = 7
_TOP_Z_M = _CROWN_Z_M + _CROWN_M
_DIMENSIONS_M = {
    "deck_width_m": 2 * _HALF_DECK_M,
    "clear_span_m": 2 * _LEG_Y_M,
    "leg_thickness_m": _LEG_M,
    "soffit_spring_z_m": _SPRING_Z_M,
    "soffit_crown_z_m": _CROWN_Z_M,
    "crown_thickness_m": _CROWN_M,
    "kerb_height_m": _KERB_M,
}


def frame_site(seed: int) -> Site:
    """Draw B5; the seed places plants, cars and people."""
    rng = np.random.default_rng([seed, 5])
    draft = Draft()
    _frame(draft)
    put_approaches(draft, Approach(_LEG_Y_M + 0.5, _HALF_DECK_M, _TOP_Z_M, 17.0, "slab"))
    put_road(draft, road_y_m=(-5.4, 5.4), walk_y_m=2.6, end_y_m=8.9, kerb_m=_KERB_M)
    put_markings(draft, 0.0, z_m=0.0, material="sign")
    put_lamp(draft, (-18.0, -7.4), height_m=7.0, arm_m=1.5, z_m=_KERB_M)
    put_lamp(draft, (20.0, 7.4), height_m=7.0, arm_m=-1.5, z_m=_KERB_M)
    put_sign(draft, (-13.0, 5.7), z_m=_KERB_M, turned=False, material="red")
    for x in (-15.0, -3.0, 3.4, 13.0):
        if rng.random() < 0.75:  # most slots are taken
            put(draft, car(CAR_PAINTS[int(rng.integers(5))]), (x, 4.4, 0.0), -1)
    put_green(draft, rng, sun=_SUN, foot_x_m=18.0, beside_y_m=9.7)
    movers = [
        *drivers(rng, [(-1.8, 1), (1.7, -1)], z_m=0.0),
        *strollers(rng, [((-2.0, 7.2), 13.0, 0.2), ((7.0, 6.4), 9.0, 0.2)], z_m=_KERB_M),
    ]
    corners = ((-13, -6.8), (12, -6.8), (14, -5.8), (11, -4.6), (-12, -4.6), (-15, -5.8))
    path = WalkPath(tuple((float(x), y, _KERB_M if y < -5.4 else 0.0) for x, y in corners))
    scene = draft.scene("B5", _DIMENSIONS_M, _SUN)
    return Site(scene, tuple(movers), tuple(draft.spalls), path)


def soffit_z_m(y_m: float) -> float:
    """Return the height of the curve that the soffit's corners lie on."""
    share = max(abs(y_m) - _FLAT_M, 0.0) / (_LEG_Y_M - _FLAT_M)
    return _CROWN_Z_M - (_CROWN_Z_M - _SPRING_Z_M) * share * share


def _frame(draft: Draft) -> None:
    deck = (-_HALF_DECK_M, _HALF_DECK_M)
    spalls = {
        -1: (
            SpallPlan("B5-1", (6.2, 1.5), 0.95, 0.60, 0.065, 51),
            SpallPlan("B5-2", (11.2, 2.1), 0.38, 0.30, 0.040, 52),
        ),
        1: (SpallPlan("B5-3", (5.0, 1.6), 0.70, 0.50, 0.055, 53),),
    }
    for side, hollows in spalls.items():
        legs = (side * _LEG_Y_M, side * (_LEG_Y_M + _LEG_M))
        face = "+y" if side < 0 else "-y"
        draft.box("abutment", "wall", (deck, legs, (0.0, _SPRING_Z_M)), {face: hollows})
        upper = (_SPRING_Z_M, _TOP_Z_M)
        draft.box("abutment", "wall", (deck, legs, upper))
        ys = np.linspace(side * _FLAT_M, side * _LEG_Y_M, _SEGMENTS + 1).tolist()
        for inner, outer in pairwise(ys):
            low = [(inner, soffit_z_m(inner)), (outer, soffit_z_m(outer))]
            outline = np.array([*low, (outer, _TOP_Z_M), (inner, _TOP_Z_M)])
            draft.bar("soffit", "soffit", outline[::side], along=0, span_m=deck)
    hollows = (
        SpallPlan("B5-4", (7.0, 0.9), 0.60, 0.45, 0.045, 54),
        SpallPlan("B5-5", (10.5, 3.0), 0.85, 0.40, 0.050, 55),
    )
    flat = ((deck), (-_FLAT_M, _FLAT_M), (_CROWN_Z_M, _TOP_Z_M))
    draft.box("soffit", "soffit", flat, {"-z": hollows})
    for side in (-1, 1):
        x = side * (_HALF_DECK_M - 0.2)
        draft.box(
            "parapet", "slab", ((x - 0.2, x + 0.2), (-20.0, 20.0), (_TOP_Z_M, _TOP_Z_M + 0.45))
        )
        rail = Railing(height_m=0.8, bar_m=0.02, spacing_m=0.14, material="dark")
        put_railing(draft, rail, x_m=(x, x), y_m=(-20.0, 20.0), z_m=_TOP_Z_M + 0.45)
