"""A drawing board: boxes, strips and panels go in, a scene comes out."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.simulator.scene import Face, Scene, prism
from civil_rgbd.simulator.spall import Panel, Spall, SpallPlan, spalled
from civil_rgbd.simulator.waves import cosine, sine

Span = tuple[float, float]

FAR_M: Final = 150.0
"""Where the ground ends."""

_NEAR_M: Final = 50.0
_LONGEST_M: Final = 12.0  # longer faces are cut up, so that their light map stays fine
_FACINGS: Final = {
    "+x": ((0, 1, 0), (0, 0, 1)),
    "-x": ((0, -1, 0), (0, 0, 1)),
    "+y": ((-1, 0, 0), (0, 0, 1)),
    "-y": ((1, 0, 0), (0, 0, 1)),
    "+z": ((1, 0, 0), (0, 1, 0)),
    "-z": ((1, 0, 0), (0, -1, 0)),
}
"""The side of a box, and its axes along and up as one sees them from outside."""


class Draft:
    """Collects faces and hollows until :meth:`scene` is asked for.

    Attributes:
        faces: so far.
        spalls: so far.
    """

    def __init__(self) -> None:
        self.faces: list[Face] = []
        self.spalls: list[Spall] = []

    def box(
        self,
        part: str,
        material: str,
        spans: tuple[Span, Span, Span],
        hollows: Mapping[str, tuple[SpallPlan, ...]] | None = None,
    ) -> None:
        """Add a box.

        Args:
            part: what it belongs to.
            material: of all its sides.
            spans: along x, y and z, either end first.
            hollows: spalls by side, such as ``+y``; along and up begin at the side's lower left
                corner as seen from outside (seen from below, y points down).
        """
        ends = np.array([sorted(span) for span in spans])
        for side in _FACINGS:
            faces, spalls = spalled(
                _side(part, material, ends, side), (hollows or {}).get(side, ())
            )
            self.faces += faces
            self.spalls += spalls

    def bar(
        self,
        part: str,
        material: str,
        outline_m: NDArray[np.float64] | list[Span],
        *,
        along: int,
        span_m: Span,
    ) -> None:
        """Add a convex outline, either way round, extruded along an axis as :func:`prism` does."""
        start, end = sorted(span_m)
        corners = np.asarray(outline_m, dtype=np.float64)
        (a, b), (c, d) = corners.T, np.roll(corners, -1, axis=0).T
        outline_m = corners if (a * d - c * b).sum() > 0 else corners[::-1]
        self.faces += prism(part, material, outline_m, along=along, start_m=start, end_m=end)

    def column(
        self, part: str, material: str, middle_m: Span, *, radius_m: float, z_m: Span
    ) -> None:
        """Add an upright octagonal column."""
        outline = octagon() * radius_m + np.array(middle_m)
        self.bar(part, material, outline, along=2, span_m=z_m)

    def level(self, part: str, material: str, x_m: Span, y_m: Span, z_m: float = 0.0) -> None:
        """Add level ground, cut where far becomes near."""
        for x0, x1 in _cut(x_m):
            for y0, y1 in _cut(y_m):
                corners = [(x0, y0, z_m), (x1, y0, z_m), (x1, y1, z_m), (x0, y1, z_m)]
                self.faces.append(Face(part, material, np.array(corners)))

    def strips(
        self, x_m: Span, strips: Iterable[tuple[str, str, Span, float]], foot_z_m: float = 0.0
    ) -> None:
        """Add strips of ground side by side along x: part, material, span along y, height."""
        for part, material, y_m, z in strips:
            if z == foot_z_m:
                self.level(part, material, x_m, y_m, z)
            else:
                self.box(part, material, (x_m, y_m, (foot_z_m, z)))

    def add(self, faces: Iterable[Face]) -> None:
        """Add faces that are drawn already."""
        self.faces += faces

    def scene(self, name: str, dimensions_m: dict[str, float], sun: tuple[float, ...]) -> Scene:
        """Return all of it as a scene."""
        faces = [piece for face in self.faces for piece in _pieces(face)]
        x, y, z = np.asarray(sun) / np.sqrt(sum(s * s for s in sun))
        towards = (float(x), float(y), float(z))
        return Scene(name, tuple(faces), dimensions_m, towards, seamless=True)


def octagon() -> NDArray[np.float64]:
    """Return (8, 2) corners at distance 1, anticlockwise, a side across each axis."""
    eighths = (np.arange(8) + 0.5) / 8
    return np.stack([cosine(eighths), sine(eighths)], axis=1)


def _side(part: str, material: str, ends_m: NDArray[np.float64], side: str) -> Panel:
    along, up = (np.array(axis, dtype=np.float64) for axis in _FACINGS[side])
    out = {"+": 1, "-": 0}[side[0]]
    fixed = "xyz".index(side[1])
    origin = np.where(along + up >= 0, ends_m[:, 0], ends_m[:, 1])
    origin[fixed] = ends_m[fixed, out]
    size = ends_m[:, 1] - ends_m[:, 0]
    lengths = (float((np.abs(along) * size).sum()), float((np.abs(up) * size).sum()))
    return Panel(part, material, origin, along, up, lengths)


def _cut(span: Span) -> list[Span]:
    low, high = sorted(span)
    return list(pairwise([low, *(at for at in (-_NEAR_M, _NEAR_M) if low < at < high), high]))


def _pieces(face: Face) -> list[Face]:
    """Cut an upright or level rectangle that is too long into equal ones."""
    corners = face.corners_m
    if len(corners) != 4:  # a rectangle
        return [face]
    a, b = corners[1] - corners[0], corners[3] - corners[0]
    straight = np.count_nonzero(a) == 1 and np.count_nonzero(b) == 1
    square = np.array_equal(corners[0] + (a + b), corners[2])
    low, high = corners.min(axis=0), corners.max(axis=0)
    away = np.maximum(np.maximum(low, -high), 0.0)[:2].max()  # from x = y = 0
    longest = _LONGEST_M if away < _NEAR_M - _LONGEST_M else 4 * _LONGEST_M
    counts = [int(np.ceil(np.abs(side).max() / longest)) for side in (a, b)]
    if not (straight and square) or max(counts) == 1:
        return [face]
    across = np.linspace(corners[0], corners[1], counts[0] + 1)
    return [
        Face(face.part, face.material, np.stack([p + b * s, q + b * s, q + b * e, p + b * e]))
        for p, q in pairwise(across)
        for s, e in pairwise(k / counts[1] for k in range(counts[1] + 1))
    ]
