"""What quality means for a person who stands under a bridge at seven in the morning."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.constants import NS_PER_S
from civil_rgbd.odometry.quality import LOW_QUALITY, Limits, PoseMeasures

_JOIN_S = 1.0  # stretches nearer to each other than this are said as one


@dataclass(frozen=True, slots=True)
class WeakStretch:
    """A stretch of poses that cannot be trusted.

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
    low = np.flatnonzero(quality < LOW_QUALITY)
    if not len(low):
        return []
    seconds = (measures.stamps_ns - measures.stamps_ns[0]) / NS_PER_S
    breaks = np.flatnonzero(np.diff(seconds[low]) > _JOIN_S) + 1
    return [
        WeakStretch(
            int(run[0]),
            int(run[-1]),
            float(seconds[run[0]]),
            float(seconds[run[-1]]),
            _why(measures, run, limits),
        )
        for run in np.split(low, breaks)
    ]


def _why(measures: PoseMeasures, run: NDArray[np.intp], limits: Limits) -> str:
    if measures.settling[run].all():
        return "the recording begins in motion: stand still for two seconds before you walk"
    speed, turn = float(measures.speed_m_s[run].max()), float(measures.turn_rad_s[run].max())
    held = np.median(measures.held_by[run], axis=0)
    loose = int((held < LOW_QUALITY).sum())
    reasons = {
        3: "geometry gives out: too few flat surfaces to hold on to",
        2: "geometry gives out: the surfaces let the scan slide two ways, as under a plain soffit",
        1: "geometry gives out: the surfaces let the scan slide one way, as in a smooth tunnel or "
        "along a plain wall",
        0: "the scans do not fit the map before them",
    }
    fast = speed > limits.speed_m_s or turn > limits.turn_rad_s
    why = reasons[loose] if loose or not fast else "the poses move as nobody walks"
    if fast:
        why += f"; the poses run away, at up to {speed:.1f} m/s and {np.degrees(turn):.0f} deg/s"
    return why
