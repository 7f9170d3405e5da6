"""Rooms, tunnels and soffits by formula: LiDAR and IMU of a slow walk along x, in memory."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.domain.motion import ImuReadings
from civil_rgbd.domain.recording import RecordingNotes, SourceFile
from civil_rgbd.domain.scan import LidarScan
from civil_rgbd.geometry.trajectory import Trajectory

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
SCAN = SECOND // 10
POINTS = 4000

Rays = NDArray[np.float64]
Ranges = Callable[[Rays, Rays], NDArray[np.float64]]
"""Origins (N, 3) and directions (N, 3), map frame, to ranges (N,); 0 without a return."""


def planes(*which: tuple[int, float]) -> Ranges:
    """Return the range to the nearest of some planes (axis, place)."""

    def ranges(origins: Rays, directions: Rays) -> NDArray[np.float64]:
        nearest = np.full(len(origins), np.inf)
        with np.errstate(divide="ignore"):
            for axis, place in which:
                hit = (place - origins[:, axis]) / directions[:, axis]
                nearest = np.where((hit > 0) & (hit < nearest), hit, nearest)
        return np.where(nearest < 40, nearest, 0.0)

    return ranges


SOFFIT = planes((2, 5.0))
TUNNEL = planes((2, 5.0), (2, -1.5), (1, 4.0), (1, -4.0))
ROOM = planes((2, 5.0), (2, -1.5), (1, 4.0), (1, -4.0), (0, 12.0), (0, -9.0))


@dataclass(frozen=True, eq=False)
class Walk:
    """Fits :class:`civil_rgbd.domain.motion.MotionRecording`; the IMU is the LiDAR, level."""

    ranges: Ranges
    seconds: float = 3.0
    speed_m_s: float = 0.5
    force_unit: float = 9.80665
    name: str = "walk"
    is_livox: bool = True
    T_imu_lidar: NDArray[np.float64] | None = field(default_factory=lambda: np.eye(4))
    sources: tuple[SourceFile, ...] = ()
    notes: RecordingNotes = field(default_factory=RecordingNotes)

    @property
    def scan_stamps_ns(self) -> NDArray[np.int64]:
        return START + np.arange(round(self.seconds * 10), dtype=np.int64) * SCAN

    @property
    def imu(self) -> ImuReadings:
        stamps = START + np.arange(round(self.seconds * 200) + 1, dtype=np.int64) * (SECOND // 200)
        forces = np.tile([0.0, 0.0, self.force_unit], (len(stamps), 1))
        return ImuReadings(stamps, np.zeros((len(stamps), 3)), forces, "imu")

    def places(self, stamps: NDArray[np.int64]) -> NDArray[np.float64]:
        x = (stamps - START) / SECOND * self.speed_m_s
        return np.stack([x, np.zeros_like(x), np.zeros_like(x)], axis=1)

    @property
    def truth(self) -> Trajectory:
        """A pose at the last point of each scan, as engines give them."""
        ends = self.scan_stamps_ns + last_offset()
        turns = np.tile([0.0, 0.0, 0.0, 1.0], (len(ends), 1))
        return Trajectory(ends, self.places(ends), turns)

    def read_scan(self, index: int) -> LidarScan:
        rng = np.random.default_rng(index)
        stamp = int(self.scan_stamps_ns[index])
        stamps = stamp + np.arange(POINTS, dtype=np.int64) * SCAN // POINTS
        azimuth, up = rng.uniform(-0.7, 0.7, POINTS), rng.uniform(-0.2, 0.9, POINTS)
        beams = np.stack(
            [np.cos(up) * np.cos(azimuth), np.cos(up) * np.sin(azimuth), np.sin(up)], axis=1
        )
        ranges = self.ranges(self.places(stamps), beams)
        noisy = np.where(ranges > 0, ranges + rng.normal(0, 0.01, POINTS), 0.0)
        points = (beams * noisy[:, np.newaxis]).astype(np.float32)
        return LidarScan(stamp, points, stamps, np.zeros(POINTS, dtype=np.bool_))


def last_offset() -> int:
    """Nanoseconds from a scan's first to its last point."""
    return (POINTS - 1) * SCAN // POINTS
