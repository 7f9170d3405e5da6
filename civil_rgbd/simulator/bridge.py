"""The bridges: true dimensions in, faces out."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.simulator.scene import Face, RayCaster, Scene, box, polygon, prism
from civil_rgbd.simulator.waves import cosine, sine


@dataclass(frozen=True, slots=True)
class GirderBridge:
    """A road underpass of two spans. Girders run along y; the walk passes under them along x.

    Attributes:
        deck_width_m: of the deck, along x.
        abutment_y_m: the abutments' front walls stand at plus and minus this.
        abutment_height_m: from the road to the bearing seat.
        bearing_height_m: between seat and girder.
        girder_count: how many girders.
        girder_spacing_m: between their middles, along x.
        girder_width_m: of one girder.
        girder_depth_m: of one girder, below the deck's soffit.
        deck_thickness_m: of the slab.
        parapet_height_m: above the deck.
        kerb_height_m: of sidewalks and median above the road.
        sidewalk_y_m: sidewalks begin at plus and minus this.
        median_y_m: half the width of the strip on which the pier stands.
        column_radius_m: of the pier's octagonal columns, to their corners.
        column_x_m: where they stand.
        cap_depth_m: height of the pier's cap beam.
    """

    deck_width_m: float = 9.0
    abutment_y_m: float = 9.0
    abutment_height_m: float = 4.9
    bearing_height_m: float = 0.1
    girder_count: int = 4
    girder_spacing_m: float = 2.3
    girder_width_m: float = 0.45
    girder_depth_m: float = 0.9
    deck_thickness_m: float = 0.25
    parapet_height_m: float = 0.9
    kerb_height_m: float = 0.15
    sidewalk_y_m: float = 6.2
    median_y_m: float = 1.2
    column_radius_m: float = 0.45
    column_x_m: tuple[float, ...] = (-3.0, 0.0, 3.0)
    cap_depth_m: float = 0.7

    @property
    def girder_soffit_z_m(self) -> float:
        """Underside of the girders above the road."""
        return self.abutment_height_m + self.bearing_height_m

    @property
    def deck_soffit_z_m(self) -> float:
        """Underside of the slab above the road."""
        return self.girder_soffit_z_m + self.girder_depth_m

    @property
    def deck_top_z_m(self) -> float:
        """Top of the slab above the road."""
        return self.deck_soffit_z_m + self.deck_thickness_m

    @property
    def girder_x_m(self) -> tuple[float, ...]:
        """Middles of the girders."""
        middle = (self.girder_count - 1) / 2
        return tuple((i - middle) * self.girder_spacing_m for i in range(self.girder_count))

    def dimensions_m(self) -> dict[str, float]:
        """Return every length by name."""
        lengths = {k: v for k, v in asdict(self).items() if isinstance(v, float)}
        return {
            **lengths,
            "girder_soffit_z_m": self.girder_soffit_z_m,
            "deck_soffit_z_m": self.deck_soffit_z_m,
            "deck_top_z_m": self.deck_top_z_m,
        }


_EMBANKMENT_FOOT_X_M = 15.0
_WING_Y_M = 0.6  # the wing walls stand this far behind the abutments' fronts
_FAR_M = 130.0
_NEAR_M = 26.0


def girder_bridge(b: GirderBridge, *, name: str) -> Scene:
    """Build the scene of a girder bridge."""
    faces = [*_superstructure(b), *_pier(b), *_ground(b), *_trees()]
    for side in (-1, 1):
        faces += _abutment(b, side)
    return Scene(name, tuple(faces), b.dimensions_m())


def _spanning(
    part: str,
    material: str,
    x_m: tuple[float, float],
    y_m: tuple[float, float],
    z_m: tuple[float, float],
) -> list[Face]:
    x, y, z = sorted(x_m), sorted(y_m), sorted(z_m)
    return box(part, material, (x[0], y[0], z[0]), (x[1], y[1], z[1]))


def _superstructure(b: GirderBridge) -> list[Face]:
    edge, end = b.deck_width_m / 2, b.abutment_y_m + 1.0
    soffit, low = b.deck_soffit_z_m, b.girder_soffit_z_m
    faces = _spanning("deck", "slab", (-edge, edge), (-end, end), (soffit, b.deck_top_z_m))
    half = b.girder_width_m / 2
    for x in b.girder_x_m:
        reach = b.abutment_y_m + 0.5
        faces += _spanning("girder", "girder", (x - half, x + half), (-reach, reach), (low, soffit))
        for y in (-b.abutment_y_m - 0.25, 0.0, b.abutment_y_m + 0.25):
            faces += _spanning(
                "bearing", "rubber", (x - 0.15, x + 0.15), (y - 0.15, y + 0.15),
                (b.abutment_height_m, low),
            )  # fmt: skip
    for left, right in pairwise(b.girder_x_m):
        for y in (-b.abutment_y_m / 2, b.abutment_y_m / 2):
            faces += _spanning(
                "diaphragm", "girder", (left + half, right - half), (y - 0.125, y + 0.125),
                (low + 0.3, soffit),
            )  # fmt: skip
    for side in (-1, 1):
        faces += _spanning(
            "parapet", "slab", (side * edge, side * (edge - 0.25)), (-end - 12, end + 12),
            (b.deck_top_z_m, b.deck_top_z_m + b.parapet_height_m),
        )  # fmt: skip
    x = -edge - 0.04
    return faces + _spanning(
        "sign", "sign", (x, x + 0.04), (-4.9, -3.7), (soffit - 0.55, soffit + 0.15)
    )


def _pier(b: GirderBridge) -> list[Face]:
    top, kerb = b.abutment_height_m, b.kerb_height_m
    reach = b.deck_width_m / 2 - 0.2
    cap = top - b.cap_depth_m
    faces = _spanning("pier", "girder", (-reach, reach), (-0.5, 0.5), (cap, top))
    outline = _octagon() * b.column_radius_m
    for x in b.column_x_m:
        faces += prism(
            "pier", "wall", outline + np.array([x, 0.0]), along=2, start_m=kerb, end_m=cap
        )
    return faces


def _abutment(b: GirderBridge, side: int) -> list[Face]:
    front, reach = side * b.abutment_y_m, b.deck_width_m / 2 + 0.7
    wing, seat = front + side * _WING_Y_M, b.abutment_height_m
    back, top = wing + side * 0.4, b.deck_top_z_m
    faces = _spanning("abutment", "wall", (-reach, reach), (front, back), (0.0, seat))
    faces += _spanning("abutment", "wall", (-reach, reach), (wing, back), (seat, b.deck_soffit_z_m))
    # Wing walls hold the embankment's end; both follow its slope. Outlines are z, x.
    foot = _EMBANKMENT_FOOT_X_M
    low, high = sorted((wing, back))
    right = [(0.0, reach), (top + 0.2, reach), (0.5, foot), (0.0, foot)]
    left = [(z, -x) for z, x in reversed(right)]
    for outline in (right, left):
        faces += prism("wing", "wall", outline, along=1, start_m=low, end_m=high)
    slope = [(0.0, -foot), (top, -reach), (top, reach), (0.0, foot)]
    low, high = sorted((back, side * _FAR_M))
    return faces + prism("embankment", "grass", slope, along=1, start_m=low, end_m=high)


def _ground(b: GirderBridge) -> list[Face]:
    kerb, walk, wing = b.kerb_height_m, b.sidewalk_y_m, b.abutment_y_m + _WING_Y_M
    faces: list[Face] = []
    for x in ((-_FAR_M, -_NEAR_M), (-_NEAR_M, _NEAR_M), (_NEAR_M, _FAR_M)):
        for side in (-1, 1):
            faces += _spanning("sidewalk", "paving", x, (side * walk, side * wing), (0.0, kerb))
            faces.append(_level("road", "road", x, (side * b.median_y_m, side * walk)))
            faces.append(_level("grass", "grass", x, (side * wing, side * _FAR_M)))
        faces += _spanning("median", "paving", x, (-b.median_y_m, b.median_y_m), (0.0, kerb))
    return faces


def _level(part: str, material: str, x_m: tuple[float, float], y_m: tuple[float, float]) -> Face:
    (x0, x1), (y0, y1) = sorted(x_m), sorted(y_m)
    return polygon(part, material, [(x0, y0, 0), (x1, y0, 0), (x1, y1, 0), (x0, y1, 0)])


def _trees() -> list[Face]:
    rng = np.random.default_rng(7)
    trunk = np.array([0.2, 0.2, 2.5])
    faces: list[Face] = []
    for index in range(26):
        end, side = 1 if index % 2 else -1, 1 if index % 4 < 2 else -1
        place = np.array([end * rng.uniform(45, 120), side * rng.uniform(12, 42), 0.0])
        size = np.array([1.0, 1.0, 1.5]) * rng.uniform(2.2, 3.6)
        faces += _crown(place + np.array([0.0, 0.0, 1.4]), size)
        faces += box("tree", "bark", place - trunk * [1, 1, 0], place + trunk)
    return faces


def _crown(foot_m: NDArray[np.float64], size_m: NDArray[np.float64]) -> list[Face]:
    """Stack octagonal rings that widen, then narrow."""
    rings = [
        np.stack([*(_octagon() * radius).T, np.full(8, height)], axis=1) * size_m + foot_m
        for radius, height in ((0.45, 0.0), (0.95, 0.45), (0.9, 1.1), (0.4, 1.75))
    ]
    faces = [Face("tree", "foliage", rings[0][::-1]), Face("tree", "foliage", rings[-1])]
    for lower, upper in pairwise(rings):
        faces += [
            Face("tree", "foliage", np.stack([lower[i - 1], lower[i], upper[i], upper[i - 1]]))
            for i in range(8)
        ]
    return faces


def _octagon() -> NDArray[np.float64]:
    eighths = (np.arange(8) + 0.5) / 8
    return np.stack([cosine(eighths), sine(eighths)], axis=1)


@cache
def scene_of(bridge: str) -> Scene:
    """Return the scene of a bridge by name."""
    return {"demo": lambda: girder_bridge(GirderBridge(), name="demo")}[bridge]()


@cache
def caster_of(bridge: str) -> RayCaster:
    """Return the rays of a bridge by name."""
    return RayCaster(scene_of(bridge))
