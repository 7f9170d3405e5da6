"""Does the camera look where the rig says? Depth edges against image edges, searched around it.

Points of half a second are projected into an image. Where two neighbouring ones lie at different
depths, and the surfaces on both sides go on, there is an edge between them: mostly the picture has
one too. The small rotation of the camera under which most edges meet is how wrong the rig is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import cv2
import numba
import numpy as np
from numpy.typing import NDArray

from civil_rgbd.geometry.camera import PinholeCamera
from civil_rgbd.health.depth_edges import DepthEdges

Floats = NDArray[np.float64]

_FEWEST_EDGES: Final = 400  # of all
_MOST_EDGES: Final = 12_000
_AROUND_PX: Final = 41
_FLOOR: Final = 10.0
_SHRINK: Final = 0.25  # of the maps that the coarse search reads
_SPREADS_PX: Final = (1.0, 1.5)  # of the shrunk maps, and of the whole ones
_REACH_RAD: Final = math.radians(3.0)
_COARSE_RAD: Final = math.radians(0.5)
_MIDDLE_RAD: Final = math.radians(0.06)
_FINE_RAD: Final = math.radians(0.02)
_SPARSE: Final = 3
_GROUPS: Final = 4
_TOPS: Final = 5
_RIVAL_RAD: Final = math.radians(0.4)
_LEAD_SIGMAS: Final = 3.0
_FEWEST_OF_A_PICTURE: Final = 30
_EXPECTED_RAD: Final = math.radians(0.15)
_ODDITY_COSTS: Final = 0.02
"""With less, edges that meet others' win over how the images turn: below a box girder, by 1 deg."""
_ODD: Final = 9.0
_TOO_ODD: Final = 16.0
_SURE_RAD: Final = math.radians(0.15)
_LEAST_CONTRAST: Final = 1.15


@dataclass(frozen=True, slots=True)
class Alignment:
    """How the camera's mounting is off.

    Attributes:
        turn_deg: about the camera's x, y and z: turn the stated camera by it; None where it
            cannot be observed.
        sigma_deg: standard error of its length.
        contrast: edge strength where depth jumps, over that elsewhere, at the best turn.
        contrast_as_given: likewise, as the rig says it.
        edges: how many depth edges were compared.
        why_not: in words, where it cannot be observed.
    """

    turn_deg: tuple[float, float, float] | None
    sigma_deg: float
    contrast: float
    contrast_as_given: float
    edges: int
    why_not: str = ""

    @property
    def angle_deg(self) -> float | None:
        """By how much it is off."""
        if self.turn_deg is None:
            return None
        return math.sqrt(sum(part * part for part in self.turn_deg))


def align(
    edges: DepthEdges,
    expected: tuple[Floats, Floats] | None = None,
    *,
    reach_rad: float = _REACH_RAD,
) -> Alignment:
    """Search the turn of the camera under which the depth edges lie on the pictures' edges.

    Args:
        edges: from :func:`civil_rgbd.health.depth_edges.depth_edges`.
        expected: the turn (3,) that is known otherwise, rad, and its standard errors (3,).
        reach_rad: how far about each axis.
    """
    if len(edges.rays) < _FEWEST_EDGES:
        return Alignment(
            None, 0.0, 1.0, 1.0, len(edges.rays), f"only {len(edges.rays)} depth edges are in view"
        )
    edges = _thinned(edges)
    shrunk = replace(edges, camera=edges.camera.scaled(_SHRINK))
    coarse, fine = _edge_maps(edges.pictures, shrunk.camera)
    everything = np.ones(len(edges.rays), dtype=np.bool_)
    search = _Search(edges, fine, *_softened(expected))
    starts = _tops(_Search(shrunk, coarse, search.expected, search.sigma), reach_rad)
    tops = _climbed(search, [*starts, search.expected])
    best = tops[0]
    contrast, given = (_score(edges, fine, turn, everything) for turn in (best, np.zeros(3)))
    group = edges.picture % _GROUPS
    parts = [group != left_out for left_out in range(_GROUPS)]
    others = np.array([_finest(search, best, part, step_rad=_MIDDLE_RAD) for part in parts])
    # Leaving out one group of four at a time: the jackknife.
    spread = (others - others.mean(axis=0)) ** 2
    sigma = math.sqrt(float(spread.sum()) * (_GROUPS - 1) / _GROUPS)
    why_not = ""
    if np.abs(best).max() >= reach_rad:
        why_not = f"the edges meet nowhere within {math.degrees(reach_rad):g} deg"
    elif contrast < _LEAST_CONTRAST:
        why_not = f"the images hardly show the depth edges: {contrast:.2f} times chance"
    elif search.oddity(best) > _TOO_ODD:
        why_not = "the edges meet where images and poses turn otherwise"
    elif _rivalled(search, tops):
        why_not = "two turns make the edges meet alike: too few of them run across"
    elif sigma > _SURE_RAD:
        why_not = f"parts of the recording disagree: +- {math.degrees(sigma):.2f} deg"
    turn = None if why_not else (*map(math.degrees, best.tolist()),)
    return Alignment(turn, math.degrees(sigma), contrast, given, len(edges.rays), why_not)  # type: ignore[arg-type]  # three


def _thinned(edges: DepthEdges) -> DepthEdges:
    """Leave out every second, or more: neighbours say the same."""
    step = -(-len(edges.rays) // _MOST_EDGES)
    return replace(
        edges,
        rays=edges.rays[::step],
        upright=edges.upright[::step],
        picture=edges.picture[::step],
    )


def _edge_maps(
    pictures: NDArray[np.uint8], shrunk: PinholeCamera
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return edges across columns, and across rows, beside their surroundings.

    Returns:
        (2, P, h, w) as a shrunk camera sees them, spread widely, and (2, P, H, W): float32, of
        mean 1.
    """
    size = shrunk.width_px, shrunk.height_px
    coarse = np.empty((2, len(pictures), *size[::-1]), dtype=np.float32)
    fine = np.empty((2, *pictures.shape), dtype=np.float32)
    for number, grey in enumerate(pictures):
        smooth = cv2.GaussianBlur(grey, (0, 0), 0.8)
        for axis in (0, 1):
            steep = np.abs(cv2.Sobel(smooth, cv2.CV_32F, 1 - axis, axis))
            around = cv2.blur(steep, (_AROUND_PX, _AROUND_PX)) + _FLOOR
            edge = np.minimum(steep, 4 * around) / around
            small = cv2.resize(edge, size, interpolation=cv2.INTER_AREA)
            for maps, seen, spread_px in zip(
                (coarse, fine), (small, edge), _SPREADS_PX, strict=True
            ):
                near = cv2.GaussianBlur(seen, (0, 0), spread_px)
                maps[axis, number] = near / (cv2.mean(near)[0] + 1e-6)
    return coarse, fine


@dataclass(frozen=True, slots=True, eq=False)
class _Search:
    """Edges and their maps, and what is known of the turn beside them."""

    edges: DepthEdges
    maps: NDArray[np.float32]
    expected: Floats
    sigma: Floats

    def oddity(self, turns: Floats) -> Floats:
        """Return how far (T, 3) turns lie from the expected one, in squared standard errors."""
        off: Floats = (((turns - self.expected) / self.sigma) ** 2).sum(axis=-1)
        return off

    def worth(self, turns: Floats, chosen: NDArray[np.bool_]) -> Floats:
        """Return the edge strength less what the turns' oddity costs."""
        return _scores(self.edges, self.maps, turns, chosen) - _ODDITY_COSTS * self.oddity(turns)


def _softened(expected: tuple[Floats, Floats] | None) -> tuple[Floats, Floats]:
    if expected is None:
        return np.zeros(3), np.full(3, np.inf)
    turn, sigma = expected
    return turn, np.maximum(1.2 * sigma, _EXPECTED_RAD)


def _tops(search: _Search, reach_rad: float) -> list[Floats]:
    """Return the best turns of a coarse grid that lie apart."""
    steps = np.arange(-reach_rad, reach_rad + 1e-9, _COARSE_RAD)
    rolls = np.arange(-reach_rad, reach_rad + 1e-9, 2 * _COARSE_RAD)
    turns = np.array([(x, y, z) for x in steps for y in steps for z in rolls])
    count = len(search.edges.rays)
    scores = search.worth(turns, np.arange(count) % max(1, count // 6_000) == 0)
    found: list[Floats] = []
    for at in np.argsort(-scores).tolist():
        if all(_apart(turns[at], other) > 2 * _RIVAL_RAD for other in found):
            found.append(turns[at])
        if len(found) == _TOPS:
            break
    return found


def _apart(turn: Floats, other: Floats) -> float:
    # The roll is coarser in the grid, and moves the edges near the middle hardly at all.
    off = (turn - other) * np.array([1.0, 1.0, 0.5])
    return float(np.sqrt((off**2).sum()))


def _rivalled(search: _Search, tops: list[Floats]) -> bool:
    """Whether a turn that lies apart from the best one fits about as well, picture by picture."""
    edges, maps = search.edges, search.maps
    pictures = [edges.picture == number for number in range(len(edges.pictures))]
    pictures = [chosen for chosen in pictures if chosen.sum() >= _FEWEST_OF_A_PICTURE]
    if len(pictures) < _GROUPS:
        return True
    best = np.array([_score(edges, maps, tops[0], chosen) for chosen in pictures])
    for other in tops[1:]:
        odd = search.oddity(other) - search.oddity(tops[0]) > _ODD
        if _apart(tops[0], other) > _RIVAL_RAD and not odd:
            lead = best - [_score(edges, maps, other, chosen) for chosen in pictures]
            # Pictures of one stretch are much the same: their mean is less sure than its error.
            if lead.mean() < _LEAD_SIGMAS * lead.std() / math.sqrt(len(lead)):
                return True
    return False


def _climbed(search: _Search, starts: list[Floats]) -> list[Floats]:
    """Climb from every start, and return the tops that lie apart, the best one first."""
    count = len(search.edges.rays)
    everything, some = np.ones(count, np.bool_), np.arange(count) % _SPARSE == 0
    near: list[Floats] = []
    for start in starts:
        top = _finest(search, start, some, least_rad=_MIDDLE_RAD)
        if all(_apart(top, other) > _MIDDLE_RAD for other in near):
            near.append(top)
    tops = [_finest(search, top, everything, step_rad=_MIDDLE_RAD) for top in near]
    tops.sort(key=lambda top: -float(search.worth(top[np.newaxis], everything)[0]))
    return tops


def _finest(
    search: _Search,
    start: Floats,
    chosen: NDArray[np.bool_],
    *,
    step_rad: float = _COARSE_RAD / 2,
    least_rad: float = _FINE_RAD,
) -> Floats:
    """Climb from a start: all neighbours at a step, halved when none is better."""
    cube = np.array([(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1)])
    best, step, score = start, step_rad, -np.inf
    while step > least_rad:
        turns = best + step * cube
        scores = search.worth(turns, chosen)
        at = int(scores.argmax())
        if scores[at] > score + 1e-9 and at != len(cube) // 2:
            best, score = turns[at], float(scores[at])
        else:
            score = max(score, float(scores[len(cube) // 2]))
            step /= 2
    return best


def _score(
    edges: DepthEdges, maps: NDArray[np.float32], turn: Floats, chosen: NDArray[np.bool_]
) -> float:
    return float(_scores(edges, maps, turn[np.newaxis], chosen)[0])


def _scores(
    edges: DepthEdges, maps: NDArray[np.float32], turns: Floats, chosen: NDArray[np.bool_]
) -> Floats:
    """Return the mean edge strength under the depth edges for each of (T, 3) turns."""
    camera, scores = edges.camera, np.zeros(len(turns))
    _sum_edges(
        edges.rays[chosen], edges.upright[chosen], edges.picture[chosen], maps, turns,
        np.array([camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px]), scores,
    )  # fmt: skip
    return scores


@numba.njit(cache=True)
def _sum_edges(rays, upright, picture, maps, turns, K, scores):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202, PLR0917  # a kernel: numba infers
    height, width = maps.shape[2], maps.shape[3]
    for n in range(len(turns)):
        # The camera turns by it, so the directions turn back: first order is enough here.
        a, b, c = -turns[n, 0], -turns[n, 1], -turns[n, 2]
        total, count = np.zeros(2), np.zeros(2)
        for i in range(len(rays)):
            x, y = rays[i, 0], rays[i, 1]
            z = 1.0 + a * y - b * x
            u = K[0] * (x + b - c * y) / z + K[2]
            v = K[1] * (y + c * x - a) / z + K[3]
            left, top = math.floor(u), math.floor(v)
            if left < 0 or top < 0 or left >= width - 1 or top >= height - 1:
                continue
            axis = 0 if upright[i] else 1
            layer = maps[axis, picture[i]]
            du, dv = u - left, v - top
            total[axis] += (1 - dv) * ((1 - du) * layer[top, left] + du * layer[top, left + 1])
            total[axis] += dv * ((1 - du) * layer[top + 1, left] + du * layer[top + 1, left + 1])
            count[axis] += 1
        # Both count alike: level edges are few beside tall piers, but they alone hold the pitch.
        share = np.sqrt(count)
        scores[n] = (share * total / np.maximum(count, 1)).sum() / max(share.sum(), 1.0)
