"""What all trajectory files share: rows of numbers in, checked poses out."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.constants import NS_PER_S
from civil_rgbd.domain.stamps import StampList, is_comment, ns_from_seconds, read_lines
from civil_rgbd.errors import RecordingError
from civil_rgbd.geometry.trajectory import Trajectory
from civil_rgbd.geometry.transforms import unit_quaternion

NORM_TOLERANCE: Final = 1e-3
"""Quaternions typed with four decimals pass; a column that is none does not."""

_TOO_FAST_M_PER_S: Final = 100.0
_WILD_TURN_RAD: Final = 1.0
_NEIGHBOURS_NS: Final = NS_PER_S // 4
_QUATERNION: Final = re.compile(r"q\w*?_?([wxyz])(?:\s*\[.*)?$", re.ASCII)
_BODY: Final = re.compile(r"\bT_map_(camera|lidar|imu)\b", re.ASCII)


@dataclass(frozen=True, slots=True)
class Row:
    """One line that is no comment.

    Attributes:
        line: its number, from 1.
        cells: its columns.
    """

    line: int
    cells: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class PoseTable:
    """A text file taken apart; nothing of it is understood yet.

    Attributes:
        path: the file.
        rows: its lines, without comments and heading.
        commas: columns are separated by commas.
        heading: names of columns, lower case; empty when there are none.
        lines: all lines as they are.
    """

    path: Path
    rows: tuple[Row, ...]
    commas: bool
    heading: tuple[str, ...]
    lines: tuple[str, ...]

    @property
    def columns(self) -> int:
        """How many columns the first row has."""
        return len(self.rows[0].cells)

    @property
    def body(self) -> str | None:
        """Whose poses they are, where the comments before them say ``T_map_imu`` or the like."""
        above = self.lines[: self.rows[0].line - 1]
        said = {body for line in above if is_comment(line) for body in _BODY.findall(line)}
        return said.pop() if len(said) == 1 else None


@dataclass(frozen=True, slots=True)
class Beside:
    """What lies beside a trajectory file that lacks it.

    Attributes:
        times: stamps of its poses.
        metric_scale: metres in one of its units.
    """

    times: StampList | None = None
    metric_scale: float | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Poses:
    """Poses as read, not checked yet.

    Attributes:
        lines: (P,) line numbers, for errors.
        stamps_ns: (P,) LiDAR clock.
        translations_m: (P, 3) map frame.
        quaternions_xyzw: (P, 4), of any norm.
    """

    lines: Sequence[int]
    stamps_ns: Sequence[int]
    translations_m: NDArray[np.float64]
    quaternions_xyzw: NDArray[np.float64]


def read_pose_table(path: Path) -> PoseTable:
    """Read a trajectory file into rows.

    Raises:
        RecordingError: it cannot be read, is no text, or is empty.
    """
    lines = read_lines(path, what="the trajectory file", fix="check the path of --trajectory")
    said = [(number, line) for number, line in enumerate(lines, start=1) if not is_comment(line)]
    commas = bool(said) and "," in said[0][1]
    rows = [Row(number, _cells(line, commas=commas)) for number, line in said]
    heading: tuple[str, ...] = ()
    if rows and not _is_number(rows[0].cells[0]):
        heading = tuple(cell.lower() for cell in rows.pop(0).cells)
    else:
        comments = [line.strip() for line in lines if line.strip().startswith("#")]
        if comments:
            text = comments[-1].lstrip("# ").lower()
            heading = _cells(text, commas="," in text)
    if not rows:
        raise RecordingError(
            "the trajectory file holds no pose",
            where=path,
            fix="look whether whatever wrote it finished, and give --trajectory its result",
        )
    return PoseTable(path, tuple(rows), commas, heading, tuple(lines))


def _cells(line: str, *, commas: bool) -> tuple[str, ...]:
    if not commas:
        return tuple(line.split())
    cells = [cell.strip() for cell in line.split(",")]
    return tuple(cells[:-1] if len(cells) > 1 and not cells[-1] else cells)


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def numbers(
    table: PoseTable, *, columns: Sequence[int], first: int, count: int
) -> NDArray[np.float64]:
    """Return some neighbouring columns of every row as numbers.

    Args:
        table: any.
        columns: how many columns a row may have.
        first: the first column to return.
        count: how many.

    Returns:
        (P, count) float64, finite.

    Raises:
        RecordingError: a row has another number of columns, or something else than numbers.
    """
    result = np.empty((len(table.rows), count))
    for at, row in enumerate(table.rows):
        if len(row.cells) not in columns:
            allowed = " or ".join(map(str, columns))
            raise broken_line(table, row.line, f"has {len(row.cells)} columns, not {allowed}")
        try:
            result[at] = [float(cell) for cell in row.cells[first : first + count]]
        except ValueError as error:
            raise broken_line(
                table, row.line, f"holds something that is no number: {error}"
            ) from error
    finite = np.isfinite(result).all(axis=1)
    if not finite.all():
        row = table.rows[int(np.argmin(finite))]
        raise broken_line(table, row.line, "holds a number that is not finite")
    return result


def require_quaternion_order(table: PoseTable, order: str) -> None:
    """Refuse a heading that names its quaternion's columns in another order than the format's.

    Args:
        table: any.
        order: of the format, ``"xyzw"`` or ``"wxyz"``.

    Raises:
        RecordingError: the heading contradicts the format; nothing is guessed then.
    """
    found = [match.group(1) for match in map(_QUATERNION.match, table.heading) if match]
    named = "".join(found)
    if len(named) == 4 and named != order:
        raise RecordingError(
            f"the heading names the quaternion in the order {named}, the format has {order}",
            where=table.path,
            fix="export the trajectory in the order of its format, or name another format with "
            "--trajectory-format",
        )


def broken_line(table: PoseTable, line: int, what: str) -> RecordingError:
    """Compose the error for one line."""
    text = table.lines[line - 1].strip()
    shown = text if len(text) <= 80 else text[:77] + "..."
    return RecordingError(
        f"line {line} {what}: {shown!r}",
        where=table.path,
        fix="correct the line, or export the trajectory again; name its format with "
        "--trajectory-format if it is another",
    )


def stamps_in_seconds(table: PoseTable, *, column: int = 0) -> list[int]:
    """Read one column as decimal seconds, exactly.

    Returns:
        (P,) nanoseconds.

    Raises:
        RecordingError: a row holds no time in seconds.
    """
    stamps_ns = []
    for row in table.rows:
        try:
            stamps_ns.append(ns_from_seconds(row.cells[column]))
        except ValueError as error:
            raise RecordingError(
                f"line {row.line} has no stamp in seconds: {error}",
                where=table.path,
                fix="write stamps in seconds with their decimals, such as 1700000000.123456789",
            ) from error
    return stamps_ns


def checked_trajectory(table: PoseTable, poses: Poses) -> Trajectory:
    """Check poses and make them a trajectory.

    Args:
        table: where they come from.
        poses: as read.

    Raises:
        RecordingError: stamps repeat or step back, a quaternion is none, or the motion is none
            that a person, a robot or a car makes: columns or units are others than thought.
    """
    stamps_ns = np.array(poses.stamps_ns, dtype=np.int64)
    steps = np.diff(stamps_ns)
    if (steps <= 0).any():
        at = int(np.argmax(steps <= 0)) + 1
        relation = "the same as" if steps[at - 1] == 0 else "earlier than"
        raise broken_line(
            table,
            poses.lines[at],
            f"is stamped {_seconds(int(stamps_ns[at]))}, {relation} line {poses.lines[at - 1]} "
            f"at {_seconds(int(stamps_ns[at - 1]))}",
        )
    norms = np.sqrt((poses.quaternions_xyzw**2).sum(axis=1))
    wrong = ~(np.abs(norms - 1) <= NORM_TOLERANCE)
    if wrong.any():
        at = int(np.argmax(wrong))
        raise broken_line(
            table, poses.lines[at], f"has a quaternion of norm {norms[at]:.6g}, not 1"
        )
    quaternions = unit_quaternion(poses.quaternions_xyzw)
    _check_motion(table, stamps_ns, poses.translations_m, quaternions)
    return Trajectory(stamps_ns, poses.translations_m, quaternions)


def _check_motion(
    table: PoseTable,
    stamps_ns: NDArray[np.int64],
    translations_m: NDArray[np.float64],
    quaternions: NDArray[np.float64],
) -> None:
    """Refuse what no sensor does from pose to pose, in most of the poses that are close in time."""
    steps_ns = np.diff(stamps_ns)
    close = steps_ns <= _NEIGHBOURS_NS
    if not close.any():
        return
    moved = np.diff(translations_m, axis=0)[close]
    speed = np.sqrt((moved**2).sum(axis=1)) / (steps_ns[close] / NS_PER_S)
    # The chord between unit quaternions is at most half the angle: no arcsine is needed.
    chord = np.diff(quaternions, axis=0)[close]
    other = (quaternions[1:] + quaternions[:-1])[close]
    turn = 2 * np.sqrt(np.minimum((chord**2).sum(axis=1), (other**2).sum(axis=1)))
    for value, limit, said in (
        (float(np.median(speed)), _TOO_FAST_M_PER_S, "{:.0f} m/s"),
        (float(np.median(turn)), _WILD_TURN_RAD, "{:.1f} rad from pose to pose"),
    ):
        if value > limit:
            raise RecordingError(
                f"the poses make no motion: half of them move faster than {said.format(value)}",
                where=table.path,
                fix="check the order of its columns, the unit of its stamps (seconds) and of its "
                "translations (metres; --metric-scale gives metres per unit)",
            )


def _seconds(stamp_ns: int) -> str:
    sign, stamp_ns = ("-" if stamp_ns < 0 else ""), abs(stamp_ns)
    return f"{sign}{stamp_ns // NS_PER_S}.{stamp_ns % NS_PER_S:09d} s"
