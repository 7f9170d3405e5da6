"""Stamps as other programs write them: decimal seconds or whole nanoseconds, one a line."""

from __future__ import annotations

import re
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.constants import NS_PER_S
from civil_rgbd.errors import RecordingError

_LATEST_S: Final = 4_000_000_000
"""The year 2096. What is larger counts in smaller units than seconds."""

_BEYOND_NS: Final = (_LATEST_S + 1) * NS_PER_S
_PLAIN: Final = re.compile(r"([+-]?)(\d{1,12})(?:\.(\d{0,9}))?", re.ASCII)
_EPOCH_NS: Final = re.compile(r"\d{17,19}", re.ASCII)
_COMMENTS: Final = ("#", "//", "%")


@dataclass(frozen=True, slots=True, eq=False)
class StampList:
    """A list of stamps that lies beside images, scans or poses.

    Attributes:
        stamps_ns: (N,) int64, ascending.
        names: what each stamp belongs to, without folders; None in a list of stamps alone.
        where: the file, for errors.
    """

    stamps_ns: NDArray[np.int64]
    names: tuple[str, ...] | None
    where: Path


def ns_from_seconds(text: str) -> int:
    """Turn decimal seconds into whole nanoseconds, exactly: a float would lose the last digits.

    Args:
        text: ``1305031098.6659`` or ``1.3050310986659e+09``; digits beyond nanoseconds are
            rounded to even.

    Raises:
        ValueError: it is no finite number, or no time before the year 2096.

    >>> ns_from_seconds("1305031098.666300001")
    1305031098666300001
    >>> ns_from_seconds("-0.5")
    -500000000
    """
    plain = _PLAIN.fullmatch(text)
    if plain:
        sign, whole, fraction = plain.groups()
        ns = int(whole) * NS_PER_S + int((fraction or "").ljust(9, "0"))
        ns = -ns if sign == "-" else ns
    else:
        try:
            seconds = Decimal(text)
        except InvalidOperation as error:
            raise ValueError(f"{text!r} is no number") from error
        if not seconds.is_finite():
            raise ValueError(f"{text!r} is no time in seconds")
        # The exponent is looked at first: 1e999999999 would fill the memory.
        small = seconds.adjusted() <= 12
        ns = int((seconds * NS_PER_S).to_integral_value()) if small else _BEYOND_NS
    if abs(ns) > _LATEST_S * NS_PER_S:
        raise ValueError(
            f"{text!r} is no time in seconds: it lies beyond the year 2096 (is it in milli-, "
            "micro- or nanoseconds?)"
        )
    return ns


def signed_seconds(ns: int) -> str:
    """Write a difference of stamps, all digits.

    >>> signed_seconds(-1_500_000_000)
    '-1.500000000'
    """
    sign = "-" if ns < 0 else "+"
    return f"{sign}{abs(ns) // NS_PER_S}.{abs(ns) % NS_PER_S:09d}"


def read_lines(path: Path, *, what: str, fix: str) -> list[str]:
    """Read a text file that another program wrote.

    Args:
        path: UTF-8, with or without byte order mark, lines ended in any way.
        what: the file in words, ``"the trajectory file"``.
        fix: what to do when it cannot be read.

    Raises:
        RecordingError: it is not there, cannot be read, or is no text.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise RecordingError(
            f"{what} cannot be read: {error.strerror or error}", where=path, fix=fix
        ) from error
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise RecordingError(f"{what} is no text: {error}", where=path, fix=fix) from error
    return text.split("\n") if "\r" not in text else text.splitlines()


def is_comment(line: str) -> bool:
    """Tell whether a line says nothing: it is blank or begins with ``#``, ``//`` or ``%``."""
    line = line.strip()
    return not line or line.startswith(_COMMENTS)


def read_stamp_list(path: Path) -> StampList:
    """Read a time list.

    Args:
        path: a text file with one stamp a line, or a name and a stamp (either first), separated
            by a comma or spaces. Stamps are decimal seconds; a list of whole numbers of 17 digits
            or more counts nanoseconds. Lines that begin with ``#`` and a heading are skipped.

    Raises:
        RecordingError: it cannot be read, a line is no stamp, or stamps do not ascend.
    """
    rows: list[tuple[int, list[str]]] = []
    lines = read_lines(path, what="the time list", fix="check the path")
    for number, line in enumerate(lines, start=1):
        if not is_comment(line):
            cells = [cell.strip() for cell in line.split(",")] if "," in line else line.split()
            rows.append((number, [cell for cell in cells if cell]))
    if rows and not any(map(_is_number, rows[0][1])):
        del rows[0]  # a heading: image,time
    if not rows:
        raise RecordingError(
            "the time list holds no stamp", where=path, fix="give one stamp a line, in seconds"
        )
    columns = {len(cells) for _, cells in rows}
    if len(columns) > 1 or not columns <= {1, 2}:
        number, cells = next(
            row for row in rows if len(row[1]) != len(rows[0][1]) or len(row[1]) > 2
        )
        raise RecordingError(
            f"line {number} has {len(cells)} columns: {lines[number - 1].strip()!r}",
            where=path,
            fix="give a stamp, or a name and a stamp, on every line",
        )
    stamps = [(number, cells[_stamp_column(rows)]) for number, cells in rows]
    names = None
    if columns == {2}:
        names = tuple(_file_name(cells[1 - _stamp_column(rows)]) for _, cells in rows)
    return StampList(_ascending(_all_ns(stamps, path), stamps, path), names, path)


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _stamp_column(rows: list[tuple[int, list[str]]]) -> int:
    """A name and a stamp; where both are numbers the name comes first."""
    cells = rows[0][1]
    return 0 if len(cells) == 1 or (_is_number(cells[0]) and not _is_number(cells[1])) else 1


def _file_name(cell: str) -> str:
    return cell.replace("\\", "/").rpartition("/")[2]


def _all_ns(stamps: list[tuple[int, str]], path: Path) -> list[int]:
    if all(_EPOCH_NS.fullmatch(text) for _, text in stamps):
        return [int(text) for _, text in stamps]
    result = []
    for number, text in stamps:
        try:
            result.append(ns_from_seconds(text))
        except ValueError as error:
            raise RecordingError(
                f"line {number}: {error}",
                where=path,
                fix="give seconds with decimals on every line, or whole nanoseconds since 1970",
            ) from error
    return result


def _ascending(
    stamps_ns: list[int], stamps: list[tuple[int, str]], path: Path
) -> NDArray[np.int64]:
    if max(stamps_ns) > np.iinfo(np.int64).max:
        raise RecordingError(
            f"a stamp is beyond what 64 bits hold: {max(stamps_ns)}",
            where=path,
            fix="give nanoseconds since 1970",
        )
    array = np.array(stamps_ns, dtype=np.int64)
    wrong = np.flatnonzero(np.diff(array) <= 0)
    if len(wrong):
        at = int(wrong[0]) + 1
        relation = "the same as" if array[at] == array[at - 1] else "earlier than"
        raise RecordingError(
            f"line {stamps[at][0]}: the stamp {stamps[at][1]} is {relation} the one before, "
            f"{stamps[at - 1][1]}",
            where=path,
            fix="order the list by time, each stamp once; is it the right file?",
        )
    return array
