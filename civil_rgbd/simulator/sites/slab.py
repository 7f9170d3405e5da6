"""B3: a concrete slab of 1931 on two abutments and a centre pier, over a road."""

from __future__ import annotations

import numpy as np

from civil_rgbd.simulator.path import WalkPath
from civil_rgbd.simulator.site import Site
from civil_rgbd.simulator.sites.draft import Draft
from civil_rgbd.simulator.sites.furniture import Railing, put_lamp, put_railing, put_sign
from civil_rgbd.simulator.sites.plants import put_ivy
from civil_rgbd.simulator.sites.surroundings import (
    Approach,
    put_approaches,
    put_green,
    put_markings,
    put_road,
)
from civil_rgbd.simulator.sites.traffic import CAR_PAINTS, car, drivers, put, strollers, van
from civil_rgbd.simulator.spall import SpallPlan

_SUN = (-0.55, 0.35, 0.76)
_HALF_DECK_M = 7.0  # along x
_ABUTMENT_Y_M, _SOFFIT_Z_M, _SLAB_M = 8.6, 4.3, 0.65
_PIER_M = 0.9
_KERB_M = 0.16
_TOP_Z_M = _SOFFIT_Z_M + _SLAB_M
_DIMENSIONS_M = {
    "deck_width_m": 2 * _HALF_DECK_M,
    "abutment_y_m": _ABUTMENT_Y_M,
    "soffit_z_m": _SOFFIT_Z_M,
    "slab_thickness_m": _SLAB_M,
    "pier_thickness_m": _PIER_M,
    "clear_span_m": _ABUTMENT_Y_M - _PIER_M / 2,
    "kerb_height_m": _KERB_M,
}


def slab_site(seed: int) -> Site:
    """Draw B3; the seed places plants, cars and people."""
    rng = np.random.default_rng([seed, 3])
    draft = Draft()
    _structure(draft)
    put_approaches(draft, Approach(_ABUTMENT_Y_M + 0.3, 7.5, _TOP_Z_M, 15.0, "aged"))
    put_road(draft, road_y_m=(-6.0, 6.0), walk_y_m=2.2, end_y_m=9.0, kerb_m=_KERB_M)
    for y in (-3.2, 3.2):
        put_markings(draft, y, z_m=0.0, material="sign")
    put_lamp(draft, (-19.0, 7.6), height_m=6.5, arm_m=-1.5, z_m=_KERB_M)
    put_sign(draft, (8.6, -6.3), z_m=_KERB_M, turned=True, material="white")
    slots = [(-13.0, 4.95, -1), (-6.4, 4.95, -1), (5.6, 4.9, -1), (12.2, 4.95, -1)]
    for k in sorted(rng.choice(4, 3, replace=False).tolist()):
        x, y, ahead = slots[k]
        paint = CAR_PAINTS[int(rng.integers(5))]
        put(draft, van(paint) if rng.random() < 0.3 else car(paint), (x, y, 0.0), ahead)
    put_green(draft, rng, sun=_SUN, foot_x_m=16.0, beside_y_m=9.8)
    spots = np.stack(
        [rng.uniform(7.6, 11.0, 240), np.full(240, -8.9), rng.uniform(0.3, 1.1, 240)], axis=1
    )
    spots[:, 2] *= rng.uniform(0.8, 3.0, 240)
    spots[:, 1] += rng.uniform(0.01, 0.10, 240)
    put_ivy(draft, rng, spots, sun=_SUN)
    movers = [
        *drivers(rng, [(-2.4, 1), (2.2, -1)], z_m=0.0),
        *strollers(rng, [((0.0, 7.5), 12.0, 0.2), ((10.0, 6.7), 8.0, 0.2)], z_m=_KERB_M),
    ]
    corners = ((-12, -7.4), (11, -7.4), (13, -6.4), (10, -5.2), (-11, -5.2), (-14, -6.4))
    path = WalkPath(tuple((float(x), y, _KERB_M if y < -6 else 0.0) for x, y in corners))
    scene = draft.scene("B3", _DIMENSIONS_M, _SUN)
    return Site(scene, tuple(movers), tuple(draft.spalls), path)


def _structure(draft: Draft) -> None:
    reach = (-_HALF_DECK_M - 0.5, _HALF_DECK_M + 0.5)
    spalls = {
        -1: (SpallPlan("S1", (5.4, 1.5), 1.20, 0.65, 0.075, 31),),
        1: (SpallPlan("S5", (9.0, 1.7), 0.46, 0.32, 0.040, 35),),
    }
    for side, hollows in spalls.items():
        face = "+y" if side < 0 else "-y"
        walls = (side * _ABUTMENT_Y_M, side * (_ABUTMENT_Y_M + 1.2))
        draft.box("abutment", "aged", (reach, walls, (0.0, _SOFFIT_Z_M)), {face: hollows})
    pier = (
        SpallPlan("S2", (4.2, 1.2), 0.75, 0.90, 0.060, 32),
        SpallPlan("S3", (8.9, 2.2), 0.35, 0.26, 0.045, 33),
    )
    half = _PIER_M / 2
    draft.box("pier", "aged", ((-6.2, 6.2), (-half, half), (0.0, _SOFFIT_Z_M)), {"-y": pier})
    draft.box("pier", "footway", ((-8.5, 8.5), (-1.0, 1.0), (0.0, _KERB_M)))
    for side in (-1, 1):  # cutwaters: pointed ends
        nose = np.array([(side * 6.2, -half), (side * 6.7, 0.0), (side * 6.2, half)])
        draft.bar("pier", "aged", nose[::side], along=2, span_m=(0.0, _SOFFIT_Z_M - 0.4))
    deck = (-_HALF_DECK_M, _HALF_DECK_M)
    beneath = (
        SpallPlan("S4", (6.1, 12.9), 0.90, 0.60, 0.050, 34),
        SpallPlan("S6", (9.6, 15.2), 0.40, 0.40, 0.035, 36),
    )
    ends = (-_ABUTMENT_Y_M - 1.2, _ABUTMENT_Y_M + 1.2)
    draft.box("soffit", "soffit", (deck, ends, (_SOFFIT_Z_M, _TOP_Z_M)), {"-z": beneath})
    for side in (-1, 1):
        edge = side * _HALF_DECK_M
        draft.box(
            "fascia",
            "aged",
            ((edge, edge + side * 0.25), (-17.5, 17.5), (_TOP_Z_M - 0.25, _TOP_Z_M + 0.2)),
        )
        x = edge + side * 0.1
        for y in np.arange(-17.2, 17.3, 4.3).tolist():  # old concrete posts
            post = ((x - 0.18, x + 0.18), (y - 0.2, y + 0.2), (_TOP_Z_M + 0.2, _TOP_Z_M + 1.35))
            draft.box("parapet", "aged", post)
        put_railing(draft, Railing(height_m=1.0), x_m=(x, x), y_m=(-17.2, 17.2), z_m=_TOP_Z_M + 0.2)
