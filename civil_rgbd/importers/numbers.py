"""Tables of numbers in text files, whoever wrote them: commas, blanks, tabs, headers, comments."""

from __future__ import annotations

import datetime as dt
import re
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import Final

from civil_rgbd.constants import NS_PER_S
from civil_rgbd.errors import RecordingError

_SPLIT: Final = re.compile(r"[\s,;]+")
_DATE: Final = re.compile(r"(\d{4}-\d\d-\d\d)[ T](\d\d:\d\d:\d\d)(?:\.(\d{1,9})\d*)?Z?")
_UNITS: Final = (
    (Decimal(10) ** 11, NS_PER_S),  # seconds: until the year 5138
    (Decimal(10) ** 14, 10**6),  # milliseconds
    (Decimal(10) ** 17, 10**3),  # microseconds
    (Decimal(10) ** 20, 1),  # nanoseconds
)
"""A stamp below the first number counts in the second, nanoseconds each."""


@dataclass(frozen=True, slots=True)
class Table:
    """The rows of a text file.

    Attributes:
        header: names of the columns, lower case; () where the file has none.
        rows: the words of each row.
        path: the file.
    """

    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    path: Path


def read_text(path: Path) -> str:
    """Read a text file, with or without a byte order mark.

    Raises:
        RecordingError: it cannot be read, or is no text.
    """
    try:
        return path.read_text("utf-8-sig")
    except OSError as error:
        raise RecordingError(
            f"the file cannot be read: {error.strerror}", where=path, fix="check the path"
        ) from error
    except ValueError as error:
        raise RecordingError(
            "this is no text file", where=path, fix="give a text file of numbers"
        ) from error


def read_table(path: Path) -> Table:
    """Read rows of words; ``#`` begins a comment, a first row without numbers is a header.

    Raises:
        RecordingError: the file cannot be read.
    """
    header: tuple[str, ...] = ()
    rows: list[tuple[str, ...]] = []
    for line in read_text(path).splitlines():
        words = tuple(word for word in _SPLIT.split(line.partition("#")[0].strip()) if word)
        if not words:
            # Units in brackets go first: EuRoC writes `p_RS_R_x [m]`.
            bare = re.sub(r"\[[^\]]*\]", "", line.strip().lstrip("#"))
            comment = tuple(_column(word) for word in _SPLIT.split(bare.strip()) if word)
            if not rows and {"qx", "qw"} <= set(comment):
                header = comment
            continue
        if not rows and not header and not any(map(is_number, words)):
            header = tuple(map(_column, words))
        else:
            rows.append(words)
    return Table(header, tuple(rows), path)


def _column(name: str) -> str:
    """One name for a column, whoever named it: ``tx ty tz qx qy qz qw`` for parts of a pose.

    >>> _column("q_RS_w"), _column("p_RS_R_x"), _column("X"), _column('"frame"')
    ('qw', 'tx', 'tx', 'frame')
    """
    plain = name.lower().strip("\"' ")
    rotation = re.fullmatch(r"q(?:uat(?:ernion)?)?[a-z_]*?_?([xyzw])", plain)
    place = re.fullmatch(r"(?:(?:p|pos|position|t|trans|translation)[a-z_]*?_?)?([xyz])", plain)
    return f"q{rotation[1]}" if rotation else f"t{place[1]}" if place else plain


def is_number(word: str) -> bool:
    """Tell whether a word is a number; ``nan`` and ``-inf`` are.

    >>> is_number("-1.5e3"), is_number("-inf"), is_number("a.png")
    (True, True, False)
    """
    try:
        float(word)
    except ValueError:
        return False
    return True


def stamp_ns(word: str, *, where: object) -> int:
    """Turn a time stamp into nanoseconds, exactly; its unit is told by its size.

    Args:
        word: seconds, milliseconds, microseconds or nanoseconds since the epoch or since any
            start, or a date with time (KITTI's ``timestamps.txt``).
        where: the file, for the message.

    Raises:
        RecordingError: it is none.

    >>> stamp_ns("1305031102.175304", where="rgb.txt"), stamp_ns("0.1", where="rgb.txt")
    (1305031102175304000, 100000000)
    """
    date = _DATE.fullmatch(word.strip())
    if date:
        day = dt.datetime.fromisoformat(f"{date[1]}T{date[2]}+00:00")
        return int(day.timestamp()) * NS_PER_S + int((date[3] or "0").ljust(9, "0"))
    try:
        value = Decimal(word)
        for limit, unit_ns in _UNITS:
            if abs(value) < limit:
                return int((value * unit_ns).to_integral_value())
    except InvalidOperation:
        pass
    raise RecordingError(
        f"{word!r} is no time stamp",
        where=where,
        fix="write seconds or nanoseconds, one stamp a line",
    )
