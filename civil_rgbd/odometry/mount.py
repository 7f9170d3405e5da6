"""How the LiDAR sits on the IMU, where the recording does not say."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.domain.motion import MotionRecording
from civil_rgbd.errors import RecordingError
from civil_rgbd.geometry.transforms import transform_from

# Livox Avia user manual: the LiDAR's origin in its own IMU; no rotation.
AVIA_T_IMU_LIDAR: Final = transform_from(np.eye(3), [0.04165, 0.02326, -0.0284])


def lidar_on_imu(recording: MotionRecording) -> tuple[NDArray[np.float64], str]:
    """Return ``T_imu_lidar`` (4, 4), and in words where it comes from.

    Raises:
        RecordingError: nobody says.
    """
    T_imu_lidar = recording.T_imu_lidar
    if T_imu_lidar is not None:
        return T_imu_lidar, "the LiDAR on the IMU: as the rig file or tf says"
    if recording.is_livox:
        return AVIA_T_IMU_LIDAR, (
            "the LiDAR on the IMU: as in a Livox Avia, from its manual, since neither a rig file "
            "nor tf says; for another sensor give T_imu_lidar in a rig file (--rig)"
        )
    raise RecordingError(
        f"nothing links the LiDAR to the IMU frame {recording.imu.frame!r}",
        where=recording.name,
        fix="give T_imu_lidar in a rig file (--rig), or record tf_static",
    )


def horizontal_view_deg(points_lidar: NDArray[np.floating]) -> float:
    """Return how many degrees of azimuth (N, 3) returns cover, in steps of five."""
    steps = np.floor(np.degrees(np.arctan2(points_lidar[:, 1], points_lidar[:, 0])) / 5.0)
    return 5.0 * len(np.unique(steps % 72))
