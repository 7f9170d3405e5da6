"""What a contributor is asked, in order, and what each typed answer means."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from civil_rgbd.domain.vocabulary import COUNTRIES, DATA_LICENCES
from civil_rgbd.resources import load_schema, nearest
from civil_rgbd.validation.contribution import date_fault, licence_fault

Parse = Callable[[str], object]


@dataclass(frozen=True, slots=True)
class Question:
    """One question.

    Attributes:
        key: where the answer belongs in ``bridge.toml``, dotted.
        words: the question.
        needed: a contribution must answer it.
        parse: turns what was typed into a value; ValueError says in words why it does not do.
        choices: the closed list, where there is one.
    """

    key: str
    words: str
    needed: bool
    parse: Parse
    choices: tuple[str, ...] = ()


def _text(typed: str) -> str:
    return typed.strip()


def _country(typed: str) -> str:
    code = typed.strip().upper()
    if code not in COUNTRIES:
        raise ValueError(f"{typed!r} is no code of ISO 3166-1, such as CA; see iso.org/obp")
    return code


def _region(typed: str) -> str:
    code = typed.strip().upper()
    if not re.fullmatch(r"[A-Z]{2}-[A-Z0-9]{1,3}", code) or code[:2] not in COUNTRIES:
        raise ValueError(f"{typed!r} is no code of ISO 3166-2, such as CA-ON")
    return code


def _licence(typed: str) -> str:
    spelt = {known.lower(): known for known in DATA_LICENCES}
    licence = spelt.get(typed.strip().lower(), typed.strip())
    fault = licence_fault(licence)
    if fault:
        raise ValueError(fault)
    return licence


def _location(typed: str) -> dict[str, float]:
    numbers = [float(word) for word in re.split(r"[,;\s]+", typed.strip())]
    if len(numbers) != 3:
        raise ValueError("write three numbers: latitude, longitude, precision in metres")
    latitude_deg, longitude_deg, precision_m = numbers
    if not (abs(latitude_deg) <= 90 and abs(longitude_deg) <= 180 and 0 <= precision_m < 1e7):
        raise ValueError(f"{typed!r} lies on no globe: latitude first, north and east positive")
    return {
        "latitude_deg": latitude_deg,
        "longitude_deg": longitude_deg,
        "precision_m": precision_m,
    }


def _date(typed: str) -> str:
    fault = date_fault(typed.strip())
    if fault:
        raise ValueError(fault)
    return typed.strip()


def _dates(typed: str) -> list[str]:
    return [_date(word) for word in re.split(r"[,;\s]+", typed.strip())]


def _year(typed: str) -> int:
    if not re.fullmatch(r"[0-9]{1,4}", typed.strip()) or int(typed) == 0:
        raise ValueError(f"{typed!r} is no year, such as 1968")
    return int(typed)


def _length_m(typed: str) -> float:
    length_m = float(typed)
    if not 0 < length_m < 1e6:
        raise ValueError(f"{typed!r} is no length in metres")
    return length_m


def _schema_of(key: str) -> dict[str, Any]:
    schema = load_schema("bridge_info")
    for name in key.split("."):
        schema = schema["properties"][name]
    return schema


def _chosen(key: str, words: str, *, needed: bool = True) -> Question:
    choices = tuple(_schema_of(key)["enum"])

    def parse(typed: str) -> str:
        word = typed.strip().lower()
        if word not in choices:
            raise ValueError(f"{typed!r} is not in the list; {nearest(word, choices)}")
        return word

    return Question(key, words, needed, parse, choices)


def _asked(key: str, words: str, parse: Parse = _text, *, needed: bool = True) -> Question:
    return Question(key, words, needed, parse)


QUESTIONS: Final = (
    _asked("name", "The bridge's name", needed=False),
    _chosen("contribution.place_precision", "How precisely may the place be known"),
    _asked("place", "Where it stands, in words, as precisely as the owner allows"),
    _asked("country", "Country (ISO 3166-1, such as CA)", _country),
    _asked("region", "State or province (ISO 3166-2, such as CA-ON)", _region),
    _asked("location", "Latitude, longitude, precision in metres", _location, needed=False),
    _chosen("structure.type", "Kind of structure"),
    _chosen("structure.material", "Main material", needed=False),
    _asked("structure.year_built", "Year of completion", _year),
    _asked("structure.length_m", "Length along the road, metres", _length_m, needed=False),
    _asked("structure.note", "More about the structure; what 'other' is", needed=False),
    _asked("owner", "Who owns the structure"),
    _chosen("contribution.consent", "How the owner agreed to publish"),
    _asked("owner_consent", "The owner's agreement in words: who, when, to what"),
    _asked("licence", "Licence of the data (SPDX, such as CC-BY-4.0)", _licence),
    _asked("citation", "How to cite the data"),
    _asked("contact", "Whom to ask: e-mail address or web page"),
    _asked("survey_dates", "Days of the scan, such as 2024-06-01", _dates),
    _asked("sensors", "Sensors, in words: LiDAR, camera, IMU, how they were carried"),
    _chosen("contribution.calibration_method", "How the camera was calibrated to the LiDAR"),
    _asked("contribution.calibration_date", "Day of the calibration", _date),
    _asked("contribution.calibration_report", "What it gave: program, views, residuals; or a link"),
    _chosen("contribution.faces", "People's faces in the images"),
    _chosen("contribution.plates", "Number plates in the images"),
    _asked("privacy", "Faces and plates, in words: what was done, how it was checked"),
    _asked("note", "Anything else", needed=False),
)
"""Everything that the contribution profile demands, and a little more."""
