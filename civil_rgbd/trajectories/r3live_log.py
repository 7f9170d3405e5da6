"""R3LIVE's ``lic_lio.log``: its whole state a line, of which time, rotation and place are read.

67 columns: 0 the time in seconds since its first IMU message, 1-3 the rotation vector, 4-6 the
place of the IMU (`dump_lio_state_to_log` in r3live_vio.cpp).
"""

from __future__ import annotations

from civil_rgbd.geometry.angles import quaternions_from_rotation_vectors
from civil_rgbd.trajectories.pose_table import (
    Beside,
    Poses,
    PoseTable,
    numbers,
    stamps_in_seconds,
)

COLUMNS = 67


def looks_like_r3live_log(table: PoseTable) -> bool:
    """Tell by the first row: 67 columns."""
    return table.columns == COLUMNS and not table.commas


def read_r3live_log(table: PoseTable, beside: Beside) -> Poses:
    """Read the poses of the IMU.

    Raises:
        RecordingError: a line breaks the format.
    """
    del beside
    values = numbers(table, columns=(COLUMNS,), first=1, count=6)
    quaternions = quaternions_from_rotation_vectors(values[:, :3])
    lines = [row.line for row in table.rows]
    return Poses(lines, stamps_in_seconds(table), values[:, 3:].copy(), quaternions)
