"""TUM files: what engines leave, read exactly; and ours, written so that they come back exactly."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Final

import numpy as np

from civil_rgbd.constants import NS_PER_S
from civil_rgbd.errors import OdometryError
from civil_rgbd.geometry.trajectory import Trajectory
from civil_rgbd.geometry.transforms import unit_quaternion

_STAMP: Final = re.compile(r"(\d+)(?:\.(\d*))?")
_NORM_TOLERANCE = 1e-3  # six printed decimals keep a norm to 1e-6; more is no rounding


def read_engine_poses(path: Path) -> Trajectory:
    """Read what an engine wrote; nothing of it is believed unchecked.

    Stamps are read digit by digit: a float64 of seconds since 1970 is only good to 0.2 us.

    Args:
        path: lines ``seconds tx ty tz qx qy qz qw``.

    Raises:
        OdometryError: it is not there, empty, not of that form, or not in order of time.
    """
    try:
        lines = path.read_text(encoding="ascii", errors="replace").splitlines()
    except OSError as error:
        raise _odd(path, f"cannot be read: {error.strerror or error}") from error
    rows = [(n, line.split()) for n, line in enumerate(lines, 1) if _says_something(line)]
    if not rows:
        raise _odd(path, "holds no pose")
    stamps = np.empty(len(rows), dtype=np.int64)
    numbers = np.empty((len(rows), 7))
    for k, (line, words) in enumerate(rows):
        stamp = _STAMP.fullmatch(words[0])
        values = [_number(word) for word in words[1:]]
        if stamp is None or len(values) != 7 or not all(map(math.isfinite, values)):
            raise _odd(path, f"has no pose in line {line}: {' '.join(words)[:80]!r}")
        stamps[k] = int(stamp[1]) * NS_PER_S + int((stamp[2] or "")[:9].ljust(9, "0"))
        numbers[k] = values
    norms = np.sqrt((numbers[:, 3:] ** 2).sum(axis=1))
    if not (np.abs(norms - 1) <= _NORM_TOLERANCE).all():
        raise _odd(path, "has a quaternion that is not of norm 1")
    try:
        # Twice: one scaling of a rounded quaternion can miss norm 1 by more than a last bit.
        turns = unit_quaternion(unit_quaternion(numbers[:, 3:]))
        return Trajectory(stamps, numbers[:, :3], turns)
    except ValueError as error:
        raise _odd(path, f"makes no trajectory: {error}") from error


def tum_text(trajectory: Trajectory, remarks: tuple[str, ...] = ()) -> str:
    """Write a trajectory as TUM lines that read back bit for bit.

    Args:
        trajectory: poses.
        remarks: put before them as comments.
    """
    lines = [f"# {remark}" for remark in remarks]
    lines += ["# seconds tx ty tz qx qy qz qw"]
    rows = np.hstack([trajectory.translations_m, trajectory.quaternions_xyzw]).tolist()
    for stamp_ns, row in zip(trajectory.stamps_ns.tolist(), rows, strict=True):
        lines.append(f"{seconds_text(stamp_ns)} {' '.join(map(repr, row))}")
    return "\n".join(lines) + "\n"


def seconds_text(stamp_ns: int) -> str:
    """Write a stamp as seconds with all nine digits.

    >>> seconds_text(1_700_000_000_000_000_001)
    '1700000000.000000001'
    """
    seconds, nanoseconds = divmod(stamp_ns, NS_PER_S)
    return f"{seconds}.{nanoseconds:09d}"


def _says_something(line: str) -> bool:
    return bool(line.strip()) and not line.lstrip().startswith("#")


def _number(word: str) -> float:
    try:
        return float(word)
    except ValueError:
        return math.nan


def _odd(path: Path, what: str) -> OdometryError:
    return OdometryError(
        f"the engine's answer {what}",
        where=path.name,
        fix="look at the engine's words with --keep FOLDER; try another engine with --engine",
    )
