"""What quality means for a person who stands under a bridge at seven in the morning."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.constants import NS_PER_S
from civil_rgbd.odometry.drift import FEWEST_PLANES
from civil_rgbd.odometry.quality import LOW_QUALITY, TURN_OF_ONE_RAD, Limits, PoseMeasures

_JOIN_S = 1.0  # stretches nearer to each other than this are said as one
_WORTH_SAYING_S = 1.0


@dataclass(frozen=True, slots=True)
class WeakStretch:
    """A stretch of poses of which something is to be said.

    Attributes:
        first: index of its first pose.
        last: index of its last.
        from_s: seconds after the first pose.
        to_s: seconds after the first pose.
        why: in words.
    """

    first: int
    last: int
    from_s: float
    to_s: float
    why: str

    def to_text(self) -> str:
        """Say it in one line."""
        seconds = self.to_s - self.from_s
        return f"{self.from_s:.1f} s to {self.to_s:.1f} s ({seconds:.1f} s): {self.why}"


def weak_stretches(
    measures: PoseMeasures, quality: NDArray[np.float64], limits: Limits | None = None
) -> list[WeakStretch]:
    """Find the stretches below :data:`~civil_rgbd.odometry.quality.LOW_QUALITY`, and say why.

    Args:
        measures: of all poses.
        quality: (P,) of them.
        limits: that the quality was made with.
    """
    limits = limits or Limits()
    return [
        _stretch(measures, run, _why(measures, run, limits))
        for run in _runs(measures, quality < LOW_QUALITY)
    ]


def carried_stretches(measures: PoseMeasures, quality: NDArray[np.float64]) -> list[WeakStretch]:
    """Find the stretches where surfaces give out, yet the IMU carries the poses well enough.

    Args:
        measures: of all poses.
        quality: (P,) of them.
    """
    carried = (measures.held_by[:, 0] < FEWEST_PLANES) & (quality >= LOW_QUALITY)
    found = []
    for run in _runs(measures, carried):
        drift_cm = 100 * float(measures.drift_m[run].max())
        stretch = _stretch(measures, run, f"up to {drift_cm:.0f} cm a second may be lost")
        if stretch.to_s - stretch.from_s >= _WORTH_SAYING_S:
            found.append(stretch)
    return found


def _runs(measures: PoseMeasures, chosen: NDArray[np.bool_]) -> list[NDArray[np.intp]]:
    """Split the poses chosen where they lie apart in time."""
    which = np.flatnonzero(chosen)
    seconds = measures.stamps_ns[which] / NS_PER_S
    return np.split(which, np.flatnonzero(np.diff(seconds) > _JOIN_S) + 1) if len(which) else []


def _stretch(measures: PoseMeasures, run: NDArray[np.intp], why: str) -> WeakStretch:
    first, last = int(run[0]), int(run[-1])
    stamps = measures.stamps_ns
    from_s, to_s = ((int(stamps[k]) - int(stamps[0])) / NS_PER_S for k in (first, last))
    return WeakStretch(first, last, from_s, to_s, why)


def _why(measures: PoseMeasures, run: NDArray[np.intp], limits: Limits) -> str:
    if measures.settling[run].all():
        return "the recording begins in motion: stand still for two seconds before you walk"
    speed, turn = float(measures.speed_m_s[run].max()), float(measures.turn_rad_s[run].max())
    held = np.median(measures.held_by[run], axis=0)
    loose = int((held < FEWEST_PLANES).sum())
    fast = speed > limits.speed_m_s or turn > limits.turn_rad_s
    why = (
        "the poses move as nobody walks"
        if fast and not loose
        else _WHAT_GIVES_OUT.get(loose) or _what_disagrees(measures, run, limits)
    )
    if fast:
        why += f"; the poses run away, at up to {speed:.1f} m/s and {np.degrees(turn):.0f} deg/s"
    return why


_WHAT_GIVES_OUT = {
    3: "geometry gives out: too few flat surfaces to hold on to",
    2: "geometry gives out: the surfaces let the scan slide two ways, as under a plain soffit",
    1: "geometry gives out: the surfaces let the scan slide one way, as in a smooth tunnel or "
    "along a plain wall",
}


def _what_disagrees(measures: PoseMeasures, run: NDArray[np.intp], limits: Limits) -> str:
    residual = measures.residual_m[run]
    if (residual > limits.residual_m).any():  # of NaN, too: it does not
        return "the scans do not fit the map before them"
    if measures.drift_rad[run].max() * LOW_QUALITY > TURN_OF_ONE_RAD:
        off_deg = np.degrees(float(measures.drift_rad[run].max()))
        return f"the poses turn otherwise than the gyroscope, by up to {off_deg:.1f} deg a second"
    off_cm = 100 * float(measures.drift_m[run].max())
    return f"the poses move otherwise than IMU and surfaces say, by up to {off_cm:.0f} cm a second"
