"""A whole benchmark, tiny: cells are kept, models of others stand beside, the page shows all."""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from civil_rgbd.benchmark.cells import CellResult
from civil_rgbd.benchmark.run import BenchmarkJob, BenchmarkOptions, cells_of, run_benchmark
from civil_rgbd.benchmark.table import TableRow
from civil_rgbd.errors import RecipeError, TrainingError, UsageError
from civil_rgbd.evaluation.metrics import MetricRules
from civil_rgbd.format.depth_exr import write_depth
from civil_rgbd.format.reader import read_bridge
from civil_rgbd.format.split_files import read_split

from ..training.conftest import TINY, write_learnable

MODEL_OF_ONES_OWN = """
import numpy as np

class TenMetres:
    def predict(self, rgb, camera):
        return np.full(rgb.shape[:2], 10.0, dtype=np.float32)
"""

QUIET = BenchmarkOptions(tensorboard=False, device="cpu")


@pytest.fixture(scope="module")
def job(tmp_path_factory: pytest.TempPathFactory) -> BenchmarkJob:
    """Two seeds of 0 and 2 shots of BTS, and a model of one's own; it has run once."""
    folder = tmp_path_factory.mktemp("benchmark")
    own = folder / "own.py"
    own.write_text(MODEL_OF_ONES_OWN, "utf-8")
    job = BenchmarkJob(
        data=write_learnable(folder / "data", frames=5),
        test_bridge="B3",
        models=("bts-small", f"{own}:TenMetres"),
        out=folder / "table",
        shots=(2, 0),
        seeds=2,
        draw=2,
        settings=(*TINY, "run.steps=2", "run.norm_batches=1"),
    )
    run_benchmark(job, QUIET)
    return job


def test_every_file_of_the_table_is_there(job: BenchmarkJob) -> None:
    names = {path.name for path in job.out.iterdir()}

    assert names == {
        "benchmark.json",
        "cells",
        "index.html",
        "table2.csv",
        "table2.md",
        "table2.tex",
    }


def test_a_model_that_is_not_trained_has_one_cell_a_seed(job: BenchmarkJob) -> None:
    cells = [(cell.name.rpartition(":")[2], *_numbers(cell)) for cell in cells_of(job, QUIET)]

    assert cells == [
        ("bts-small", 0, 0),
        ("bts-small", 0, 2),
        ("TenMetres", 0, 0),
        ("bts-small", 1, 0),
        ("bts-small", 1, 2),
        ("TenMetres", 1, 0),
    ]
    rows = json.loads((job.out / "benchmark.json").read_text("utf-8"))["rows"]
    assert [(row["model"].rpartition(":")[2], row["shots"]) for row in rows] == [
        ("bts-small", 0),
        ("bts-small", 2),
        ("TenMetres", 0),
    ]


def _numbers(cell: object) -> tuple[int, int]:
    request = cell.request  # type: ignore[attr-defined]  # a Cell
    return request.seed, request.shots


def test_cells_of_a_seed_are_scored_on_the_same_frames(job: BenchmarkJob) -> None:
    folder = job.out / "cells" / "bts-small" / "seed-0"
    none, two = (read_split(folder / f"shots-{shots}" / "split.json") for shots in (0, 2))

    assert none.tests["same"] == two.tests["same"]
    assert "B3" not in none.train
    assert len(two.train["B3"]) == 2
    document = json.loads((folder / "shots-2" / "results.json").read_text("utf-8"))
    assert document["split"]["sha256"] == two.sha256()


def test_finished_cells_are_kept_and_missing_ones_made(job: BenchmarkJob) -> None:
    cells = job.out / "cells" / "bts-small" / "seed-0"
    before = {path: path.stat().st_mtime_ns for path in job.out.rglob("model.pt")}
    table = (job.out / "table2.md").read_bytes()
    (cells / "shots-2" / "results.json").unlink()
    seen: list[CellResult] = []
    run_benchmark(job, replace(QUIET, on_cell=lambda cell, _total: seen.append(cell)))

    assert {path: path.stat().st_mtime_ns for path in before} == before
    assert (job.out / "table2.md").read_bytes() == table
    assert len(seen) == 6
    assert (cells / "shots-2" / "results.json").is_file()


def test_other_rules_score_anew_and_train_nothing(job: BenchmarkJob, tmp_path: Path) -> None:
    del tmp_path
    before = {path: path.stat().st_mtime_ns for path in job.out.rglob("model.pt")}
    rows = run_benchmark(replace(job, rules=MetricRules(max_depth_m=9.0)), QUIET)

    assert {path: path.stat().st_mtime_ns for path in before} == before
    near = rows[-1].scores["same"]["per_image"]["abs_rel"].mean
    rows = run_benchmark(job, QUIET)
    assert rows[-1].scores["same"]["per_image"]["abs_rel"].mean != near


def test_other_data_and_another_model_are_scored_anew(job: BenchmarkJob, tmp_path: Path) -> None:
    data, own = tmp_path / "data", tmp_path / "own.py"
    shutil.copytree(job.data, data)
    own.write_text(MODEL_OF_ONES_OWN, "utf-8")
    run = job.out / "cells" / "bts-small" / "seed-0" / "shots-0"
    models = (f"{own}:TenMetres", str(run))
    changed = replace(job, data=data, models=models, out=tmp_path / "table", seeds=1)
    first = [_abs_rel(row) for row in run_benchmark(changed, QUIET)]
    kept = _written(changed.out)
    own.write_text(MODEL_OF_ONES_OWN.replace("10.0", "3.0"), "utf-8")
    second = [_abs_rel(row) for row in run_benchmark(changed, QUIET)]

    assert second[0] != first[0]
    assert second[1] == first[1]
    unchanged = {name for name, stamp in _written(changed.out).items() if kept[name] == stamp}
    assert unchanged == {"0"}  # of the run, whose folder is shots-0

    bridge = read_bridge(data / "bridges" / "B3")
    for row in bridge.rows:
        write_depth(data / "bridges" / "B3" / row.depth_path, bridge.read_depth(row) * 2)
    third = [_abs_rel(row) for row in run_benchmark(changed, QUIET)]
    assert third[0] != second[0]
    assert third[1] != second[1]


def _abs_rel(row: TableRow) -> float:
    return row.scores["same"]["per_image"]["abs_rel"].mean


def _written(out: Path) -> dict[str, int]:
    """When each model's results were written, by the last part of the model's name."""
    paths = out.rglob("results.json")
    return {path.parents[2].name.rpartition("-")[2]: path.stat().st_mtime_ns for path in paths}


def test_a_run_that_has_seen_the_test_bridge_is_told_from_others(
    job: BenchmarkJob, tmp_path: Path
) -> None:
    run = job.out / "cells" / "bts-small" / "seed-0" / "shots-2" / "model.pt"
    wanted = replace(job, models=(str(run),), out=tmp_path / "table", seeds=1, draw=1, shots=(0,))
    with pytest.warns(UserWarning, match="was trained with 2 frames of the test bridge B3"):
        run_benchmark(wanted, QUIET)

    table = (wanted.out / "table2.md").read_text("utf-8")
    assert "(trained with 2 frames of this bridge, 2 of them scored) | 0 |" in table
    assert "but where its row says so" in table
    document = json.loads((wanted.out / "benchmark.json").read_text("utf-8"))
    assert document["rows"][0]["seen"] == {"trained": 2, "scored": 2, "unknown": []}
    assert document["cells"][0]["seen"]["scored"] == 2
    results = json.loads(next(wanted.out.rglob("results.json")).read_text("utf-8"))
    assert results["seen"] == {"trained": 2, "scored": 2, "unknown": []}
    assert "SEEN: " in (wanted.out / "index.html").read_text("utf-8")


def test_the_page_shows_table_curves_and_predictions_and_asks_nobody(job: BenchmarkJob) -> None:
    page = (job.out / "index.html").read_text("utf-8")

    results = json.loads(
        (job.out / "cells/bts-small/seed-1/shots-2/results.json").read_text("utf-8")
    )
    apart = results["tests"]["apart"]["counts"]["images"]
    assert page.count("<svg") == 2
    assert page.count('class="row"') == 3 + 2 * 3  # image, words, truth; depth, error of 3 cells
    assert page.count("data:image/png;base64,") == 1 + 3 * (2 + 2 * 3)
    assert "TenMetres, 0 shots: AbsRel" in page
    assert "Settings: model_options.features=16, " in page
    split = read_split(job.out / "cells/bts-small/seed-1/shots-2/split.json").sha256()
    assert f"<td>1</td><td>2</td><td>3</td><td>3</td><td>{apart}</td>" in page
    assert f"<td>{split[:12]}</td></tr>" in page
    assert not re.search(r'(src|href)="(?!data:|#)', page)


def test_a_cell_that_fails_stops_no_other_and_is_taken_up_alone(
    job: BenchmarkJob, tmp_path: Path
) -> None:
    stored = tmp_path / "none"
    (stored / "B3").mkdir(parents=True)
    models = ("bts-small", f"predictions:{stored}")
    wanted = replace(job, models=models, out=tmp_path / "table", seeds=1, shots=(0,))
    order: list[str] = []
    tell = replace(QUIET, on_cell=lambda cell, _total: order.append(cell.model))
    rows = run_benchmark(wanted, tell)

    assert order == [models[1], models[0]]  # what is missing is said before hours of training
    assert [row.seeds for row in rows] == [(0,), ()]
    assert "there is no prediction of frame" in rows[1].failed[0]
    for name in ("table2.md", "table2.tex", "index.html"):
        assert "there is no prediction of frame" in (wanted.out / name).read_text("utf-8")
    (failed,) = json.loads((wanted.out / "benchmark.json").read_text("utf-8"))["failed"]
    assert "store it as" in failed["fix"]

    bridge = read_bridge(job.data / "bridges" / "B3")
    for row in bridge.rows:
        write_depth(stored / "B3" / f"{row.frame_id}.exr", bridge.read_depth(row))
    before = _written(wanted.out)
    rows = run_benchmark(wanted, QUIET)
    assert not any(row.failed for row in rows)
    assert rows[1].seeds == (0,)
    assert _written(wanted.out).items() >= before.items()
    assert json.loads((wanted.out / "benchmark.json").read_text("utf-8"))["failed"] == []
    assert "FAILED" not in (wanted.out / "table2.md").read_text("utf-8")


def test_there_is_no_table_when_every_cell_fails(job: BenchmarkJob, tmp_path: Path) -> None:
    (tmp_path / "none").mkdir()
    models = (f"predictions:{tmp_path / 'none'}",)
    with pytest.raises(TrainingError, match="so did 1 others: there is no prediction of") as caught:
        run_benchmark(replace(job, models=models, out=tmp_path / "table"), QUIET)

    assert "store it as" in caught.value.fix
    assert not (tmp_path / "table" / "table2.md").exists()


@pytest.mark.slow
def test_a_process_that_is_killed_is_told_from_the_one_beside_it(
    job: BenchmarkJob, tmp_path: Path
) -> None:
    own = tmp_path / "own.py"
    killer = MODEL_OF_ONES_OWN.replace("TenMetres", "Killer").replace("return", "os._exit(9)\n#")
    own.write_text(f"import os\n{MODEL_OF_ONES_OWN}\n{killer}", "utf-8")
    models = (f"{own}:Killer", f"{own}:TenMetres")
    wanted = replace(job, models=models, out=tmp_path / "table", seeds=1)
    rows = run_benchmark(wanted, replace(QUIET, jobs=2))

    assert [sorted(row.failed) for row in rows] == [[0], []]
    assert "the process was killed" in rows[0].failed[0]


@pytest.mark.slow
def test_two_at_a_time_give_the_same_table(job: BenchmarkJob, tmp_path: Path) -> None:
    # One cell is left to do: that a worker process finds its way is what is asked.
    shutil.copytree(job.out, tmp_path / "table")
    shutil.rmtree(tmp_path / "table" / "cells" / "bts-small" / "seed-1" / "shots-2")
    run_benchmark(replace(job, out=tmp_path / "table"), replace(QUIET, jobs=2))

    assert (tmp_path / "table" / "table2.md").read_bytes() == (job.out / "table2.md").read_bytes()


def test_other_numbers_in_the_same_folder_are_refused(job: BenchmarkJob) -> None:
    other = replace(job, settings=(*job.settings, "run.batch=2"))
    with pytest.raises(TrainingError, match=r"another run lies here: run\.batch 4 -> 2") as caught:
        run_benchmark(other, QUIET)

    assert "delete this folder" in caught.value.fix  # `benchmark` has no --overwrite


@pytest.mark.parametrize(
    ("changes", "kind", "words"),
    [
        ({"test_bridge": "B4"}, UsageError, "there is no bridge 'B4'"),
        ({"shots": (0, 5), "draw": None}, UsageError, "has 5 frames; drawing 30 of them"),
        ({"models": ("bst-small",)}, UsageError, "there is no such model: 'bst-small'"),
        ({"models": ("bst.toml",)}, RecipeError, "the recipe file cannot be read"),
        ({"models": ("a/x.toml", "b/x.toml")}, UsageError, "would have one name in the table, 'x'"),
        ({"seeds": 0}, UsageError, "0 seeds and 1 jobs make no table"),
        ({"models": ()}, UsageError, "0 models"),
    ],
)
def test_what_cannot_be_is_refused_before_anything_is_trained(
    job: BenchmarkJob, tmp_path: Path, changes: dict[str, object], kind: type[Exception], words: str
) -> None:
    wanted = replace(job, out=tmp_path / "table", **changes)  # type: ignore[arg-type]  # by name
    with pytest.raises(kind, match=words):
        run_benchmark(wanted, QUIET)

    assert not (tmp_path / "table").exists()
