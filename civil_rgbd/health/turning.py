"""When were images really taken? Their turning from one to the next is compared with the poses'.

Features are followed from image to image. What the poses say of the camera's way, and the LiDAR of
the features' depths, is taken out; what is left is a rotation, which the poses must have made too
at the image's instant. The shift of the images' stamps at which both agree is their time offset.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.health.constancy import Change, change_of, mount_of
from civil_rgbd.health.rotations import Turns, mounting_rows, turned, turns_at
from civil_rgbd.health.sampling import Posed, Supposed
from civil_rgbd.health.tracks import Pair, Track, tracks_of

Floats = NDArray[np.float64]

TURNS_ENOUGH_RAD_S: Final = 0.2
"""Below this rate (RMS) the instant of an image makes no difference that could be seen."""

_NEAR_S: Final = 0.25
_FAR_S, _COARSE_S = 1.5, 0.05
_APART_S: Final = 0.2
_CLEARLY: Final = 2.0  # a shift far off is believed if all others fit that much worse
_FINE_S, _STEP_S = 0.12, 0.01
_COARSE_SCALE_RAD: Final = 0.01
_FEWEST_TURNS: Final = 12
_ROUNDS: Final = 2
_SURE_S: Final = 0.004
_SETTLED: Final = Change()


@dataclass(frozen=True, slots=True)
class TimeOffset:
    """What is to be added to the images' stamps beyond what the rig says.

    Attributes:
        offset_s: None where it cannot be observed.
        sigma_s: its standard error.
        rate_rad_s: RMS of the rate at which the sensors turn.
        why_not: in words, where it cannot be observed.
        change: whether it stays the same through the recording.
    """

    offset_s: float | None
    sigma_s: float
    rate_rad_s: float
    why_not: str = ""
    change: Change = _SETTLED


def time_offset(recording: Posed, pairs: Sequence[Pair]) -> TimeOffset:
    """Find the shift of the images' stamps at which the poses turn as the images do.

    Args:
        recording: with poses.
        pairs: features followed, from :func:`civil_rgbd.health.tracks.pairs_of`.
    """
    tracks = tracks_of(recording, pairs)
    turns = turns_at(recording, tracks, 0.0)
    far_s = _coarse_shift(recording, turns)
    if far_s is None:
        refused, rate = _why_not(recording, turns, 0.0)
        words = f"no shift within {_FAR_S:g} s makes image motion and poses agree"
        return TimeOffset(None, 0.0, rate, refused or words)
    supposed = recording
    if far_s:  # features lie elsewhere by then, at other depths
        rig = replace(
            recording.rig, camera_time_offset_s=recording.rig.camera_time_offset_s + far_s
        )
        supposed = Supposed(rig, recording.trajectory, recording.image_stamps_ns)
        tracks = tracks_of(supposed, pairs)
    found = _near_shift(supposed, tracks)
    return found if found.offset_s is None else replace(found, offset_s=found.offset_s + far_s)


def _near_shift(recording: Posed, tracks: Sequence[Track]) -> TimeOffset:
    found, shift_s = TimeOffset(0.0, 0.0, 0.0), 0.0
    for _ in range(_ROUNDS):  # the camera's way between two images depends on their instants, too
        turns = _inside(recording, turns_at(recording, tracks, shift_s), shift_s)
        refused, rate = _why_not(recording, turns, shift_s)
        if refused:
            return TimeOffset(None, 0.0, rate, refused)
        found = _best_shift(recording, turns, rate)
        if found.offset_s is None:
            return found
        shift_s = found.offset_s
    change = change_of(recording, tracks, turns, shift_s)
    if found.sigma_s > _SURE_S:
        words = f"image motion and poses agree too loosely: +- {1000 * found.sigma_s:.0f} ms"
        return TimeOffset(None, found.sigma_s, found.rate_rad_s, words, change)
    return replace(found, change=change)


def _inside(recording: Posed, turns: Turns, shift_s: float) -> Turns:
    """Keep what lies inside the poses once it is shifted: at their ends nothing turns."""
    shift_ns = round(shift_s * 1e9)
    first, last = recording.trajectory.start_ns, recording.trajectory.end_ns
    kept = (turns.from_ns + shift_ns >= first) & (turns.to_ns + shift_ns <= last)
    return Turns(turns.from_ns[kept], turns.to_ns[kept], turns.seen_rad[kept])


def _coarse_shift(recording: Posed, turns: Turns) -> float | None:
    """Return about where a shift fits best: near, or further off if no other comes close."""
    shifts = _COARSE_S * np.arange(-round(_FAR_S / _COARSE_S), round(_FAR_S / _COARSE_S) + 1)
    costs = np.full(len(shifts), np.inf)
    for number, shift in enumerate(shifts.tolist()):
        kept = _inside(recording, turns, shift)
        if len(kept.seen_rad) >= _FEWEST_TURNS:
            cost = _misfit(recording, kept, shift, _COARSE_SCALE_RAD)[0]
            costs[number] = cost / len(kept.seen_rad)
    best = int(costs.argmin())
    others = costs[np.abs(shifts - shifts[best]) > _APART_S]
    clear = 0 < best < len(shifts) - 1 and _CLEARLY * costs[best] < others.min()
    near = np.abs(shifts) <= _NEAR_S + _COARSE_S / 2
    if not clear:
        best = int(np.where(near, costs, np.inf).argmin())
        at_edge = best in {int(near.argmax()), len(near) - 1 - int(near[::-1].argmax())}
        if at_edge or not np.isfinite(costs[best]):
            return None
    return float(shifts[best])


def _best_shift(recording: Posed, turns: Turns, rate_rad_s: float) -> TimeOffset:
    shifts = np.arange(-_FINE_S, _FINE_S + _STEP_S / 2, _STEP_S)
    scale = 0.002
    for _ in range(2):  # the second time what does not fit is known
        costs = np.array([_misfit(recording, turns, shift, scale)[0] for shift in shifts])
        best = int(costs.argmin())
        _, left = _misfit(recording, turns, float(shifts[best]), scale)
        scale = 1.4826 * float(np.median(np.sqrt((left**2).sum(axis=1)))) + 1e-5
    if best in {0, len(shifts) - 1}:
        words = "no single shift makes image motion and poses agree"
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


def _why_not(recording: Posed, turns: Turns, shift_s: float) -> tuple[str, float]:
    """Return why the turning is not enough, if so, and its rate (RMS)."""
    if len(turns.from_ns) < _FEWEST_TURNS:
        return f"only {len(turns.from_ns)} pairs of images show their turning", 0.0
    span_s = (turns.to_ns - turns.from_ns)[:, np.newaxis] / 1e9
    rates = turned(recording, turns, shift_s) / span_s
    rate_rad_s = float(np.sqrt((rates**2).sum(axis=1).mean()))
    if rate_rad_s < TURNS_ENOUGH_RAD_S:
        return (
            f"the sensors turn at {rate_rad_s:.2f} rad/s RMS; {TURNS_ENOUGH_RAD_S:g} with changing "
            "sign are needed"
        ), rate_rad_s
    strongest = rates[:, int((rates**2).sum(axis=0).argmax())]
    fast = np.abs(strongest) > TURNS_ENOUGH_RAD_S / 4
    share = float((strongest[fast] > 0).mean()) if fast.any() else 0.0
    if not 0.1 < share < 0.9:
        return "the sensors turn one way only; a turn with changing sign is needed", rate_rad_s
    return "", rate_rad_s


def _misfit(recording: Posed, turns: Turns, shift_s: float, scale: float) -> tuple[float, Floats]:
    """Return the robust misfit of a shift, and what is left; a wrong mounting turns all alike."""
    said = turned(recording, turns, shift_s)
    left = turns.seen_rad - said
    now = left - mounting_rows(said) @ mount_of(left, said, scale)
    size2 = (now**2).sum(axis=1)
    return float((9 * scale**2 * np.log1p(size2 / (9 * scale**2))).sum()), now
