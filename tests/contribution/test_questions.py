"""What is asked covers what is demanded, and typed answers are understood or refused."""

from __future__ import annotations

import pytest

from civil_rgbd.contribution.answers import info_of
from civil_rgbd.contribution.questions import QUESTIONS
from civil_rgbd.domain.bridge import BridgeInfo
from civil_rgbd.validation.contribution import check_contribution
from civil_rgbd.validation.documents import BridgeDocuments

from ..data.format_v1 import make
from .conftest import ANSWERS

BY_KEY = {question.key: question for question in QUESTIONS}


def codes(info: BridgeInfo) -> set[str]:
    import dataclasses

    manifest = dataclasses.replace(make.manifest(0.25), info=info)
    return {found.code for found in check_contribution(BridgeDocuments(manifest=manifest), "B1")}


@pytest.mark.parametrize("key", [question.key for question in QUESTIONS if question.needed])
def test_a_needed_answer_that_is_missing_is_a_gap(key: str) -> None:
    answers = {name: value for name, value in ANSWERS.items() if name != key}

    assert codes(info_of(answers, "B1"))


@pytest.mark.parametrize("key", [question.key for question in QUESTIONS if not question.needed])
def test_an_answer_that_may_be_left_out_is_none(key: str) -> None:
    answers = {name: value for name, value in ANSWERS.items() if name != key}

    assert codes(info_of(answers, "B1")) == set()


def test_each_key_is_asked_once() -> None:
    assert len(BY_KEY) == len(QUESTIONS)


@pytest.mark.parametrize(
    ("key", "typed", "value"),
    [
        ("country", " ca ", "CA"),
        ("region", "ca-on", "CA-ON"),
        ("licence", "cc0-1.0", "CC0-1.0"),
        ("structure.type", "Box girder", "box girder"),
        ("structure.year_built", "1968", 1968),
        ("structure.length_m", "65.5", 65.5),
        ("survey_dates", "2024-06-01, 2024-06-02", ["2024-06-01", "2024-06-02"]),
        (
            "location",
            "43.5, -80.5, 5000",
            {"latitude_deg": 43.5, "longitude_deg": -80.5, "precision_m": 5000.0},
        ),
        ("contribution.faces", "none visible", "none visible"),
    ],
)
def test_what_is_typed_is_understood(key: str, typed: str, value: object) -> None:
    assert BY_KEY[key].parse(typed) == value


@pytest.mark.parametrize(
    ("key", "typed", "words"),
    [
        ("country", "Canada", "no code of ISO 3166-1"),
        ("region", "Ontario", "no code of ISO 3166-2"),
        ("licence", "public domain", "expression of several|no SPDX id"),
        ("structure.type", "gider", "did you mean 'girder'"),
        ("structure.year_built", "about 1968", "is no year"),
        ("structure.length_m", "-3", "is no length"),
        ("structure.length_m", "nan", "is no length"),
        ("survey_dates", "yesterday", "is no date"),
        ("location", "43.5, -80.5", "three numbers"),
        ("location", "143.5, -80.5, 10", "on no globe"),
        ("location", "nan 0 0", "on no globe"),
        ("contribution.consent", "yes", "not in the list"),
    ],
)
def test_what_is_no_answer_is_refused(key: str, typed: str, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        BY_KEY[key].parse(typed)
