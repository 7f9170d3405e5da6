"""When each point was measured: what a cloud's time field means."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.constants import MAX_POINT_TIME_OFFSET_NS, NS_PER_S
from civil_rgbd.conversion.cdr import ContentError
from civil_rgbd.errors import RecordingError, UsageError
from civil_rgbd.resources import nearest

UNIT_NS: Final = {"s": NS_PER_S, "ms": 1_000_000, "us": 1_000, "ns": 1}
"""Nanoseconds in each unit of ``--point-time``."""

REFERENCES: Final = {
    "header": "header",
    "epoch": "epoch",
    "absolute": "epoch",
    "gps": "gps",
    "gps-week": "gps-week",
}
"""What ``--point-time`` may count from: the message's stamp, or the LiDAR clock's zero.

LAS has two more. ``gps``: its adjusted standard GPS time, that is since 6 January 1980 less 10^9 s;
``gps-week``: seconds of the GPS week in which the scan lies.
"""

_GPS_EPOCH_S: Final = 315_964_800  # 6 January 1980, in Unix time
_LEAP_S: Final = 18  # GPS is ahead of UTC by this since 1 January 2017 (IERS Bulletin C)
_WEEK_NS: Final = 604_800 * NS_PER_S
_GPS_ADJUSTED_S: Final = 1_000_000_000  # LAS 1.4, "Global Encoding"

IGNORE: Final = "none"
"""``--point-time none``: every point has its message's stamp."""

# (name, numpy type) -> unit, reference. None: seconds or nanoseconds, whichever the size says.
_KNOWN: Final[dict[tuple[str, str], tuple[str | None, str]]] = {
    ("t", "u4"): ("ns", "header"),  # Ouster
    ("offset_time", "u4"): ("ns", "header"),  # Livox
    ("time", "f4"): ("s", "header"),  # Velodyne
    ("timestamp", "f8"): (None, "epoch"),  # Hesai, RoboSense: s; Livox driver 2: ns
}
_LOOKS_LIKE_TIME: Final = re.compile(r"^(t|ts|dt)$|time|stamp", re.IGNORECASE)
_FAR_NS: Final = 4_000_000_000_000_000_000  # the year 2096; sums with a header stamp stay in int64


class PointTimeError(ContentError):
    """Points are stamped far from their message: most likely their unit is another one."""


@dataclass(frozen=True, slots=True)
class PointTime:
    """How to read a cloud's point times.

    Attributes:
        field: the cloud's field.
        unit: key of :data:`UNIT_NS`; None = seconds or nanoseconds by magnitude.
        reference: ``header``, ``epoch``, ``gps`` or ``gps-week``.
        unsigned: the values cannot be negative.
    """

    field: str
    unit: str | None
    reference: str
    unsigned: bool

    @property
    def reach_ns(self) -> tuple[int, int]:
        """How far a point's stamp may lie from its header's, inclusive."""
        offsets = self.unsigned and self.reference == "header"
        return (0 if offsets else -MAX_POINT_TIME_OFFSET_NS, MAX_POINT_TIME_OFFSET_NS)

    @property
    def words(self) -> str:
        """The rule as ``--point-time`` takes it; its unit is ``s|ns`` while that is open.

        >>> PointTime("t", "ns", "header", unsigned=True).words
        't:ns:header'
        """
        return f"{self.field}:{self.unit or 's|ns'}:{self.reference}"

    @property
    def meaning(self) -> str:
        """The rule for people.

        >>> PointTime("t", "ns", "header", unsigned=True).meaning
        't, ns after the header'
        """
        from_where = "after the header" if self.reference == "header" else "absolute"
        return f"{self.field}, {self.unit or 's or ns'} {from_where}"


def point_time_of(types: dict[str, str], option: str | None, *, where: object) -> PointTime | None:
    """Find out which field holds the point times, and in which unit.

    Args:
        types: field name to numpy type without byte order, ``"f4"``.
        option: ``FIELD:UNIT:REFERENCE``, ``none``, or None.
        where: file and topic, for errors.

    Returns:
        None when the cloud has no point times.

    Raises:
        UsageError: the option does not fit.
        RecordingError: a field looks like a time, but its unit is not known.

    >>> point_time_of({"x": "f4", "t": "u4"}, None, where="")
    PointTime(field='t', unit='ns', reference='header', unsigned=True)
    """
    if option is not None:
        return _from_option(types, option, where=where)
    for (name, code), (unit, reference) in _KNOWN.items():
        if types.get(name) == code:
            return PointTime(name, unit, reference, unsigned=code == "u4")
    unclear = [name for name in types if _LOOKS_LIKE_TIME.search(name)]
    if unclear:
        name = unclear[0]
        raise RecordingError(
            f"field {name!r} ({types[name]}) looks like a point time in an unknown unit",
            where=where,
            fix=f"say what it means: `--point-time {name}:UNIT:REFERENCE` with UNIT one of "
            f"{', '.join(UNIT_NS)} and REFERENCE header or epoch (of LAS also gps or gps-week); or "
            "`--point-time none`",
        )
    return None


def _from_option(types: dict[str, str], option: str, *, where: object) -> PointTime | None:
    if option == IGNORE:
        return None
    field, *rest = option.split(":")
    if len(rest) != 2 or rest[0] not in UNIT_NS or rest[1] not in REFERENCES:
        raise UsageError(
            f"--point-time {option!r} is not FIELD:UNIT:REFERENCE",
            where="--point-time",
            fix=f"UNIT is one of {', '.join(UNIT_NS)}, REFERENCE header or epoch, "
            "e.g. `--point-time t:us:header`; `none` ignores point times",
        )
    if field not in types:
        raise UsageError(
            f"--point-time names a field that the clouds do not have: {field!r}",
            where=where,
            fix=nearest(field, types),
        )
    return PointTime(field, rest[0], REFERENCES[rest[1]], unsigned=types[field].startswith("u"))


def settled(
    rule: PointTime,
    values: NDArray[np.generic],
    *,
    header_ns: int,
    points: NDArray[np.floating],
) -> PointTime:
    """Settle the unit of absolute times by the magnitude of one cloud's.

    Args:
        rule: perhaps without a unit.
        values: (N,) as recorded.
        header_ns: the message's stamp.
        points: (N, 3) metres; tells which points are returns.

    Returns:
        a rule with a unit; the same one where it had a unit, or where no return has a time.
    """
    if rule.unit is not None:
        return rule
    # Nanoseconds are a thousand million times seconds: a factor of 100,000 above the header's
    # own seconds tells them apart, for clocks that count from 1970 and for those from power-on.
    # The median, as single points may carry junk.
    times = _as_float64(values[_returned(points)])
    times = np.abs(times[np.isfinite(times)])
    if not times.any():
        return rule
    far = float(np.median(times)) > 1e5 * max(abs(header_ns) / NS_PER_S, 1.0)
    return replace(rule, unit="ns" if far else "s")


def point_stamps_ns(
    values: NDArray[np.generic], rule: PointTime, *, header_ns: int, points: NDArray[np.floating]
) -> NDArray[np.int64]:
    """Turn a cloud's time field into stamps.

    Points without a return may carry junk; theirs become the header's stamp.

    Args:
        values: (N,) as recorded.
        rule: what they mean.
        header_ns: the message's stamp.
        points: (N, 3) metres; tells which points are returns.

    Returns:
        (N,) int64 nanoseconds, LiDAR clock.

    Raises:
        PointTimeError: a return lies further from the header than a message can be long.
    """
    rule = settled(rule, values, header_ns=header_ns, points=points)
    unit_ns = UNIT_NS[rule.unit or "s"]  # without a return no time matters
    offsets_ns, usable = _whole_ns(values, unit_ns)
    if rule.reference != "header":
        offsets_ns += _zero_ns(rule.reference, header_ns) - header_ns
    if rule.reference == "gps-week":  # a scan may lie on the turn of a week
        offsets_ns = (offsets_ns + _WEEK_NS // 2) % _WEEK_NS - _WEEK_NS // 2
    near = usable & (np.abs(offsets_ns) <= MAX_POINT_TIME_OFFSET_NS)
    if not near.all():
        returned = _returned(points)
        astray = returned & ~near
        if astray.any():
            raise _astray(rule, offsets_ns[returned & usable], header_ns, astray)
        offsets_ns = np.where(near, offsets_ns, 0)
    stamps_ns: NDArray[np.int64] = offsets_ns + header_ns
    return stamps_ns


def _zero_ns(reference: str, header_ns: int) -> int:
    """Return the instant that a reference counts from, LiDAR clock (UTC for GPS times)."""
    if reference == "gps":
        return (_GPS_EPOCH_S + _GPS_ADJUSTED_S - _LEAP_S) * NS_PER_S
    if reference == "gps-week":
        since_ns = header_ns - (_GPS_EPOCH_S - _LEAP_S) * NS_PER_S
        return header_ns - since_ns % _WEEK_NS
    return 0


def _returned(points: NDArray[np.floating]) -> NDArray[np.bool_]:
    returned: NDArray[np.bool_] = np.isfinite(points).all(axis=1) & (points != 0).any(axis=1)
    return returned


def _whole_ns(
    values: NDArray[np.generic], unit_ns: int
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    if values.dtype.kind in "iu":
        whole = values.astype(np.int64) * unit_ns  # at most 2^32 s = 4.3e18 ns
        return whole, np.ones(len(values), dtype=np.bool_)
    floats = _as_float64(values)
    usable = np.isfinite(floats) & (np.abs(floats) < _FAR_NS / unit_ns)
    floats = np.where(usable, floats, 0.0)
    whole = np.floor(floats)  # apart from the fraction, which would lose its last bits
    ns = whole.astype(np.int64) * unit_ns + np.rint((floats - whole) * unit_ns).astype(np.int64)
    return ns, usable


def _as_float64(values: NDArray[np.generic]) -> NDArray[np.float64]:
    with np.errstate(invalid="ignore"):  # a signalling NaN is as good as any
        return values.astype(np.float64)


def _astray(
    rule: PointTime, offsets_ns: NDArray[np.int64], header_ns: int, astray: NDArray[np.bool_]
) -> PointTimeError:
    header_s = header_ns / NS_PER_S
    fix = (
        f"say what {rule.field!r} means: --point-time {rule.field}:UNIT:REFERENCE, it was read as "
        f"{rule.words}; or go without point times: --point-time none"
    )
    if not len(offsets_ns):
        return PointTimeError(
            f"field {rule.field!r} holds no finite point time before the year 2096; the header is "
            f"at {header_s:.6f} s",
            fix,
        )
    first_s = int(offsets_ns.min()) / NS_PER_S
    last_s = int(offsets_ns.max()) / NS_PER_S
    return PointTimeError(
        f"the times of {int(astray.sum())} points are more than "
        f"{MAX_POINT_TIME_OFFSET_NS / NS_PER_S:g} s from their header: field {rule.field!r} spans "
        f"{header_s + first_s:.6f} to {header_s + last_s:.6f} s, the header is at {header_s:.6f} s",
        fix,
    )
