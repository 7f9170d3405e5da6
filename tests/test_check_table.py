"""The table of the benchmark of ``check`` counts what it is given."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "tutorials" / "check_a_recording.md"


@pytest.fixture
def report(monkeypatch: pytest.MonkeyPatch) -> Any:
    """The module that writes it."""
    monkeypatch.syspath_prepend(ROOT / "benchmarks")
    import check_table

    monkeypatch.delitem(sys.modules, "check_table")
    return check_table


def _row(code: str, found: list[str], **more: object) -> dict[str, object]:
    usual = {"base": "B1-0", "turns": True, "offset": None, "turn": None, "whole": True}
    return {"code": code, "found": found, **usual, "processor_s": 2.0, "seconds": 20.0, **more}


def test_missed_faults_and_flagged_recordings_are_counted_and_named(report: Any) -> None:
    rows = [
        _row("blurred", ["blurred"], whole=False, processor_s=0.5),
        _row("blurred", ["coverage"], base="B4-1"),
        _row("clean", []),
        _row("clean", ["pose-drift"], turns=False, turn="about ..."),
    ]

    lines = report.table(rows, ["clean", "blurred", "coverage"])

    assert lines[2:4] == [
        "| `blurred` | 2 | 1 | missed: B4-1 |",
        "| nothing | 2 | 1 flagged | pose-drift |",
    ]
    assert "* Of 1 recordings whose sensors do not turn, 1 got a number for either." in lines
    assert "median 0.100" in lines[-1]


def test_errors_are_what_was_said_less_what_was_planted(report: Any) -> None:
    late = {"offset": "+52.0 ms are to be added", "planted": {"offset_ms": 50.0}}
    turn = "about the camera's x +1.00, y -0.50, z +0.03 deg; 9 depth edges"
    turned = {"turn": turn, "planted": {"turn_deg": [1.0, -0.5, 0.0]}}
    rows = [
        _row("time-offset", ["time-offset"], **late),
        _row("time-offset", []),
        _row("extrinsics", ["extrinsics"], **turned),
    ]

    text = "\n".join(report.table(rows, ["time-offset", "extrinsics"]))

    assert "Time offsets: 1 of 2 got a number; 90th percentile of the error 2.00 ms" in text
    assert "Turns of the camera: 1 of 1 got a number; 90th percentile of the error 0.03 deg" in text


def test_the_table_goes_between_its_marks_and_nothing_else_changes(
    report: Any, tmp_path: Path
) -> None:
    page = tmp_path / "page.md"
    page.write_text(PAGE.read_text(encoding="utf-8"), encoding="utf-8")

    report.into_page(["| new |"], page)
    report.into_page(["| new |"], page)

    text, before = page.read_text(encoding="utf-8"), PAGE.read_text(encoding="utf-8")
    assert "<!-- table check -->\n| new |\n<!-- end check -->" in text
    assert text.partition("<!-- table")[0] == before.partition("<!-- table")[0]
    assert text.partition("<!-- end check")[2] == before.partition("<!-- end check")[2]
