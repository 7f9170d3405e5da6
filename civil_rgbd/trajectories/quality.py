"""``POSES.quality.csv``: the quality of each pose, in a file beside the poses."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.constants import NS_PER_S
from civil_rgbd.domain.stamps import ns_from_seconds
from civil_rgbd.errors import RecordingError
from civil_rgbd.geometry.trajectory import Trajectory

SUFFIX: Final = ".quality.csv"
COLUMNS: Final = ("stamp", "quality")
"""The first two columns; what else stands in a row is for people."""


def quality_path(poses: Path) -> Path:
    """Return where the quality of a pose file lies.

    >>> quality_path(Path("scans/poses.tum")).as_posix()
    'scans/poses.quality.csv'
    """
    return poses.with_name(poses.stem + SUFFIX)


def quality_text(trajectory: Trajectory, details: Mapping[str, NDArray[np.float64]]) -> str:
    """Write the quality of a trajectory as CSV.

    Args:
        trajectory: with quality.
        details: further columns, (P,) each; for people.

    Raises:
        ValueError: the trajectory has no quality.
    """
    if trajectory.quality is None:
        raise ValueError("the trajectory has no quality")
    table = np.column_stack([trajectory.quality, *details.values()])
    lines = [",".join((*COLUMNS, *details))]
    for stamp_ns, row in zip(trajectory.stamps_ns.tolist(), table.tolist(), strict=True):
        seconds, nanoseconds = divmod(stamp_ns, NS_PER_S)
        numbers = (repr(row[0]), *(f"{value:.6g}" for value in row[1:]))
        lines.append(f"{seconds}.{nanoseconds:09d},{','.join(numbers)}")
    return "\n".join(lines) + "\n"


def with_quality(trajectory: Trajectory, path: Path, *, time_offset_ns: int = 0) -> Trajectory:
    """Return the trajectory with the quality that a file states.

    Args:
        trajectory: poses.
        path: CSV with a row for each pose, in the same order, at the same stamps.
        time_offset_ns: what was added to the stamps of the poses.

    Raises:
        RecordingError: the file cannot be read, or belongs to other poses.
    """
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, ValueError) as error:
        raise _odd(path, f"cannot be read: {error}") from error
    rows = [line.split(",") for line in lines if line.strip() and not line.startswith("#")]
    if not rows or tuple(word.strip() for word in rows[0][:2]) != COLUMNS:
        raise _odd(path, f"does not begin with the columns {', '.join(COLUMNS)}")
    stamps = np.empty(len(rows) - 1, dtype=np.int64)
    quality = np.empty(len(rows) - 1)
    for k, row in enumerate(rows[1:]):
        try:
            stamps[k], quality[k] = ns_from_seconds(row[0].strip()), float(row[1])
        except (ValueError, IndexError) as error:
            raise _odd(path, f"has no stamp and quality in row {k + 1}: {row[:2]}") from error
        if not (math.isfinite(quality[k]) and quality[k] >= 0):
            raise _odd(path, f"has the quality {row[1]} in row {k + 1}")
    if not np.array_equal(stamps + time_offset_ns, trajectory.stamps_ns):
        raise _odd(
            path, f"has {len(stamps)} rows, not those of the {len(trajectory.stamps_ns)} poses"
        )
    return replace(trajectory, quality=quality)


def _odd(path: Path, what: str) -> RecordingError:
    return RecordingError(
        f"the quality of the poses {what}",
        where=path,
        fix="compute the poses again with `civil-rgbd poses`, or move this file away: then the "
        "poses have no quality",
    )
