"""The contribution profile: one gap a test, and what it says to do."""

from __future__ import annotations

import dataclasses
import datetime as dt

import pytest

from civil_rgbd.domain.bridge import BridgeInfo, Contribution, Location, Structure
from civil_rgbd.format.documents import schema_faults
from civil_rgbd.format.manifest import manifest_to_document
from civil_rgbd.validation.contribution import check_contribution, date_fault, licence_fault
from civil_rgbd.validation.documents import BridgeDocuments
from civil_rgbd.validation.report import CODES

from ..data.format_v1 import make

WHOLE = BridgeInfo(
    "B1",
    licence="CC-BY-4.0",
    place="by the river Grand",
    country="CA",
    region="CA-ON",
    location=Location(43.5, -80.5, 5000.0),
    structure=Structure(type="girder", year_built=1968),
    owner="Town of Nowhere",
    owner_consent="letter of its engineer",
    citation="Someone: a bridge",
    contact="someone@example.org",
    survey_dates=("2023-11-14",),
    sensors="Livox Avia and D455 on one rod",
    privacy="looked through by two people",
    contribution=Contribution(
        place_precision="town",
        consent="written",
        calibration_method="target",
        calibration_date="2023-11",
        calibration_report="0.4 px over 24 views",
        faces="blurred",
        plates="none visible",
    ),
)


def findings(info: BridgeInfo, **others: object) -> list[tuple[str, str]]:
    manifest = dataclasses.replace(make.manifest(0.25), info=info, **others)
    assert schema_faults(manifest_to_document(manifest), kind="manifest") == []
    read = BridgeDocuments(manifest=manifest)
    return [(found.code, found.message) for found in check_contribution(read, "B1")]


def without(**changes: object) -> BridgeInfo:
    stated = {key: value for key, value in changes.items() if hasattr(WHOLE.contribution, key)}
    rest = {key: value for key, value in changes.items() if key not in stated}
    assert WHOLE.contribution is not None
    contribution = dataclasses.replace(WHOLE.contribution, **stated)  # type: ignore[arg-type]
    return dataclasses.replace(WHOLE, contribution=contribution, **rest)  # type: ignore[arg-type]


def test_a_bridge_that_says_everything_has_no_gap() -> None:
    assert findings(WHOLE) == []


@pytest.mark.parametrize(
    ("info", "code", "words"),
    [
        (without(licence="LicenseRef-Unstated"), "licence", "nobody may use the data"),
        (without(licence="MIT OR Apache-2.0"), "licence", "an expression of several licences"),
        (without(licence="CC-BY-4"), "licence", "did you mean 'CC-BY-4.0'"),
        (without(owner=None), "consent", "owner is not stated"),
        (without(owner="  "), "consent", "owner is '  ', which says nothing"),
        (without(owner_consent="TBD"), "consent", "owner_consent is 'TBD', which says nothing"),
        (without(consent=None), "consent", "contribution.consent is not stated"),
        (without(citation=None), "citation", "citation is not stated"),
        (without(contact=None), "contact", "contact is not stated"),
        (without(contact="the office"), "contact", "neither an e-mail address nor a web page"),
        (without(place=None), "place", "place is not stated"),
        (without(country=None), "place", "country is not stated"),
        (without(country="XX", region="XX-1"), "place", "'XX' is no code of ISO 3166-1"),
        (without(region=None), "place", "the owner allows the place to the town"),
        (without(region="US-NY"), "place", "'US-NY' lies in no country 'CA'"),
        (without(place_precision=None), "place", "place_precision is not stated"),
        (without(location=Location(43.5, -80.5)), "place", "within how many metres"),
        (without(location=Location(43.5, -80.5, 50.0)), "place", "1000 m or vaguer"),
        (without(structure=None), "structure", "structure.type is not stated"),
        (
            without(structure=Structure(type="other", year_built=1968)),
            "structure",
            "structure.note does not say what",
        ),
        (without(structure=Structure(type="girder")), "structure", "year_built is not stated"),
        (
            without(structure=Structure(type="girder", year_built=2024)),
            "structure",
            "is 2024, the last survey was in 2023",
        ),
        (without(sensors=None), "rig", "sensors is not stated"),
        (without(calibration_method=None), "calibration", "calibration_method is not stated"),
        (without(calibration_date=None), "calibration", "calibration_date is not stated"),
        (without(calibration_date="2023-13"), "calibration", "is no day of the calendar"),
        (without(calibration_report="?"), "calibration", "which says nothing"),
        (without(survey_dates=()), "dates", "survey_dates is not stated"),
        (without(survey_dates=("2023-02-30",)), "dates", "'2023-02-30' is no day"),
        (without(privacy=None), "privacy", "privacy is not stated"),
        (without(faces=None), "privacy", "contribution.faces is not stated"),
        (without(plates=None), "privacy", "contribution.plates is not stated"),
    ],
)
def test_every_gap_is_named(info: BridgeInfo, code: str, words: str) -> None:
    found = findings(info)

    assert {name for name, _ in found} == {f"contribution-{code}"}
    assert any(words in message for _, message in found), found


def test_a_rendered_bridge_without_a_rig_is_a_gap_and_an_imported_one_is_none() -> None:
    assert findings(WHOLE, rig=None) == [("contribution-rig", "the manifest has no rig")]
    assert findings(WHOLE, rig=None, origin="imported", recipe=None) == []


def test_nothing_said_at_all_gives_every_error() -> None:
    codes = {code for code, _ in findings(BridgeInfo("B1"))}

    assert codes == {
        code
        for code, (level, _) in CODES.items()
        if code.startswith("contribution-") and level == "error"
    }


def at_stamps(info: BridgeInfo, *stamps_ns: int) -> list[str]:
    from civil_rgbd.format.reader import read_bridge

    rows = read_bridge(make.HERE / "bridges" / "B1").rows
    rows = tuple(
        dataclasses.replace(row, stamp_ns=stamp)
        for row, stamp in zip(rows, stamps_ns, strict=False)
    )
    read = BridgeDocuments(manifest=dataclasses.replace(make.manifest(0.25), info=info), rows=rows)
    return [found.message for found in check_contribution(read, "B1")]


DAY_NS = 86_400 * 10**9
NOON_2023_11_14_NS = 1_699_963_200 * 10**9


@pytest.mark.parametrize(
    ("stamp_ns", "fits"),
    [
        (NOON_2023_11_14_NS, True),
        (NOON_2023_11_14_NS + DAY_NS, True),  # a time zone
        (NOON_2023_11_14_NS - DAY_NS, True),
        (NOON_2023_11_14_NS + 2 * DAY_NS, False),
        (5 * 10**9, True),  # a clock that counts from power-on says nothing
        (2**63 - 1, False),
    ],
)
def test_stamps_on_other_days_than_the_survey_are_odd(stamp_ns: int, *, fits: bool) -> None:
    assert (at_stamps(WHOLE, stamp_ns) == []) == fits


def test_a_month_covers_its_days() -> None:
    assert at_stamps(without(survey_dates=("2023-11",)), NOON_2023_11_14_NS) == []


@pytest.mark.parametrize("date", ["2024", "2024-02", "2024-02-29"])
def test_dates_of_the_calendar_pass(date: str) -> None:
    assert date_fault(date) is None


@pytest.mark.parametrize("date", ["2023-02-29", "2024-00", "24-01-01", "2024-1-1", "0000", ""])
def test_other_dates_do_not(date: str) -> None:
    assert date_fault(date)


def test_a_date_in_the_future_is_none_yet() -> None:
    today = dt.datetime.now(tz=dt.UTC).date()
    assert date_fault(str(today)) is None
    assert date_fault(str(today)[:4]) is None
    later = str(today + dt.timedelta(days=3))
    assert date_fault(later) == f"{later!r} lies in the future"
    assert date_fault(str(today.year + 1)) is not None


@pytest.mark.parametrize(
    "licence", ["LicenseRef-Mine", "CC-BY-ND-4.0", "(CC-BY-4.0)", "CC-BY-4.0 AND MIT", ""]
)
def test_a_licence_that_is_none_for_data_is_refused(licence: str) -> None:
    assert licence_fault(licence)


def test_the_check_is_of_the_manifest_only_where_there_is_one() -> None:
    assert list(check_contribution(BridgeDocuments(manifest=None), "B1")) == []
