"""Does one time offset hold all through a recording? Its parts are asked one by one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.health.rotations import DOUBT_RAD, Turns, mounting_rows, turned, turns_at
from civil_rgbd.health.sampling import Posed
from civil_rgbd.health.tracks import Track

Floats = NDArray[np.float64]

PARTS: Final = 4
_NAMES: Final = ("first", "second", "third", "last")

_REACH_S, _STEP_S = 0.2, 0.01
_FEWEST: Final = 5
_SURE_S, _SHARE = 0.006, 0.1
_ROUNDS: Final = 2
_LEAST_SIGMA_S: Final = 0.001
"""What is left of the camera's way makes parts differ, however many features there are."""

_CERTAIN: Final = 4.0
_NOTABLE_S: Final = 0.005


@dataclass(frozen=True, slots=True)
class Change:
    """How the time offset changes through the recording, by the images' turning.

    Attributes:
        change_s: over the recording, or of the part that is off; None where it is not known.
        sigma_s: its standard error.
        certain: whether it is more than chance, and no trifle.
        words: how it changes; empty where it stays the same.
    """

    change_s: float | None = None
    sigma_s: float = 0.0
    certain: bool = False
    words: str = ""


def change_of(recording: Posed, tracks: Sequence[Track], turns: Turns, shift_s: float) -> Change:
    """Find the shift of each quarter, and lay a line through them, or see that one is off.

    Args:
        recording: with poses.
        tracks: features followed in its images.
        turns: of these images.
        shift_s: that fits the whole.
    """
    if len(turns.from_ns) < PARTS * _FEWEST:
        return Change()
    middle_s = ((turns.from_ns + turns.to_ns) // 2 - turns.from_ns.min()) / 1e9
    length_s = float(middle_s.max())
    part = np.minimum((PARTS * middle_s / max(length_s, 1e-9)).astype(int), PARTS - 1)
    offs, sigmas = _shifts_of_parts(recording, tracks, turns, shift_s, part)
    known = np.isfinite(sigmas)
    if known.sum() < PARTS - 1:
        return Change()
    at_s = np.array([middle_s[part == number].mean() for number in np.flatnonzero(known)])
    offs, weight = offs[known], 1 / sigmas[known] ** 2
    line, left = _fitted(np.column_stack([np.ones(len(at_s)), at_s - at_s.mean()]), offs, weight)
    change_s, sigma_s = line[0][1] * length_s, line[1][1] * length_s
    words = f"it changes by {1000 * change_s:+.0f} ms from start to end"
    for number in range(len(offs)):
        rows = np.column_stack([np.ones(len(offs)), np.arange(len(offs)) == number])
        one, other_left = _fitted(rows, offs, weight)
        if other_left < left:
            left, change_s, sigma_s = other_left, one[0][1], one[1][1]
            name = _NAMES[int(np.flatnonzero(known)[number])]
            words = f"in the {name} quarter it is {1000 * change_s:+.0f} ms off the rest"
    sigma_s *= max(1.0, float(np.sqrt(left / max(len(offs) - 2, 1))))
    certain = abs(change_s) > max(_NOTABLE_S, _CERTAIN * sigma_s)
    return Change(float(change_s), float(sigma_s), bool(certain), words if certain else "")


def _fitted(rows: Floats, values: Floats, weight: Floats) -> tuple[tuple[Floats, Floats], float]:
    """Return numbers and standard errors of a weighted fit, and the squares that are left."""
    covariance = np.linalg.inv((rows * weight[:, np.newaxis]).T @ rows)
    found = covariance @ (rows.T @ (weight * values))
    left = float((weight * (values - rows @ found) ** 2).sum())
    return (found, np.sqrt(np.diag(covariance))), left


def _shifts_of_parts(
    recording: Posed,
    tracks: Sequence[Track],
    turns: Turns,
    shift_s: float,
    part: NDArray[np.int_],
) -> tuple[Floats, Floats]:
    """Return each part's own shift beyond that of the whole, and its sigma; infinite if unknown."""
    said = turned(recording, turns, shift_s)
    left = turns.seen_rad - said
    scale = 1.4826 * float(np.median(np.sqrt((left**2).sum(axis=1)))) + 1e-4
    mount = mount_of(left, said, scale)
    offs, sigmas = np.zeros(PARTS), np.full(PARTS, np.inf)
    for number in range(PARTS):
        mine = part == number
        if mine.sum() < _FEWEST:
            continue
        first, last = turns.from_ns[mine].min(), turns.to_ns[mine].max()
        inside = [track for track in tracks if first <= track.from_ns and track.to_ns <= last]
        own = Turns(turns.from_ns[mine], turns.to_ns[mine], turns.seen_rad[mine])
        found = _shift_of_part(recording, own, shift_s, mount)
        for _ in range(_ROUNDS):
            if found is None or abs(found[0]) < _NOTABLE_S / 2:
                break
            own = turns_at(recording, inside, shift_s + found[0])  # the camera's way is another
            found = _shift_of_part(recording, own, shift_s, mount)
        if found is not None and found[1] < max(_SURE_S, _SHARE * abs(found[0])):
            offs[number], sigmas[number] = found[0], max(found[1], _LEAST_SIGMA_S)
    return offs, sigmas


def _shift_of_part(
    recording: Posed, turns: Turns, shift_s: float, mount: Floats
) -> tuple[float, float] | None:
    steps = _STEP_S * np.arange(-round(_REACH_S / _STEP_S), round(_REACH_S / _STEP_S) + 1)
    size2 = np.empty((len(steps), len(turns.from_ns)))
    for number, step in enumerate(steps.tolist()):
        said = turned(recording, turns, shift_s + step)
        now = turns.seen_rad - said - mounting_rows(said) @ mount
        size2[number] = (now**2).sum(axis=1)
    # The scale is that of the best shift: of the part alone, which another may not fit.
    scale2 = 9 * np.median(size2, axis=1).min() + 1e-8
    costs = (scale2 * np.log1p(size2 / scale2)).sum(axis=1)
    best = int(costs.argmin())
    if best in {0, len(steps) - 1} or len(turns.from_ns) < _FEWEST:
        return None
    before, least, after = costs[best - 1 : best + 2]
    bend = (before + after - 2 * least) / (2 * _STEP_S**2)
    if bend <= 0:
        return None
    off_s = steps[best] + (before - after) / (4 * bend * _STEP_S)
    return float(off_s), float(np.sqrt(least / (len(turns.from_ns) - 2) / bend))


def mount_of(left: Floats, said: Floats, scale: float) -> Floats:
    """Return the small turn of the mounting (3,) that explains most of what is left."""
    rows, mount = mounting_rows(said), np.zeros(3)
    for _ in range(3):
        now = left - rows @ mount
        weight = 1 / (1 + (now**2).sum(axis=1) / (3 * scale) ** 2)
        normal = np.einsum("nij,n,nik->jk", rows, weight, rows)
        prior = np.eye(3) * (min(scale, 0.01) / DOUBT_RAD) ** 2
        mount = np.linalg.solve(normal + prior, np.einsum("nij,n,ni->j", rows, weight, left))
    return mount
