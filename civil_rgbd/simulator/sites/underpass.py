"""B2: a trail through a low concrete underpass below a road."""

from __future__ import annotations

import numpy as np

from civil_rgbd.simulator.motion import Stroll
from civil_rgbd.simulator.path import WalkPath
from civil_rgbd.simulator.site import Site
from civil_rgbd.simulator.sites.draft import FAR_M, Draft
from civil_rgbd.simulator.sites.furniture import Railing, put_lamp, put_railing, put_sign
from civil_rgbd.simulator.sites.plants import put_bush, put_ivy, put_tufts
from civil_rgbd.simulator.sites.surroundings import Approach, put_approaches, put_green
from civil_rgbd.simulator.sites.traffic import CLOTHES, cyclist, mover, strollers
from civil_rgbd.simulator.spall import SpallPlan

_SUN = (0.50, -0.30, 0.81)
_HALF_LENGTH_M, _WALL_Y_M, _WALL_M = 9.0, 3.2, 0.45
_SOFFIT_Z_M, _SLAB_M, _FILL_M = 3.1, 0.45, 0.6
_TRAIL_M = 1.75
_TOP_Z_M = _SOFFIT_Z_M + _SLAB_M + _FILL_M
_DIMENSIONS_M = {
    "length_m": 2 * _HALF_LENGTH_M,
    "clear_width_m": 2 * _WALL_Y_M,
    "soffit_z_m": _SOFFIT_Z_M,
    "slab_thickness_m": _SLAB_M,
    "wall_thickness_m": _WALL_M,
    "trail_width_m": 2 * _TRAIL_M,
    "road_z_m": _TOP_Z_M,
}


def underpass_site(seed: int) -> Site:
    """Draw B2; the seed places plants and people."""
    rng = np.random.default_rng([seed, 2])
    draft = Draft()
    _passage(draft)
    _ground(draft)
    put_lamp(draft, (-16.0, 2.6), height_m=4.2, arm_m=-0.6, z_m=0.0)
    put_lamp(draft, (17.0, -2.6), height_m=4.2, arm_m=0.6, z_m=0.0)
    put_sign(draft, (-10.6, -2.95), z_m=0.0, turned=False, material="sign")
    for x in (-5.0, 0.0, 5.0):
        draft.box("lamp", "white", ((x - 0.3, x + 0.3), (-0.09, 0.09), (3.02, _SOFFIT_Z_M)))
    draft.box("pipe", "galvanised", ((-9.0, 9.0), (3.06, 3.14), (2.6, 2.68)))
    put_green(draft, rng, sun=_SUN, foot_x_m=17.5, beside_y_m=3.0)
    _wild(draft, rng)
    shirt = CLOTHES[int(rng.integers(len(CLOTHES)))]
    ride = Stroll((0.0, 0.05, 0.0), 45.0, -0.2, 0.02, rng.random())
    movers = [
        *strollers(rng, [((-4.0, 1.65), 12.0, 0.15), ((9.0, 0.95), 9.0, 0.15)], z_m=0.0),
        mover("cyclist-1", cyclist(shirt), ride),
    ]
    corners = ((-15, -2.2), (15, -2.2), (16.5, -1.7), (14, -1.2), (-14, -1.2), (-16.5, -1.7))
    path = WalkPath(tuple((float(x), y, 0.0) for x, y in corners), look_up_deg=6.0)
    scene = draft.scene("B2", _DIMENSIONS_M, _SUN)
    return Site(scene, tuple(movers), tuple(draft.spalls), path)


def _passage(draft: Draft) -> None:
    run = (-_HALF_LENGTH_M, _HALF_LENGTH_M)
    spalls = {
        -1: (
            SpallPlan("B2-1", (5.2, 1.3), 0.70, 0.45, 0.055, 21),
            SpallPlan("B2-2", (11.6, 1.9), 0.28, 0.36, 0.030, 22),
        ),
        1: (
            SpallPlan("B2-3", (7.5, 1.1), 0.95, 0.50, 0.070, 23),
            SpallPlan("B2-4", (14.0, 0.7), 0.14, 0.12, 0.020, 24),
        ),
    }
    for side, hollows in spalls.items():
        walls = (side * _WALL_Y_M, side * (_WALL_Y_M + _WALL_M))
        face = "+y" if side < 0 else "-y"
        draft.box("abutment", "wall", (run, walls, (0.0, _SOFFIT_Z_M)), {face: hollows})
    out = _WALL_Y_M + _WALL_M
    hollows = (
        SpallPlan("B2-5", (6.4, 2.2), 0.50, 0.75, 0.040, 25),
        SpallPlan("B2-6", (12.5, 4.9), 0.34, 0.30, 0.035, 26),
    )
    slab = (_SOFFIT_Z_M, _SOFFIT_Z_M + _SLAB_M)
    draft.box("soffit", "soffit", (run, (-out, out), slab), {"-z": hollows})
    for side in (-1, 1):
        x = side * _HALF_LENGTH_M
        head = (x - side * 0.35, x)
        draft.box("headwall", "wall", (head, (-out, out), (slab[1], _TOP_Z_M + 0.25)))
        middle = x - side * 0.175
        rail = (middle, middle)
        put_railing(draft, Railing(bar_m=0.016), x_m=rail, y_m=(-9.0, 9.0), z_m=_TOP_Z_M + 0.25)
        for end in (-1, 1):
            beyond = (end * out, end * 9.2)
            draft.box("headwall", "wall", (head, beyond, (_TOP_Z_M - 0.5, _TOP_Z_M + 0.25)))
    inner = _HALF_LENGTH_M - 0.35
    draft.box("fill", "road", ((-inner, inner), (-out, out), (slab[1], _TOP_Z_M)))
    put_approaches(draft, Approach(_WALL_Y_M + 0.05, _HALF_LENGTH_M, _TOP_Z_M, 16.0, "wall"))


def _ground(draft: Draft) -> None:
    for x in ((-FAR_M, -30.0), (-30.0, 30.0), (30.0, FAR_M)):
        draft.level("trail", "road", x, (-_TRAIL_M, _TRAIL_M))
        for side in (-1, 1):
            draft.level("verge", "gravel", x, (side * _TRAIL_M, side * (_WALL_Y_M + 0.05)))
            draft.level("grass", "grass", x, (side * (_WALL_Y_M + 0.05), side * FAR_M))
    for side in (-1, 1):
        fence = (side * 20.0, side * 34.0)
        put_railing(draft, Railing(bar_m=0.02), x_m=fence, y_m=(2.4, 2.4), z_m=0.0)


def _wild(draft: Draft, rng: np.random.Generator) -> None:
    for x, y in ((-12.6, 2.95), (12.2, 2.9), (-18.5, 3.3), (19.0, -3.4)):
        put_bush(draft, rng, (x, y, 0.0), radius_m=rng.uniform(0.3, 0.5), sun=_SUN)
    spots = np.stack(
        [rng.uniform(-11.8, -9.2, 220), np.full(220, 3.2), rng.uniform(0.2, 1.0, 220)], axis=1
    )
    spots[:, 2] *= rng.uniform(0.8, 3.6, 220)
    spots[:, 1] -= rng.uniform(0.01, 0.09, 220)
    put_ivy(draft, rng, spots, sun=_SUN)
    xs = rng.uniform(9.5, 18, 50) * np.where(rng.random(50) < 0.5, -1, 1)
    ys = rng.uniform(2.4, 3.0, 50) * np.where(rng.random(50) < 0.5, -1, 1)
    put_tufts(draft, rng, np.stack([xs, ys, np.zeros(50)], axis=1), sun=_SUN)
