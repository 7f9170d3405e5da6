"""When were images really taken? Their turning from one to the next is compared with the poses'.

Features are followed from image to image. What the poses say of the camera's way, and the LiDAR of
the features' depths, is taken out; what is left is a rotation, which the poses must have made too
at the image's instant. The shift of the images' stamps at which both agree is their time offset.
"""

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

TURNS_ENOUGH_RAD_S: Final = 0.2
"""Below this rate (RMS) the instant of an image makes no difference that could be seen."""

_SEARCH_S: Final = 0.25
_STEP_S: Final = 0.01
_FEWEST_TURNS: Final = 12
_ROUNDS: Final = 2
_SURE_S: Final = 0.004


@dataclass(frozen=True, slots=True)
class TimeOffset:
    """What is to be added to the images' stamps beyond what the rig says.

    Attributes:
        offset_s: None where it cannot be observed.
        sigma_s: its standard error.
        rate_rad_s: RMS of the rate at which the sensors turn.
        why_not: in words, where it cannot be observed.
    """

    offset_s: float | None
    sigma_s: float
    rate_rad_s: float
    why_not: str = ""


def time_offset(recording: Posed, tracks: Sequence[Track]) -> TimeOffset:
    """Find the shift of the images' stamps at which the poses turn as the images do.

    Args:
        recording: with poses.
        tracks: from :func:`tracks_of`.
    """
    found = TimeOffset(0.0, 0.0, 0.0)
    for _ in range(_ROUNDS):  # the camera's way between two images depends on their instants, too
        if found.offset_s is None:
            return found
        turns = turns_at(recording, tracks, found.offset_s)
        rates = _rates(recording, turns)
        rate = float(np.sqrt((rates**2).sum(axis=1).mean())) if len(rates) else 0.0
        refused = _why_not(rates, rate)
        if refused:
            return TimeOffset(None, 0.0, rate, refused)
        found = _best_shift(recording, turns, rate)
    if found.offset_s is not None and found.sigma_s > _SURE_S:
        words = f"image motion and poses agree too loosely: +- {1000 * found.sigma_s:.0f} ms"
        return TimeOffset(None, found.sigma_s, found.rate_rad_s, words)
    return found


def _best_shift(recording: Posed, turns: Turns, rate_rad_s: float) -> TimeOffset:
    shifts = np.arange(-_SEARCH_S, _SEARCH_S + _STEP_S / 2, _STEP_S)
    scale = 0.002
    for _ in range(2):  # the second time what does not fit is known
        costs = np.array([_misfit(recording, turns, shift, scale)[0] for shift in shifts])
        best = int(costs.argmin())
        _, left = _misfit(recording, turns, float(shifts[best]), scale)
        scale = 1.4826 * float(np.median(np.sqrt((left**2).sum(axis=1)))) + 1e-5
    if best in {0, len(shifts) - 1}:
        words = f"no shift within {_SEARCH_S:g} s makes image motion and poses agree"
        return TimeOffset(None, 0.0, rate_rad_s, words)
    fine = np.linspace(-_STEP_S, _STEP_S, 9)
    costs = np.array(
        [_misfit(recording, turns, float(shifts[best] + step), scale)[0] for step in fine]
    )
    bend, slope, _ = np.polyfit(fine, costs, 2)
    if bend <= 0:
        return TimeOffset(None, 0.0, rate_rad_s, "no shift fits better than its neighbours")
    offset_s = float(shifts[best] + np.clip(-slope / (2 * bend), -_STEP_S, _STEP_S))
    sigma_s = float(np.sqrt(costs.min() / max(len(turns.seen_rad) - 4, 1) / bend))
    return TimeOffset(offset_s, sigma_s, rate_rad_s)


def _rates(recording: Posed, turns: Turns) -> Floats:
    if not len(turns.from_ns):
        return np.zeros((0, 3))
    span_s = (turns.to_ns - turns.from_ns)[:, np.newaxis] / 1e9
    return turned(recording, turns, 0.0) / span_s


def _why_not(rates: Floats, rate_rad_s: float) -> str:
    if len(rates) < _FEWEST_TURNS:
        return f"only {len(rates)} pairs of images show their turning"
    if rate_rad_s < TURNS_ENOUGH_RAD_S:
        return (
            f"the sensors turn at {rate_rad_s:.2f} rad/s RMS; {TURNS_ENOUGH_RAD_S:g} with changing "
            "sign are needed"
        )
    strongest = rates[:, int((rates**2).sum(axis=0).argmax())]
    fast = np.abs(strongest) > TURNS_ENOUGH_RAD_S / 4
    share = float((strongest[fast] > 0).mean()) if fast.any() else 0.0
    if not 0.1 < share < 0.9:
        return "the sensors turn one way only; a turn with changing sign is needed"
    return ""


def _misfit(recording: Posed, turns: Turns, shift_s: float, scale: float) -> tuple[float, Floats]:
    """Return the robust misfit of a shift, and what is left; a wrong mounting turns all alike."""
    said = turned(recording, turns, shift_s)
    left = turns.seen_rad - said
    rows = mounting_rows(said)
    mount = np.zeros(3)
    for _ in range(3):
        now = left - rows @ mount
        weight = 1 / (1 + (now**2).sum(axis=1) / (3 * scale) ** 2)
        normal = np.einsum("nij,n,nik->jk", rows, weight, rows)
        prior = np.eye(3) * (min(scale, 0.01) / DOUBT_RAD) ** 2
        mount = np.linalg.solve(normal + prior, np.einsum("nij,n,ni->j", rows, weight, left))
    now = left - rows @ mount
    size2 = (now**2).sum(axis=1)
    return float((9 * scale**2 * np.log1p(size2 / (9 * scale**2))).sum()), now
