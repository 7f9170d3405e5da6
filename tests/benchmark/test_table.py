"""The table: means and deviations over seeds, gains paired by seed."""

from __future__ import annotations

import csv
import io
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from civil_rgbd.benchmark.cells import CellResult
from civil_rgbd.benchmark.table import (
    Spread,
    in_words,
    rows_document,
    table_csv,
    table_latex,
    table_markdown,
    table_rows,
)
from civil_rgbd.evaluation.metrics import METRICS


def cell(model: str, seed: int, shots: int, abs_rel: float, **others: float | None) -> CellResult:
    def scores(value: float | None, frames: int = 41) -> dict[str, Any]:
        metrics: dict[str, float | None] = dict.fromkeys(METRICS, 0.5)
        return {
            "per_image": metrics | {"abs_rel": value},
            "pooled": metrics | {"abs_rel": value},
            "counts": {"images": frames, "images_skipped": 1},
        }

    tests = {
        "same": scores(abs_rel),
        "remainder": scores(others.get("remainder", abs_rel)),
        "apart": scores(others.get("apart", abs_rel), frames=9 + 4 * seed),
    }
    return CellResult(model, seed, shots, Path("x"), {"tests": tests})


CELLS = [
    cell("bts", 1, 30, 0.30, remainder=0.25, apart=None),
    cell("bts", 0, 0, 0.40),
    cell("bts", 0, 30, 0.20, remainder=0.15, apart=0.35),
    cell("bts", 1, 0, 0.50),
    cell("zoe", 0, 0, 0.30),
]


def test_models_keep_their_order_and_shots_ascend() -> None:
    rows = table_rows(CELLS)

    assert [(row.model, row.shots, row.seeds) for row in rows] == [
        ("bts", 0, (0, 1)),
        ("bts", 30, (0, 1)),
        ("zoe", 0, (0,)),
    ]


def test_mean_and_deviation_are_over_seeds() -> None:
    one = table_rows(CELLS)[0].scores["same"]["per_image"]["abs_rel"]

    assert one.mean == pytest.approx(0.45)
    assert one.deviation == pytest.approx(math.sqrt(0.005))


def test_gains_are_each_seeds_own() -> None:
    rows = table_rows(CELLS)

    assert rows[1].gain.values == pytest.approx({0: 0.5, 1: 0.4})
    assert rows[1].gain.mean == pytest.approx(0.45)  # not 1 - 0.25 / 0.45
    assert rows[0].gain.values == {}


def test_a_seed_without_a_score_is_left_out_of_the_mean() -> None:
    apart = table_rows(CELLS)[1].scores["apart"]["per_image"]["abs_rel"]

    assert apart.values == {0: 0.35}
    assert math.isnan(apart.deviation)


def test_markdown_has_a_line_a_row_and_says_how_it_was_scored() -> None:
    text = table_markdown(table_rows(CELLS), "B3")
    lines = text.splitlines()

    assert lines[0].startswith("| Model | shots | AbsRel | RMSE | Log10 | δ1 | δ2 | δ3 | gain |")
    assert lines[3].split(" | ")[2] == "0.250 ± 0.071"
    assert lines[3].split(" | ")[8:] == [
        "45.0 ± 7.1 %",
        "0.200 ± 0.071 (40)",
        "0.350 (8-12) |",
    ]
    assert len(lines) == 2 + 3 + 2
    assert "same 40 frames" in text
    assert "leakage by overlap" in text


def test_latex_is_escaped() -> None:
    text = table_latex(table_rows(CELLS), "B_3")

    assert r"45.0 $\pm$ 7.1 \%" in text
    assert r"bridge B\_3" in text
    assert text.count("&") == 10 * 4  # a head and three rows of eleven cells
    assert "δ" not in text


def test_csv_has_every_seed() -> None:
    values = list(csv.DictReader(io.StringIO(table_csv(table_rows(CELLS)))))
    found = [
        float(one["value"])
        for one in values
        if (one["model"], one["shots"], one["test"], one["averaging"], one["metric"])
        == ("bts", "30", "same", "per_image", "abs_rel")
    ]

    assert found == [0.20, 0.30]
    assert sum(one["metric"] == "abs_rel_gain" for one in values) == 2


def test_nothing_becomes_null_and_a_dash() -> None:
    assert in_words(Spread({})) == "-"
    assert rows_document(table_rows(CELLS))[0]["gain"] == {"mean": None, "deviation": None}


def test_a_run_that_has_seen_the_test_bridge_is_marked() -> None:
    seen = [replace(one, seen=(10, one.seed)) for one in CELLS if one.model == "bts"]
    text = table_markdown(table_rows([*seen, CELLS[-1]]), "B3")

    assert "| bts (trained with 10 frames of this bridge, 1 of them scored) | 0 |" in text
    assert "| zoe | 0 |" in text
    assert "has seen, but where its row says so;" in text
    assert "says so" not in table_markdown(table_rows(CELLS), "B3")
