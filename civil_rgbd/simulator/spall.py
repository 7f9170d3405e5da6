"""Spalls: hollows of known length, width and depth, broken out of a flat face."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.simulator.scene import Face
from civil_rgbd.simulator.waves import cosine, sine

_POINTS = 36
_RIM, _FLOOR = 0.88, 0.5  # rings inside the outline, as shares of its radius
_MARGIN_M = 0.05

_SEVERITIES: Final = ((0.15, "light"), (0.3, "medium"), (0.6, "severe"))
_WORST: Final = "very severe"


@dataclass(frozen=True, slots=True)
class SpallPlan:
    """A spall to be broken out of a face.

    Attributes:
        name: unique in its site.
        at_m: its middle on the face: along, up.
        length_m: its extent along the face, exactly.
        width_m: its extent up the face, exactly.
        depth_m: of its deepest point below the face, exactly.
        seed: of its outline and its floor.
    """

    name: str
    at_m: tuple[float, float]
    length_m: float
    width_m: float
    depth_m: float
    seed: int


@dataclass(frozen=True, slots=True, eq=False)
class Spall:
    """The truth about a spall.

    Attributes:
        name: unique in its site.
        part: what it was broken out of: ``abutment``, ``pier``, ``soffit``.
        length_m: extent along ``along``.
        width_m: extent along ``up``.
        depth_m: of the deepest point below the face.
        area_m2: inside the outline, on the face.
        centre_m: (3,) middle of the extents, on the face as it was.
        deepest_m: (3,) the deepest point.
        along: (3,) unit.
        up: (3,) unit.
        normal: (3,) unit, out of the concrete.
        outline_m: (K, 3) corners of the rim, on the face.
    """

    name: str
    part: str
    length_m: float
    width_m: float
    depth_m: float
    area_m2: float
    centre_m: NDArray[np.float64]
    deepest_m: NDArray[np.float64]
    along: NDArray[np.float64]
    up: NDArray[np.float64]
    normal: NDArray[np.float64]
    outline_m: NDArray[np.float64]

    @property
    def severity(self) -> str:
        """Severity by the largest dimension, as the Ontario Structure Inspection Manual has it."""
        largest = max(self.length_m, self.width_m)
        return next((word for limit, word in _SEVERITIES if largest < limit), _WORST)


@dataclass(frozen=True, slots=True, eq=False)
class Panel:
    """A rectangle of a wall or a soffit.

    Attributes:
        part: what it belongs to.
        material: of the whole face.
        origin_m: (3,) its lower left corner as seen from outside.
        along: (3,) unit, to the right.
        up: (3,) unit.
        size_m: length along and up.
    """

    part: str
    material: str
    origin_m: NDArray[np.float64]
    along: NDArray[np.float64]
    up: NDArray[np.float64]
    size_m: tuple[float, float]

    @property
    def normal(self) -> NDArray[np.float64]:
        """(3,) unit, out of the concrete."""
        normal: NDArray[np.float64] = np.cross(self.along, self.up)
        return normal

    def point(self, a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (..., 3) points of the scene at (...,) metres along and up."""
        a, b = np.asarray(a)[..., np.newaxis], np.asarray(b)[..., np.newaxis]
        return self.origin_m + a * self.along + b * self.up

    def face(self, low: tuple[float, float], high: tuple[float, float]) -> Face:
        """Return the rectangle between two corners, along and up."""
        a = np.array([low[0], high[0], high[0], low[0]])
        b = np.array([low[1], low[1], high[1], high[1]])
        return Face(self.part, self.material, self.point(a, b))


def spalled(panel: Panel, plans: tuple[SpallPlan, ...]) -> tuple[list[Face], list[Spall]]:
    """Break spalls out of a panel.

    Args:
        panel: the face.
        plans: spalls, whose squares must not meet each other or the panel's edge.

    Returns:
        the faces of the panel and of its hollows; the truth about each hollow.

    Raises:
        ValueError: a spall does not fit.
    """
    faces: list[Face] = []
    spalls: list[Spall] = []
    _cut(panel, (0.0, 0.0), panel.size_m, list(plans), (faces, spalls))
    return faces, spalls


def _window(plan: SpallPlan) -> tuple[tuple[float, float], tuple[float, float]]:
    half = (plan.length_m / 2 + _MARGIN_M, plan.width_m / 2 + _MARGIN_M)
    (a, b) = plan.at_m
    return (a - half[0], b - half[1]), (a + half[0], b + half[1])


def _cut(
    panel: Panel,
    low: tuple[float, float],
    high: tuple[float, float],
    plans: list[SpallPlan],
    found: tuple[list[Face], list[Spall]],
) -> None:
    """Cut a rectangle into strips round its first spall; what is left goes the same way."""
    if min(high[0] - low[0], high[1] - low[1]) <= 0:
        return
    if not plans:
        found[0].append(panel.face(low, high))
        return
    first, others = plans[0], plans[1:]
    (a0, b0), (a1, b1) = _window(first)
    if a0 < low[0] or b0 < low[1] or a1 > high[0] or b1 > high[1]:
        raise ValueError(f"spall {first.name!r} does not fit on its {panel.part}")
    upright = [
        *((low, (a0, high[1])), ((a1, low[1]), high)),
        *(((a0, low[1]), (a1, b0)), ((a0, b1), (a1, high[1]))),
    ]
    level = [
        *((low, (high[0], b0)), ((low[0], b1), high)),
        *(((low[0], b0), (a0, b1)), ((a1, b0), (high[0], b1))),
    ]
    for strips in (upright, level):
        shares = [[p for p in others if _lies_in(p, *strip)] for strip in strips]
        if sum(map(len, shares)) == len(others):
            break
    else:
        raise ValueError(f"spall {first.name!r} is in another one's way on its {panel.part}")
    for strip, share in zip(strips, shares, strict=True):
        _cut(panel, *strip, share, found)
    faces, spall = _hollow(panel, first)
    found[0].extend(faces)
    found[1].append(spall)


def _lies_in(plan: SpallPlan, low: tuple[float, float], high: tuple[float, float]) -> bool:
    (a0, b0), (a1, b1) = _window(plan)
    return a0 >= low[0] and b0 >= low[1] and a1 <= high[0] and b1 <= high[1]


def _hollow(panel: Panel, plan: SpallPlan) -> tuple[list[Face], Spall]:
    rng = np.random.default_rng([plan.seed, 11])
    outline = _outline(rng, plan)  # (K, 2), about the middle
    middle = np.asarray(plan.at_m)
    rings = [
        (outline, np.zeros(_POINTS)),
        (outline * _ragged(rng, _RIM), rng.uniform(0.45, 0.75, _POINTS)),
        (outline * _ragged(rng, _FLOOR), rng.uniform(0.6, 0.95, _POINTS)),
    ]
    lifted = [
        panel.point(*(middle + flat).T) - (plan.depth_m * share)[:, np.newaxis] * panel.normal
        for flat, share in rings
    ]
    deepest = panel.point(middle[0], middle[1]) - plan.depth_m * panel.normal
    faces = _surround(panel, plan, middle + outline)
    after = [*range(1, _POINTS), 0]
    for outer, inner in zip(lifted, [*lifted[1:], None], strict=True):
        for i, j in enumerate(after):
            if inner is None:
                faces.append(_spall_face(panel, outer[i], outer[j], deepest))
            else:
                faces.append(_spall_face(panel, outer[i], outer[j], inner[i]))
                faces.append(_spall_face(panel, outer[j], inner[j], inner[i]))
    a, b = outline.T
    area = float(np.abs((a * b[after] - a[after] * b).sum())) / 2
    truth = Spall(
        plan.name, panel.part, plan.length_m, plan.width_m, plan.depth_m, area,
        panel.point(middle[0], middle[1]), deepest,
        panel.along, panel.up, panel.normal, lifted[0],
    )  # fmt: skip
    return faces, truth


def _spall_face(panel: Panel, *corners: NDArray[np.float64]) -> Face:
    return Face(panel.part, "spall", np.stack(corners))


def _ragged(rng: np.random.Generator, share: float) -> NDArray[np.float64]:
    return rng.uniform(0.92, 1.08, (_POINTS, 1)) * share


def _directions() -> NDArray[np.float64]:
    turns = (np.arange(_POINTS) + 0.5) / _POINTS
    return np.stack([cosine(turns), sine(turns)], axis=1)


def _outline(rng: np.random.Generator, plan: SpallPlan) -> NDArray[np.float64]:
    """Return (K, 2) corners, anticlockwise, whose extents are exactly those of the plan."""
    turns = (np.arange(_POINTS) + 0.5) / _POINTS
    radius = np.ones(_POINTS)
    for wave, swing in ((2, 0.12), (3, 0.12), (5, 0.07), (8, 0.05)):
        radius += swing * rng.uniform(0.3, 1.0) * sine(wave * turns + rng.random())
    radius += rng.uniform(-0.05, 0.05, _POINTS)
    flat = _directions() * radius[:, np.newaxis]
    low, high = flat.min(axis=0), flat.max(axis=0)
    size = np.array([plan.length_m, plan.width_m])
    exact: NDArray[np.float64] = (flat - (low + high) / 2) * (size / (high - low))
    return exact


def _surround(panel: Panel, plan: SpallPlan, outline: NDArray[np.float64]) -> list[Face]:
    """Fill what the outline leaves of its window: one quadrilateral a side of the outline."""
    (a0, b0), (a1, b1) = _window(plan)
    middle = np.asarray(plan.at_m)
    half = np.array([(a1 - a0) / 2, (b1 - b0) / 2])
    corners = [(a1, b1), (a0, b1), (a0, b0), (a1, b0)]
    on_edge = []
    for spoke in outline - middle:
        # Out to the window: the axis that gets there first is put exactly onto it.
        reach = np.abs(spoke) / half
        axis = int(np.argmax(reach))
        hit = middle + spoke / reach[axis]
        hit[axis] = (a1, b1)[axis] if spoke[axis] > 0 else (a0, b0)[axis]
        on_edge.append(hit)
    faces = []
    for i in range(_POINTS):
        j = (i + 1) % _POINTS
        ring = [outline[i], on_edge[i], on_edge[j], outline[j]]
        between = [
            corner for corner in corners if _turns_left(middle, on_edge[i], corner, on_edge[j])
        ]
        ring[2:2] = [np.asarray(corner) for corner in between]
        a, b = np.stack(ring).T
        faces += _convex_pieces(panel, panel.point(a, b))
    return faces


def _turns_left(
    middle: NDArray[np.float64],
    start: NDArray[np.float64],
    corner: tuple[float, float],
    end: NDArray[np.float64],
) -> bool:
    """Tell whether a corner of the window lies between two spokes, less than half a turn apart."""
    s, c, e = start - middle, np.asarray(corner) - middle, end - middle
    return bool(s[0] * c[1] - s[1] * c[0] > 0 and c[0] * e[1] - c[1] * e[0] > 0)


def _convex_pieces(panel: Panel, corners_m: NDArray[np.float64]) -> list[Face]:
    # With a window's corner in it the ring has five corners: it is convex seen from that corner.
    if len(corners_m) == 4:  # the plain case
        return [Face(panel.part, panel.material, corners_m)]
    outer = np.roll(corners_m, -2, axis=0)
    return [Face(panel.part, panel.material, outer[[0, k, k + 1]]) for k in range(1, 4)]
