"""What ``benchmarks/check.py`` measured, as a table in Markdown."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

CLEAN: Final = "clean"
_MARKS: Final = "<!-- table check -->", "<!-- end check -->"
_PLACE: Final = re.compile(f"(?<={_MARKS[0]}\n).*?(?={_MARKS[1]})", re.DOTALL)

Row = dict[str, Any]


def table(rows: Sequence[Row], codes: Sequence[str]) -> list[str]:
    """Say how many were found, and how far off the numbers are.

    Args:
        rows: results of variants.
        codes: of the faults in their order, and :data:`CLEAN`.
    """
    lines = ["| planted | variants | found | |", "|---|---|---|---|"]
    of_codes = [[row for row in rows if row["code"] == code] for code in codes if code != CLEAN]
    lines += [_line(of_code) for of_code in of_codes if of_code]
    clean = [row for row in rows if row["code"] == CLEAN]
    flagged = [row for row in clean if row["found"]]
    what = ", ".join(sorted({code for row in flagged for code in row["found"]}))
    lines += [f"| nothing | {len(clean)} | {len(flagged)} flagged | {what} |", ""]
    lines += [f"* {said}" for said in _numbers(rows)]
    return lines


def _line(rows: Sequence[Row]) -> str:
    code = rows[0]["code"]
    missed = [row for row in rows if code not in row["found"]]
    where = ", ".join(sorted({f"missed: {row['base']}" for row in missed}))
    return f"| `{code}` | {len(rows)} | {len(rows) - len(missed)} | {where} |"


def _numbers(rows: Sequence[Row]) -> list[str]:
    said = []
    for name, unit, off, asked in (
        ("Time offsets", "ms", _offset_errors(rows), _count(rows, "time-offset")),
        ("Turns of the camera", "deg", _turn_errors(rows), _count(rows, "extrinsics")),
    ):
        if off:
            said.append(
                f"{name}: {len(off)} of {asked} got a number; 90th percentile of the error "
                f"{np.quantile(off, 0.9):.2f} {unit}, largest {max(off):.2f} {unit}."
            )
    still = [row for row in rows if not row["turns"]]
    wrong = [row for row in still if row["offset"] or row["turn"]]
    said.append(
        f"Of {len(still)} recordings whose sensors do not turn, {len(wrong)} got a number for "
        "either."
    )
    share = [row["processor_s"] / row["seconds"] for row in rows if row["whole"]]
    if share:
        said.append(
            "Processor time of all checks over length of recording: median "
            f"{np.median(share):.3f}, 90th percentile {np.quantile(share, 0.9):.3f}, of two "
            "threads together."
        )
    return said


def _count(rows: Sequence[Row], code: str) -> int:
    return sum(row["code"] == code for row in rows)


def _offset_errors(rows: Sequence[Row]) -> list[float]:
    return [
        abs(float(row["offset"].split()[0]) - row["planted"]["offset_ms"])
        for row in rows
        if row["code"] == "time-offset" and row["offset"]
    ]


def _turn_errors(rows: Sequence[Row]) -> list[float]:
    errors = []
    for row in rows:
        if row["code"] == "extrinsics" and row["turn"]:
            words = row["turn"].replace(",", "").split()
            said = np.array([float(words[words.index(axis) + 1]) for axis in "xyz"])
            off = said - np.array(row["planted"]["turn_deg"])
            errors.append(float(np.sqrt((off**2).sum())))
    return errors


def into_page(lines: Sequence[str], page: Path) -> None:
    """Put the table between its marks."""
    text = page.read_text(encoding="utf-8")
    page.write_text(_PLACE.sub(lambda _: "\n".join(lines) + "\n", text), encoding="utf-8")
