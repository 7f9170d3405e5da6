"""Are the poses one smooth way, and do points of different times agree through them?"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.constants import NS_PER_S
from civil_rgbd.geometry.trajectory import Trajectory
from civil_rgbd.health.checks import Figure
from civil_rgbd.health.sampling import Stretch
from civil_rgbd.odometry.surfaces import Planes, cells_of, keys_of, planes_of

Floats = NDArray[np.float64]

_NEIGHBOURS: Final = 3
_LONGEST_STEP_NS: Final = NS_PER_S // 4
_PUSH_M_S2: Final = 5.0
_TWIST_RAD_S2: Final = 10.0
"""What a carried or driven sensor may do between two poses, and be no jump."""
_OFTEN: Final = 1.5
"""Nine of ten steps differ less; the liveliest of a walk differ by half as much again."""

_DISJOINT_NS: Final = 1_600_000_000  # stretches with the points around them do not share any
_SOURCE_POINTS: Final = 12_000
_FEWEST_POINTS: Final = 400
_ROUNDS: Final = 8
_WIDEST_M, _NARROWEST_M = 0.5, 0.1
_USUAL_M, _USUAL_RAD = 0.5, 0.05
_DOUBT_M: Final = 0.2
"""Neighbouring points share their errors: a hundred of them say what one of 2 cm says."""
_PRIOR: Final = np.diag(_DOUBT_M**2 / np.array([*[_USUAL_RAD] * 3, *[_USUAL_M] * 3]) ** 2)
_HELD_SHARE: Final = 0.015
_MOSTLY: Final = 0.6
"""A direction that so large a share of the pairs leaves open was hardly judged."""


def jump_figures(trajectory: Trajectory) -> Iterator[Figure]:
    """Find steps of the poses that no motion explains: those before and after do not make them."""
    steps_ns = np.diff(trajectory.stamps_ns)
    if len(steps_ns) < 2 * _NEIGHBOURS:
        yield from (Figure(code, None, "too few poses") for code in ("pose-jump", "pose-jerk"))
        return
    period_s = float(np.median(steps_ns)) / NS_PER_S
    if (steps_ns > _LONGEST_STEP_NS).mean() > 0.5:
        why = f"poses come at {1 / period_s:.1f} Hz: a jump cannot be told from a step"
        yield from (Figure(code, None, why) for code in ("pose-jump", "pose-jerk"))
        return
    moves = np.diff(trajectory.translations_m, axis=0)
    turns = _turns(trajectory.quaternions_xyzw)
    for code, made, push, unit in (
        ("pose-jump", moves, _PUSH_M_S2, 1.0),
        ("pose-jerk", turns, _TWIST_RAD_S2, 180 / np.pi),
    ):
        off = unit * _off_usual(made, steps_ns / NS_PER_S)
        usual = _usual_off(off, steps_ns, unit * push)
        beyond = off - usual
        beyond[steps_ns > _LONGEST_STEP_NS] = 0.0  # a gap: its silence is a finding of its own
        at = int(beyond.argmax())
        after_s = (int(trajectory.stamps_ns[at]) - trajectory.start_ns) / NS_PER_S
        figure = Figure(code, max(0.0, float(beyond[at])), f"{after_s:.2f} s after the first")
        hidden = float(np.median(usual))
        # Beside that, a fault of twice the limit would no longer stand out for certain.
        if hidden > 0.6 * figure.check.limit and not figure.found:
            why = f"poses come at {1 / period_s:.1f} Hz: between two of them this motion hides "
            figure = Figure(code, None, f"{why}{hidden:.2g} {figure.check.unit}")
        yield figure


def _off_usual(made: Floats, steps_s: Floats) -> Floats:
    """Return by how much each step differs from what those around it let expect."""
    rates = made / steps_s[:, np.newaxis]
    places = np.arange(len(rates))

    def beside(k: int) -> Floats:
        return rates[np.clip(places + k, 0, len(rates) - 1)]

    # A cubic follows a walker's sway also where poses are few; a median, what starts or stops.
    cubic = (4 * (beside(-1) + beside(1)) - beside(-2) - beside(2)) / 6
    apart = [np.sqrt(((rates - usual) ** 2).sum(axis=1)) for usual in (cubic, _usual_rates(rates))]
    off: Floats = np.minimum(*apart) * steps_s
    off[:_NEIGHBOURS] = off[-_NEIGHBOURS:] = 0.0  # who sets off has no steps before
    return off


def _usual_off(off: Floats, steps_ns: NDArray[np.int64], push: float) -> Floats:
    """Return by how much steps may differ: as most of the recording's do, within a push's reach."""
    places = np.arange(len(steps_ns))
    around = [
        steps_ns[np.clip(places + k, 0, len(steps_ns) - 1)]
        for k in range(-_NEIGHBOURS, _NEIGHBOURS + 1)
    ]
    longest_s = np.minimum(np.max(around, axis=0), _LONGEST_STEP_NS) / NS_PER_S
    reach = push * longest_s**2
    often = _OFTEN * np.quantile(off, 0.9) * (longest_s / (np.median(steps_ns) / NS_PER_S)) ** 2
    usual: Floats = np.clip(often, reach / 3, reach)
    return usual


def _turns(quaternions_xyzw: Floats) -> Floats:
    """Return small rotation vectors from each pose to the next, body frame."""
    a, b = quaternions_xyzw[:-1], quaternions_xyzw[1:]
    vector = a[:, 3:] * b[:, :3] - b[:, 3:] * a[:, :3] - np.cross(a[:, :3], b[:, :3])
    cosine = (a * b).sum(axis=1, keepdims=True)
    turns: Floats = 2 * vector * np.where(cosine < 0, -1.0, 1.0)
    return turns


def _usual_rates(rates: Floats) -> Floats:
    """Return the median rate of the steps around each, itself left out."""
    count = len(rates)
    around = [k for k in range(-_NEIGHBOURS, _NEIGHBOURS + 1) if k]
    places = np.clip(np.arange(count)[:, np.newaxis] + around, 0, count - 1)
    usual: Floats = np.median(rates[places], axis=1)
    return usual


def drift_figure(stretches: Sequence[Stretch]) -> Figure:
    """Compare the points of stretches that follow one another, through the poses.

    Args:
        stretches: in time order.

    Returns:
        how fast they move apart; not observable where none overlap.
    """
    worst: tuple[float, str] | None = None
    compared, unheld = 0, np.zeros((3, 3))
    for earlier, later in _pairs(stretches):
        found = disagreement(earlier.points_map, later.points_map)
        if found is None:
            continue
        apart_m, axes = found
        compared += 1
        unheld += (axes[:, :, np.newaxis] * axes[:, np.newaxis]).sum(axis=0)
        span_s = (later.start_ns - earlier.start_ns) / NS_PER_S
        after_s = (earlier.start_ns - stretches[0].start_ns) / NS_PER_S
        said = f"{apart_m:.3f} m within {span_s:.1f} s, {after_s:.0f} s after the start"
        if worst is None or apart_m / span_s > worst[0]:
            worst = apart_m / span_s, said
    if worst is None:
        return Figure("pose-drift", None, "no two stretches see the same surfaces at times apart")
    said = f"{worst[1]}; {compared} pairs compared{_blind(unheld / compared)}"
    return Figure("pose-drift", worst[0], said)


def _blind(unheld: Floats) -> str:
    """Name the directions in which a drift would not show: unheld (3, 3), mean over all pairs."""
    shares, axes = np.linalg.eigh(unheld)
    blind = axes.T[shares > _MOSTLY]
    if not len(blind):
        return ""
    # An axis has no sense: its largest part is told as positive.
    told = [axis * np.sign(axis[np.abs(axis).argmax()]) for axis in blind]
    names = " and ".join(f"({x:.2f}, {y:.2f}, {z:.2f})" for x, y, z in np.array(told) + 0.0)
    return (
        f"; in most, no plane holds the map's direction {names}: a drift along it may not be seen"
    )


def _pairs(stretches: Sequence[Stretch]) -> Iterator[tuple[Stretch, Stretch]]:
    for number, earlier in enumerate(stretches):
        for later in stretches[number + 1 :]:
            if later.start_ns - earlier.start_ns >= _DISJOINT_NS:
                yield earlier, later
                break


def disagreement(target_map: Floats, source_map: Floats) -> tuple[float, Floats] | None:
    """Say how far the second cloud must be moved to lie on the planes of the first.

    Args:
        target_map: (N, 3) metres.
        source_map: (M, 3) metres.

    Returns:
        metres, at the middle of what both see; and (K, 3) directions, map frame, that no plane
        fixes: they count as agreed. None where they share too little.
    """
    planes = planes_of(cells_of(target_map))
    source = source_map[:: max(1, len(source_map) // _SOURCE_POINTS)]
    shared = _plane_of(planes, source)[1]
    if shared.sum() < _FEWEST_POINTS:
        return None
    middle = source[shared].mean(axis=0)
    moved, turn, shift = source - middle, np.eye(3), np.zeros(3)
    for number in range(_ROUNDS):
        width = max(_NARROWEST_M, _WIDEST_M * 0.6**number)
        normal, pull = _pull(planes, moved @ turn.T + shift + middle, middle, width)
        if normal[3:, 3:].trace() < _FEWEST_POINTS / 4:
            return None
        change = np.asarray(-np.linalg.solve(normal + _PRIOR, pull), dtype=np.float64)
        turn = _small_rotation(change[:3]) @ turn
        shift = shift + change[3:]
    # What is known of the shift whatever the turn is; along a tunnel, nothing.
    turning = normal[:3, :3] + _PRIOR[:3, :3]
    known, axes = np.linalg.eigh(
        normal[3:, 3:] - normal[3:, :3] @ np.linalg.solve(turning, normal[:3, 3:])
    )
    held = known > _HELD_SHARE * normal[3:, 3:].trace()
    along = (axes.T @ shift) * held
    return (float(np.sqrt((along**2).sum())), axes.T[~held]) if held.any() else None


def _plane_of(planes: Planes, points: Floats) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    if not len(planes.keys):
        return np.zeros(len(points), np.intp), np.zeros(len(points), np.bool_)
    keys = keys_of(points)
    at = np.clip(np.searchsorted(planes.keys, keys), 0, len(planes.keys) - 1)
    return at, planes.keys[at] == keys


def _pull(planes: Planes, points: Floats, middle: Floats, width_m: float) -> tuple[Floats, Floats]:
    """Return how firmly planes hold points (6, 6), and where they pull them (6,): turn, shift."""
    at, known = _plane_of(planes, points)
    normals, arms = planes.normals[at], points - middle
    off = ((points - planes.middles_m[at]) * normals).sum(axis=1)
    used = known & (np.abs(off) < width_m)
    off, normals, arms = off[used], normals[used], arms[used]
    rows = np.concatenate([np.cross(arms, normals), normals], axis=1)
    weight = 1 / (1 + (off / (width_m / 2)) ** 2)
    return (rows * weight[:, np.newaxis]).T @ rows, rows.T @ (weight * off)


def _small_rotation(turn: Floats) -> Floats:
    x, y, z = turn
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    u, _, v = np.linalg.svd(np.eye(3) + skew)
    rotation: Floats = u @ v
    return rotation
