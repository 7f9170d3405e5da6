"""TUM trajectories: ``stamp tx ty tz qx qy qz qw``, seconds and metres."""

from __future__ import annotations

from civil_rgbd.trajectories.pose_table import (
    Beside,
    Poses,
    PoseTable,
    numbers,
    require_quaternion_order,
    stamps_in_seconds,
)

COLUMNS = 8


def looks_like_tum(table: PoseTable) -> bool:
    """Tell by the first row: eight columns without commas, a stamp with decimals or of an epoch."""
    first = table.rows[0].cells[0]
    stamp = "." in first or "e" in first.lower() or len(first) > len("123456")
    return table.columns == COLUMNS and not table.commas and stamp


def read_tum(table: PoseTable, beside: Beside) -> Poses:
    """Read poses; the file says everything but whose poses they are.

    Raises:
        RecordingError: a line breaks the format.
    """
    del beside
    require_quaternion_order(table, "xyzw")
    values = numbers(table, columns=(COLUMNS,), first=1, count=7)
    lines = [row.line for row in table.rows]
    return Poses(lines, stamps_in_seconds(table), values[:, :3].copy(), values[:, 3:])
