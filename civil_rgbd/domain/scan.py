"""What a LiDAR delivers in one message."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, eq=False)
class LidarScan:
    """One LiDAR message, as recorded: nothing filtered, nothing moved.

    Attributes:
        stamp_ns: header stamp, nanoseconds, LiDAR clock.
        points: (N, 3) float32 or float64, metres; LiDAR frame, or map frame when ``in_map``.
        point_stamps_ns: (N,) int64, each point's own time; None when the recording has none, and
            every point then has the header's stamp.
        noise: (N,) bool, True where the sensor itself doubts the return (Livox tags); None when
            the sensor does not say.
        in_map: the points are already registered in the map frame.
        unreadable: the message is damaged and has no points here; only where the user asked to go
            on without such messages. It is counted.
    """

    stamp_ns: int
    points: NDArray[np.floating]
    point_stamps_ns: NDArray[np.int64] | None = None
    noise: NDArray[np.bool_] | None = None
    in_map: bool = False
    unreadable: bool = False

    @classmethod
    def lost(cls, stamp_ns: int, *, in_map: bool = False) -> LidarScan:
        """Return what stands in for a message that is damaged and left out."""
        nothing, no_stamps = np.zeros((0, 3), dtype=np.float32), np.zeros(0, dtype=np.int64)
        return cls(stamp_ns, nothing, no_stamps, in_map=in_map, unreadable=True)

    def __post_init__(self) -> None:
        count = len(self.points)
        if self.points.shape != (count, 3):
            raise ValueError(f"points have shape {self.points.shape}, not (N, 3)")
        for name in ("point_stamps_ns", "noise"):
            column = getattr(self, name)
            if column is not None and column.shape != (count,):
                raise ValueError(f"{name} has shape {column.shape} for {count} points")

    @property
    def start_ns(self) -> int:
        """Stamp of the earliest point; the header's when there is no point time."""
        if self.point_stamps_ns is None or not len(self.point_stamps_ns):
            return self.stamp_ns
        return int(self.point_stamps_ns.min())

    @property
    def end_ns(self) -> int:
        """Stamp of the latest point; the header's when there is no point time."""
        if self.point_stamps_ns is None or not len(self.point_stamps_ns):
            return self.stamp_ns
        return int(self.point_stamps_ns.max())
