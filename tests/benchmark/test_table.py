"""The table: means and deviations over seeds, gains paired by seed."""

from __future__ import annotations

import csv
import io
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from civil_rgbd.benchmark.cells import CellFailure, CellResult
from civil_rgbd.benchmark.table import Spread, table_rows
from civil_rgbd.benchmark.table_files import (
    in_words,
    rows_document,
    table_csv,
    table_latex,
    table_markdown,
)
from civil_rgbd.evaluation.metrics import METRICS
from civil_rgbd.lineage import Seen

COUNTS = {
    "images_skipped": 1,
    "pixels": 1000,
    "pixels_skipped": 7,
    "clamped_low": 2,
    "clamped_high": 3,
    "prediction_nan": 4,
    "prediction_infinite": 5,
}


def cell(model: str, seed: int, shots: int, abs_rel: float, **others: float | None) -> CellResult:
    def scores(value: float | None, frames: int = 41) -> dict[str, Any]:
        metrics: dict[str, float | None] = dict.fromkeys(METRICS, 0.5)
        return {
            "per_image": metrics | {"abs_rel": value},
            "pooled": metrics | {"abs_rel": value},
            "counts": COUNTS | {"images": frames},
        }

    tests = {
        "same": scores(abs_rel),
        "remainder": scores(others.get("remainder", abs_rel)),
        "apart": scores(others.get("apart", abs_rel), frames=9 + 4 * seed),
    }
    results = {
        "tests": tests,
        "split": {"sha256": f"{seed}{shots:02}" + "0" * 61},
        "software": {"civil_rgbd": "0.1.0"},
    }
    return CellResult(model, seed, shots, Path("x"), results)


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
    assert len(lines) == 2 + 3 + 2 + 1 + 3 + 4 + 1  # caption, counts, splits, software
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
    seen = [replace(one, seen=Seen(10, one.seed)) for one in CELLS if one.model == "bts"]
    text = table_markdown(table_rows([*seen, CELLS[-1]]), "B3")

    assert "| bts (trained with 10 frames of this bridge, 1 of them scored) | 0 |" in text
    assert "| zoe | 0 |" in text
    assert "has seen, but where its row says so;" in text
    assert "- SEEN: bts, or one that its first weights are of, was trained with 10 frames" in text
    assert "says so" not in table_markdown(table_rows(CELLS), "B3")
    assert "SEEN" not in table_markdown(table_rows(CELLS), "B3")


def test_weights_that_nobody_knows_anything_of_are_marked() -> None:
    seen = [replace(CELLS[-1], seen=Seen(unknown=("theirs.pt",)))]
    text = table_markdown(table_rows(seen), "B3")

    assert "| zoe (started from theirs.pt, and nobody knows what that was trained with) |" in text


def test_every_table_has_splits_seeds_software_and_counts() -> None:
    rows = table_rows(CELLS)
    split = "130" + "0" * 61

    for text in (table_markdown(rows, "B3"), table_latex(rows, "B3")):
        assert f"Split of seed 1, 30 shots: {split}" in text
        assert "over 2 seeds (0, 1)" in text
        assert "Software: civil" in text
        assert (
            "bts, 0 shots, same frames, seeds 0, 1: 80 images and 2000 pixels scored, 2 images "
            "skipped with 14 pixels; of the predictions 4 raised to the minimum, 6 lowered to the "
            "maximum, 8 NaN, 10 infinite."
        ) in text
    values = list(csv.DictReader(io.StringIO(table_csv(rows))))
    assert {one["software"] for one in values} == {"civil_rgbd 0.1.0"}
    of_one = [one for one in values if (one["seed"], one["shots"]) == ("1", "30")]
    assert {one["split_sha256"] for one in of_one} == {split}
    skipped = [one["value"] for one in values if one["metric"] == "prediction_nan"]
    assert skipped == ["4"] * 5 * 3
    assert rows_document(rows)[1]["split_sha256"]["1"] == split


FAILURE = CellFailure("bts", 1, 0, Path("y"), "the disk is full: 100 %", "y", "free some space")


def test_one_seed_is_called_one_run_and_not_a_mean() -> None:
    rows = table_rows([one for one in CELLS if one.seed == 0])

    for text in (table_markdown(rows, "B3"), table_latex(rows, "B3")):
        assert "One run of each model (seed 0: no mean, and no deviation to judge by) on" in text
        assert "it rests on: remainder below apart" in text
        assert "taken off by the shots, against the run without." in text
        assert "±" not in text
        assert "over 1 seed" not in text
    assert "least to most over seeds" in table_markdown(table_rows(CELLS), "B3")


def test_a_cell_that_failed_is_marked_with_its_cause_and_the_rest_stands() -> None:
    rows = table_rows([FAILURE, *CELLS[:3], CELLS[4]])
    text = table_markdown(rows, "B3")

    assert [row.model for row in rows] == ["bts", "bts", "zoe"]
    assert rows[0].seeds == (0,)
    assert rows[0].failed == {1: "the disk is full: 100 %"}
    assert rows[1].gain.values == {0: 0.5}  # seed 1 has no run without shots to compare with
    assert "| bts (FAILED: 1 of 2 seeds) | 0 | 0.400 |" in text
    assert "- FAILED: bts, 0 shots, seed 1 is not in the table: the disk is full: 100 %. " in text
    assert r"the disk is full: 100 \%" in table_latex(rows, "B3")
    assert "bts,0,,,failed,1,the disk is full: 100 %," in table_csv(rows)
    assert rows_document(rows)[0]["failed"] == {"1": "the disk is full: 100 %"}


def test_a_row_of_which_every_cell_failed_has_dashes() -> None:
    rows = table_rows([replace(FAILURE, model="bts", shots=20), CELLS[1]])
    text = table_markdown(rows, "B3")

    assert "| bts (FAILED: 1 of 1 seeds) | 20 | - | - | - | - | - | - | - | - (-) | - (-) |" in text
    assert "- bts, 20 shots: nothing was scored." in text
    assert rows_document(rows)[1]["frames"]["same"] is None
