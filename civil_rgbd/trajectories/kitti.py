"""KITTI trajectories: the first three rows of a transform a line, and a list of times beside."""

from __future__ import annotations

from typing import Final

import numpy as np

from civil_rgbd.errors import RecordingError, UsageError
from civil_rgbd.geometry.transforms import quaternion_from_matrix, rigid_fault, transform_from
from civil_rgbd.trajectories.pose_table import Beside, Poses, PoseTable, broken_line, numbers

COLUMNS: Final = 12

_TYPED_TOLERANCE: Final = 1e-3
"""How far numbers written with a few digits may be from a rotation; they are made exact then."""


def looks_like_kitti(table: PoseTable) -> bool:
    """Tell by the first row: twelve columns."""
    return table.columns == COLUMNS and not table.commas


def read_kitti(table: PoseTable, beside: Beside) -> Poses:
    """Read poses: one a line, in the order of the time list.

    Raises:
        UsageError: no time list is given.
        RecordingError: a line breaks the format, or the time list has another length.
    """
    values = numbers(table, columns=(COLUMNS,), first=0, count=COLUMNS).reshape(-1, 3, 4)
    if beside.times is None:
        raise UsageError(
            "a KITTI trajectory has no stamps",
            where=table.path,
            fix="give the stamp of each pose, one a line: --trajectory-times times.txt",
        )
    if len(beside.times.stamps_ns) != len(values):
        raise RecordingError(
            f"{len(values)} poses, but {len(beside.times.stamps_ns)} stamps",
            where=beside.times.where,
            fix=f"give one stamp for each line of {table.path.name}",
        )
    quaternions = np.empty((len(values), 4))
    for at, pose in enumerate(values):
        fault = rigid_fault(transform_from(pose[:, :3], pose[:, 3]), _TYPED_TOLERANCE)
        if fault:
            raise broken_line(table, table.rows[at].line, f"is no rigid transform ({fault})")
        quaternions[at] = quaternion_from_matrix(pose[:, :3])
    lines = [row.line for row in table.rows]
    return Poses(lines, beside.times.stamps_ns.tolist(), values[:, :, 3].copy(), quaternions)
