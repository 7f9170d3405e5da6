"""Does a bridge say all that a contribution must say?"""

from __future__ import annotations

import datetime as dt
import re
from collections.abc import Callable, Iterator
from typing import Final

from civil_rgbd.constants import NS_PER_S
from civil_rgbd.domain.bridge import UNSTATED_LICENCE, BridgeInfo, Contribution, Manifest
from civil_rgbd.domain.frame import FrameRow
from civil_rgbd.domain.vocabulary import COUNTRIES, DATA_LICENCES
from civil_rgbd.format.layout import MANIFEST
from civil_rgbd.resources import nearest
from civil_rgbd.validation.documents import BridgeDocuments
from civil_rgbd.validation.report import Finding

ALLOWED_PRECISION_M: Final = {"exact": 0.0, "town": 1_000.0, "region": 10_000.0, "country": 100_000}
"""How vague coordinates must be, by what the owner allows."""

_NO_WORDS: Final = re.compile(
    r"(tbd|tba|todo|fixme|xxx+|n/?a|none|null|unknown|\?+|\.+|-+)", re.IGNORECASE
)
_REACHABLE: Final = re.compile(r"[^@\s]+@[^@\s]+\.[^@\s]+|https?://\S+|doi:\S+|10\.\d{4,}/\S+")
_CLOCK_WAS_SET_NS: Final = 946_684_800 * NS_PER_S  # 2000-01-01: earlier stamps count from power-on


def check_contribution(read: BridgeDocuments, bridge: str) -> Iterator[Finding]:
    """Ask a bridge for everything that the contribution profile demands.

    Args:
        read: the bridge's documents.
        bridge: its name in findings.

    Returns:
        one finding for each gap; nothing where the manifest cannot be read, which is a finding
        of its own.
    """
    if read.manifest is None:
        return
    for code, check in _CHECKS.items():
        for message in check(read.manifest):
            yield Finding(code, message, MANIFEST, bridge)
    for message in _stamp_faults(read.manifest.info, read.rows or ()):
        yield Finding("contribution-dates-stamps", message, MANIFEST, bridge)


def licence_fault(licence: str) -> str | None:
    """Say in words why a licence does not do for a contribution; None where it does.

    >>> licence_fault("cc-by-4.0")
    "'cc-by-4.0' is written CC-BY-4.0"
    """
    if licence in DATA_LICENCES:
        return None
    if licence == UNSTATED_LICENCE:
        return f"the licence is {licence}: nobody may use the data"
    spelt = {known.lower(): known for known in DATA_LICENCES}
    if licence.lower() in spelt:
        return f"{licence!r} is written {spelt[licence.lower()]}"
    if re.search(r"[()\s]", licence):
        return f"{licence!r} is an expression of several licences: choose one for the data"
    return f"{licence!r} is no SPDX id of a licence for data; {nearest(licence, DATA_LICENCES)}"


def date_fault(date: str) -> str | None:
    """Say in words why a date of the calendar is none; None for a day, a month or a year.

    >>> date_fault("2024-06"), date_fault("2024-02-30")
    (None, "'2024-02-30' is no day of the calendar")
    """
    if not re.fullmatch(r"[0-9]{4}(-[0-9]{2}(-[0-9]{2})?)?", date):
        return f"{date!r} is no date: write 2024-06-01, 2024-06 or 2024"
    try:
        first = dt.date.fromisoformat(date + "-01" * (2 - date.count("-")))
    except ValueError:
        return f"{date!r} is no day of the calendar"
    # A day more: somewhere it is tomorrow already.
    if first > dt.datetime.now(tz=dt.UTC).date() + dt.timedelta(days=1):
        return f"{date!r} lies in the future"
    return None


def _said(words: str | None) -> bool:
    return bool(words and words.strip() and not _NO_WORDS.fullmatch(words.strip()))


def _unsaid(**values: str | None) -> Iterator[str]:
    """One message for each value that says nothing, by its dotted key."""
    for key, words in values.items():
        if not _said(words):
            name = key.replace("__", ".")
            yield f"{name} is {words!r}, which says nothing" if words else f"{name} is not stated"


def _stated(info: BridgeInfo) -> Contribution:
    return info.contribution or Contribution()


def _licence(manifest: Manifest) -> Iterator[str]:
    fault = licence_fault(manifest.info.licence)
    if fault:
        yield fault


def _consent(manifest: Manifest) -> Iterator[str]:
    info = manifest.info
    yield from _unsaid(
        owner=info.owner,
        owner_consent=info.owner_consent,
        contribution__consent=_stated(info).consent,
    )


def _citation(manifest: Manifest) -> Iterator[str]:
    yield from _unsaid(citation=manifest.info.citation)


def _contact(manifest: Manifest) -> Iterator[str]:
    contact = manifest.info.contact
    if not _said(contact):
        yield from _unsaid(contact=contact)
    elif not _REACHABLE.search(contact or ""):
        yield f"contact {contact!r} has neither an e-mail address nor a web page"


def _place(manifest: Manifest) -> Iterator[str]:
    info = manifest.info
    precision = _stated(info).place_precision
    yield from _unsaid(
        place=info.place, country=info.country, contribution__place_precision=precision
    )
    if info.country and info.country not in COUNTRIES:
        yield f"country {info.country!r} is no code of ISO 3166-1"
    if info.region is None and precision in {"exact", "town", "region"}:
        yield f"region is not stated, and the owner allows the place to the {precision}"
    if info.region and info.country and not info.region.startswith(f"{info.country}-"):
        yield f"region {info.region!r} lies in no country {info.country!r}"
    yield from _coordinates(info, precision)


def _coordinates(info: BridgeInfo, precision: str | None) -> Iterator[str]:
    if info.location is None:
        return
    if info.location.precision_m is None:
        yield "location.precision_m is not stated: within how many metres is the place true?"
        return
    allowed_m = ALLOWED_PRECISION_M.get(precision or "exact", 0.0)
    if info.location.precision_m < allowed_m:
        yield (
            f"location is stated to {info.location.precision_m:g} m, and the owner allows the "
            f"{precision}: {allowed_m:g} m or vaguer"
        )


def _structure(manifest: Manifest) -> Iterator[str]:
    structure = manifest.info.structure
    if structure is None or structure.type is None:
        yield "structure.type is not stated"
    elif structure.type == "other" and not _said(structure.note):
        yield "structure.type is 'other', and structure.note does not say what"
    if structure is None or structure.year_built is None:
        yield "structure.year_built is not stated"
        return
    years = [int(date[:4]) for date in manifest.info.survey_dates]
    if years and structure.year_built > max(years):
        yield f"structure.year_built is {structure.year_built}, the last survey was in {max(years)}"


def _rig(manifest: Manifest) -> Iterator[str]:
    yield from _unsaid(sensors=manifest.info.sensors)
    if manifest.rig is None and manifest.origin != "imported":
        yield "the manifest has no rig"


def _calibration(manifest: Manifest) -> Iterator[str]:
    stated = _stated(manifest.info)
    yield from _unsaid(
        contribution__calibration_method=stated.calibration_method,
        contribution__calibration_date=stated.calibration_date,
        contribution__calibration_report=stated.calibration_report,
    )
    fault = date_fault(stated.calibration_date) if stated.calibration_date else None
    if fault:
        yield f"contribution.calibration_date: {fault}"


def _dates(manifest: Manifest) -> Iterator[str]:
    if not manifest.info.survey_dates:
        yield "survey_dates is not stated"
    for date in manifest.info.survey_dates:
        fault = date_fault(date)
        if fault:
            yield f"survey_dates: {fault}"


def _privacy(manifest: Manifest) -> Iterator[str]:
    stated = _stated(manifest.info)
    yield from _unsaid(
        privacy=manifest.info.privacy,
        contribution__faces=stated.faces,
        contribution__plates=stated.plates,
    )


def _stamp_faults(info: BridgeInfo, rows: tuple[FrameRow, ...]) -> Iterator[str]:
    """Do the frames' stamps fall on the days of the survey, give or take a time zone?"""
    stamps_ns = [row.stamp_ns for row in rows if row.stamp_ns >= _CLOCK_WAS_SET_NS]
    if not stamps_ns or not info.survey_dates or any(map(date_fault, info.survey_dates)):
        return
    first, last = (_day(stamp) for stamp in (min(stamps_ns), max(stamps_ns)))
    days = [first + dt.timedelta(days=n) for n in range(-1, min((last - first).days, 366) + 2)]
    if not any(str(day).startswith(info.survey_dates) for day in days):
        yield f"the frames are stamped {first}, survey_dates are {', '.join(info.survey_dates)}"


def _day(stamp_ns: int) -> dt.date:
    # Not fromtimestamp: it refuses stamps that int64 holds, and depends on the platform.
    days = min(stamp_ns // (86_400 * NS_PER_S), 2_900_000)  # the year 9909: what date can say
    return dt.date(1970, 1, 1) + dt.timedelta(days=days)


_CHECKS: Final[dict[str, Callable[[Manifest], Iterator[str]]]] = {
    "contribution-licence": _licence,
    "contribution-consent": _consent,
    "contribution-citation": _citation,
    "contribution-contact": _contact,
    "contribution-place": _place,
    "contribution-structure": _structure,
    "contribution-rig": _rig,
    "contribution-calibration": _calibration,
    "contribution-dates": _dates,
    "contribution-privacy": _privacy,
}
