"""The lab's ``poses.csv``: ``id,tx,ty,tz,qx,qy,qz,qw``, camera to map; stamps lie beside it."""

from __future__ import annotations

import numpy as np

from civil_rgbd.errors import RecordingError, UsageError
from civil_rgbd.trajectories.pose_table import (
    Beside,
    Poses,
    PoseTable,
    broken_line,
    numbers,
    require_quaternion_order,
)

COLUMNS = 8


def looks_like_lab_csv(table: PoseTable) -> bool:
    """Tell by the first row: eight columns with commas, and an id rather than a stamp."""
    first = table.rows[0].cells[0].removesuffix(".0")
    is_id = first.isdecimal() and len(first) <= len("999999")
    return table.columns == COLUMNS and table.commas and is_id


def read_lab_csv(table: PoseTable, beside: Beside) -> Poses:
    """Read poses; an id counts the lines of the time list, from 1.

    A file with the id 0 counts from 0.

    Raises:
        UsageError: no time list is given.
        RecordingError: a line breaks the format, or an id has no stamp.
    """
    require_quaternion_order(table, "xyzw")
    values = numbers(table, columns=(COLUMNS,), first=1, count=7)
    if beside.times is None:
        raise UsageError(
            "the poses have ids but no stamps",
            where=table.path,
            fix="give the stamps that the ids count, one a line: --trajectory-times timestamps.txt",
        )
    ids = _ids(table)
    first = 0 if min(ids) == 0 else 1
    stamps_ns, count = beside.times.stamps_ns, len(beside.times.stamps_ns)
    rows = np.array(ids) - first
    if rows.min() < 0 or rows.max() >= count:
        at = int(np.argmax((rows < 0) | (rows >= count)))
        raise RecordingError(
            f"line {table.rows[at].line} of {table.path.name} has the id {ids[at]}, but the list "
            f"has {count} stamps, counted from {first}",
            where=beside.times.where,
            fix="give the list that belongs to these poses",
        )
    lines = [row.line for row in table.rows]
    return Poses(lines, stamps_ns[rows].tolist(), values[:, :3].copy(), values[:, 3:])


def _ids(table: PoseTable) -> list[int]:
    ids = []
    for row in table.rows:
        whole = row.cells[0].partition(".")[0]
        if (
            not whole.isdecimal()
            or len(whole) > len("999999999")
            or float(row.cells[0]) != int(whole)
        ):
            raise broken_line(table, row.line, "does not begin with an id (a whole number)")
        ids.append(int(whole))
    return ids
