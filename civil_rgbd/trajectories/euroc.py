"""EuRoC CSV: ``nanoseconds, px, py, pz, qw, qx, qy, qz`` and columns that are not read."""

from __future__ import annotations

import re
from typing import Final

import numpy as np

from civil_rgbd.trajectories.pose_table import (
    Beside,
    Poses,
    PoseTable,
    broken_line,
    numbers,
    require_quaternion_order,
)

COLUMNS: Final = (8, 11, 17)
"""The pose alone, with velocity, with velocity and biases."""

_EPOCH_NS: Final = re.compile(r"\d{16,19}", re.ASCII)


def looks_like_euroc(table: PoseTable) -> bool:
    """Tell by the first row: commas, and nanoseconds since 1970."""
    stamp = table.rows[0].cells[0]
    return table.commas and table.columns in COLUMNS and bool(_EPOCH_NS.fullmatch(stamp))


def read_euroc(table: PoseTable, beside: Beside) -> Poses:
    """Read poses; the quaternion's w comes first, and a heading that says otherwise is refused.

    Raises:
        RecordingError: a line breaks the format, or the heading names another order.
    """
    del beside
    require_quaternion_order(table, "wxyz")
    values = numbers(table, columns=COLUMNS, first=1, count=7)
    stamps_ns = []
    for row in table.rows:
        if not row.cells[0].isdecimal() or len(row.cells[0]) > 18 + 1:
            raise broken_line(table, row.line, "does not begin with whole nanoseconds")
        stamps_ns.append(int(row.cells[0]))
    if max(stamps_ns) > np.iinfo(np.int64).max:
        raise broken_line(table, table.rows[0].line, "or a later one is stamped beyond 64 bits")
    lines = [row.line for row in table.rows]
    return Poses(lines, stamps_ns, values[:, :3].copy(), values[:, [4, 5, 6, 3]])
