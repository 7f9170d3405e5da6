"""What odometry works from: LiDAR and IMU of a recording, before anybody knows its poses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.domain.recording import RecordingNotes, SourceFile
from civil_rgbd.domain.scan import LidarScan


@dataclass(frozen=True, slots=True, eq=False)
class ImuReadings:
    """What an IMU measured, in message order, as recorded.

    Attributes:
        stamps_ns: (M,) int64, header stamps.
        rates_rad_s: (M, 3) float64, angular velocity, IMU frame.
        forces: (M, 3) float64, specific force, IMU frame, in the recording's own unit: ROS says
            m/s2, Livox drivers write g.
        frame: the messages' frame id; empty when they have none.
    """

    stamps_ns: NDArray[np.int64]
    rates_rad_s: NDArray[np.float64]
    forces: NDArray[np.float64]
    frame: str = ""

    def __post_init__(self) -> None:
        count = len(self.stamps_ns)
        for name in ("rates_rad_s", "forces"):
            if getattr(self, name).shape != (count, 3):
                raise ValueError(f"{name} has shape {getattr(self, name).shape} for {count} stamps")


class MotionRecording(Protocol):
    """LiDAR and IMU of a recording; it needs neither camera nor poses.

    Scans are indexed as in :class:`civil_rgbd.domain.recording.Recording`.
    """

    @property
    def name(self) -> str:
        """The file's stem, or what else names it."""

    @property
    def sources(self) -> tuple[SourceFile, ...]:
        """The files behind it, in order."""

    @property
    def notes(self) -> RecordingNotes:
        """What is odd about it."""

    @property
    def scan_stamps_ns(self) -> NDArray[np.int64]:
        """(S,) header stamps of all LiDAR messages, message order."""

    @property
    def is_livox(self) -> bool:
        """The LiDAR messages are Livox's own (CustomMsg, LVX)."""

    @property
    def imu(self) -> ImuReadings:
        """Everything that the IMU measured."""

    @property
    def T_imu_lidar(self) -> NDArray[np.float64] | None:
        """(4, 4), LiDAR frame to IMU frame; None when nothing links them."""

    def read_scan(self, index: int) -> LidarScan:
        """Decode one LiDAR message.

        Raises:
            RecordingError: the message breaks its own layout.
        """
