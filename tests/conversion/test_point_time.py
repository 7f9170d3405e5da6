"""Which field is the time, and what the user may say about it."""

from __future__ import annotations

import pytest

from civil_rgbd.conversion.point_time import point_time_of
from civil_rgbd.errors import RecordingError, UsageError


@pytest.mark.parametrize(
    ("name", "code", "unit", "reference"),
    [
        ("t", "u4", "ns", "header"),
        ("offset_time", "u4", "ns", "header"),
        ("time", "f4", "s", "header"),
        ("timestamp", "f8", None, "epoch"),
    ],
)
def test_usual_names_and_types_need_no_option(
    name: str, code: str, unit: str | None, reference: str
) -> None:
    rule = point_time_of({"x": "f4", name: code}, None, where="")
    assert rule is not None
    assert (rule.field, rule.unit, rule.reference) == (name, unit, reference)


@pytest.mark.parametrize(
    ("name", "code"),
    [("time", "f8"), ("timestamp", "f4"), ("t", "f4"), ("time_stamp", "u4"), ("rel_time", "i4")],
)
def test_a_time_in_an_unknown_unit_asks(name: str, code: str) -> None:
    with pytest.raises(RecordingError, match=f"field '{name}' .* unknown unit") as caught:
        point_time_of({"x": "f4", name: code}, None, where="")
    assert f"--point-time {name}:UNIT:REFERENCE" in caught.value.fix


def test_no_time_field_is_no_rule() -> None:
    assert point_time_of({"x": "f4", "intensity": "f4", "line": "u1"}, None, where="") is None


def test_none_ignores_a_time_field() -> None:
    assert point_time_of({"time": "f8"}, "none", where="") is None


@pytest.mark.parametrize("option", ["t", "t:us", "t:hours:header", "t:us:sweep", "t:us:header:x"])
def test_an_option_that_is_no_rule_lists_the_units(option: str) -> None:
    with pytest.raises(UsageError, match="is not FIELD:UNIT:REFERENCE") as caught:
        point_time_of({"t": "u4"}, option, where="")
    assert "s, ms, us, ns" in caught.value.fix


def test_an_option_for_a_missing_field_names_the_nearest() -> None:
    with pytest.raises(UsageError, match="'stmp'") as caught:
        point_time_of({"stamp": "u4", "x": "f4"}, "stmp:us:header", where="")
    assert "did you mean 'stamp'" in caught.value.fix
