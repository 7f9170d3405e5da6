"""B1: steel plate girders on concrete abutments and a pier of columns, over a road."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from civil_rgbd.simulator.path import WalkPath
from civil_rgbd.simulator.site import Site
from civil_rgbd.simulator.sites.draft import Draft, Span
from civil_rgbd.simulator.sites.furniture import Railing, put_cones, put_lamp, put_railing, put_sign
from civil_rgbd.simulator.sites.surroundings import (
    Approach,
    put_approaches,
    put_green,
    put_markings,
    put_road,
)
from civil_rgbd.simulator.sites.traffic import CAR_PAINTS, car, drivers, put, strollers
from civil_rgbd.simulator.spall import SpallPlan

_SUN = (-0.42, -0.48, 0.77)
_HALF_DECK_M = 6.0  # along x
_ABUTMENT_Y_M, _SEAT_Z_M, _BEARING_M = 9.5, 4.6, 0.1
_GIRDER_DEPTH_M, _SLAB_M = 1.1, 0.22
_GIRDERS_X_M = (-5.0, -3.0, -1.0, 1.0, 3.0, 5.0)
_FLANGE_M, _FLANGE_THICK_M, _WEB_M = 0.36, 0.035, 0.02
_PIER_Y_M, _COLUMN_M = 0.5, 0.45
_KERB_M = 0.15

_GIRDER_Z_M = _SEAT_Z_M + _BEARING_M
_SOFFIT_Z_M = _GIRDER_Z_M + _GIRDER_DEPTH_M
_DIMENSIONS_M = {
    "deck_width_m": 2 * _HALF_DECK_M,
    "abutment_y_m": _ABUTMENT_Y_M,
    "abutment_height_m": _SEAT_Z_M,
    "girder_soffit_z_m": _GIRDER_Z_M,
    "girder_depth_m": _GIRDER_DEPTH_M,
    "deck_soffit_z_m": _SOFFIT_Z_M,
    "deck_top_z_m": _SOFFIT_Z_M + _SLAB_M,
    "flange_width_m": _FLANGE_M,
    "web_thickness_m": _WEB_M,
    "column_radius_m": _COLUMN_M,
    "kerb_height_m": _KERB_M,
}


def girder_site(seed: int) -> Site:
    """Draw B1; the seed places plants, cars and people."""
    rng = np.random.default_rng([seed, 1])
    draft = Draft()
    _deck(draft)
    _supports(draft)
    put_road(draft, road_y_m=(-6.3, 6.3), walk_y_m=2.6, end_y_m=9.9, kerb_m=_KERB_M)
    for y in (-3.15, 3.15):
        put_markings(draft, y, z_m=0.0)
    for x in (-22.0, 16.0):
        put_lamp(draft, (x, 8.5), height_m=7.0, arm_m=-1.6, z_m=_KERB_M)
    put_sign(draft, (-13.5, -8.75), z_m=_KERB_M, turned=False, material="sign")
    put_cones(draft, [(7.5, -5.9), (9.0, -5.8), (10.5, -5.7)], z_m=0.0)
    slots = [(-11.5, 5.3, -1), (3.4, 5.25, -1), (10.0, 5.3, -1), (18.0, -5.3, 1)]
    for k in sorted(rng.choice(4, 3, replace=False).tolist()):
        x, y, ahead = slots[k]
        put(draft, car(CAR_PAINTS[int(rng.integers(5))]), (x, y, 0.0), ahead)
    put_green(draft, rng, sun=_SUN, foot_x_m=17.0, beside_y_m=10.6)
    movers = [
        *drivers(rng, [(-3.0, 1), (2.4, -1)], z_m=0.0),
        *strollers(rng, [((2.0, 7.9), 13.0, 0.2), ((-8.0, 7.1), 9.0, 0.2)], z_m=_KERB_M),
    ]
    corners = (
        *((-12.0, -7.9), (11.0, -7.9), (13.0, -7.4)),
        *((10.5, -6.75), (-11.5, -6.75), (-14.0, -7.4)),
    )
    path = WalkPath(tuple((x, y, _KERB_M) for x, y in corners))
    return Site(draft.scene("B1", _DIMENSIONS_M, _SUN), tuple(movers), tuple(draft.spalls), path)


def _deck(draft: Draft) -> None:
    ends = (-_ABUTMENT_Y_M - 1.0, _ABUTMENT_Y_M + 1.0)
    hollows = (
        SpallPlan("B1-3", (8.0, 6.2), 0.62, 0.40, 0.045, 13),  # between two girders
        SpallPlan("B1-4", (6.0, 16.2), 0.30, 0.24, 0.030, 14),
    )
    slab = ((-_HALF_DECK_M, _HALF_DECK_M), ends, (_SOFFIT_Z_M, _SOFFIT_Z_M + _SLAB_M))
    draft.box("soffit", "soffit", slab, {"-z": hollows})
    half, web = _FLANGE_M / 2, _WEB_M / 2
    low, high = _GIRDER_Z_M, _SOFFIT_Z_M
    reach: Span = (-_ABUTMENT_Y_M - 0.5, _ABUTMENT_Y_M + 0.5)
    for x in _GIRDERS_X_M:
        for z in ((low, low + _FLANGE_THICK_M), (high - _FLANGE_THICK_M, high)):
            draft.box("girder", "steel", ((x - half, x + half), reach, z))
        inner = (low + _FLANGE_THICK_M, high - _FLANGE_THICK_M)
        draft.box("girder", "steel", ((x - web, x + web), reach, inner))
        for y in np.arange(-7.5, 8.0, 1.5).tolist():  # stiffeners on both sides of the web
            for side in (-1, 1):
                wing = (x + side * web, x + side * 0.15)
                draft.box("girder", "steel", (wing, (y - 0.008, y + 0.008), inner))
        for y in (-_ABUTMENT_Y_M - 0.25, 0.0, _ABUTMENT_Y_M + 0.25):
            plate = ((x - 0.2, x + 0.2), (y - 0.15, y + 0.15), (_SEAT_Z_M, low))
            draft.box("bearing", "rubber", plate)
    for left, right in pairwise(_GIRDERS_X_M):  # cross frames: two rails and a brace between
        span = (left + web, right - web)
        for y in (-7.5, -4.5, 4.5, 7.5):
            for rail in (low + 0.2, high - 0.25):
                draft.box("girder", "steel", (span, (y + 0.02, y + 0.09), (rail, rail + 0.07)))
            (x0, x1), (z0, z1) = span, (low + 0.27, high - 0.25)
            brace = np.array([(z0, x0), (z1 - 0.06, x1), (z1, x1), (z0 + 0.06, x0)])
            draft.bar("girder", "steel", brace, along=1, span_m=(y + 0.03, y + 0.05))
    top = _SOFFIT_Z_M + _SLAB_M
    for side in (-1, 1):
        x = side * (_HALF_DECK_M - 0.15)
        draft.box("kerb", "slab", ((x - 0.15, x + 0.15), (-21.0, 21.0), (top, top + 0.35)))
        put_railing(draft, Railing(), x_m=(x, x), y_m=(-20.5, 20.5), z_m=top + 0.35)


def _supports(draft: Draft) -> None:
    reach = _HALF_DECK_M + 0.6
    spalls = {
        -1: (
            SpallPlan("B1-1", (4.6, 1.6), 0.85, 0.55, 0.060, 11),
            SpallPlan("B1-2", (8.4, 2.9), 0.42, 0.28, 0.035, 12),
        ),
        1: (SpallPlan("B1-5", (5.5, 1.4), 1.10, 0.70, 0.080, 15),),
    }
    for side, hollows in spalls.items():
        front, back = side * _ABUTMENT_Y_M, side * (_ABUTMENT_Y_M + 1.0)
        face = "+y" if side < 0 else "-y"
        draft.box(
            "abutment", "wall", ((-reach, reach), (front, back), (0.0, _SEAT_Z_M)), {face: hollows}
        )
        draft.box(
            "abutment", "wall",
            ((-reach, reach), (side * (_ABUTMENT_Y_M + 0.65), back), (_SEAT_Z_M, _SOFFIT_Z_M)),
        )  # fmt: skip
    top = _SOFFIT_Z_M + _SLAB_M
    put_approaches(draft, Approach(_ABUTMENT_Y_M + 0.6, reach, top, 16.0, "wall"))
    cap = (_SEAT_Z_M - 0.8, _SEAT_Z_M)
    hollows = (SpallPlan("B1-6", (3.2, 0.4), 0.55, 0.30, 0.050, 16),)
    draft.box("pier", "slab", ((-5.8, 5.8), (-_PIER_Y_M, _PIER_Y_M), cap), {"-y": hollows})
    for x in (-4.4, 0.0, 4.4):
        draft.column("pier", "wall", (x, 0.0), radius_m=_COLUMN_M, z_m=(0.0, cap[0]))
    draft.box("pier", "footway", ((-8.0, 8.0), (-0.9, 0.9), (0.0, 0.12)))
