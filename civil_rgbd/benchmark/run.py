"""The whole table: every model, seed and number of shots; finished cells are kept."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Final

from civil_rgbd.baselines.model import load_model
from civil_rgbd.benchmark.cells import (
    Cell,
    CellFailure,
    CellResult,
    Outcome,
    is_trained,
    refuse_other_cell,
    seen_frames,
    split_of,
)
from civil_rgbd.benchmark.page import benchmark_page
from civil_rgbd.benchmark.protocol import DRAW, ShotRequest
from civil_rgbd.benchmark.table import TableRow, table_rows
from civil_rgbd.benchmark.table_files import (
    rows_document,
    table_csv,
    table_latex,
    table_markdown,
)
from civil_rgbd.benchmark.workers import run_cells
from civil_rgbd.errors import TrainingError, UsageError
from civil_rgbd.evaluation.metrics import MetricRules
from civil_rgbd.format.atomic import folder_lock, writing
from civil_rgbd.format.documents import document_text, write_text
from civil_rgbd.training.recipe_files import load_training_recipe

TABLE: Final = "table2"
"""Stem of the table's files."""

PAGE: Final = "index.html"
"""The page with pictures."""

RESULTS: Final = "benchmark.json"
"""All results; written last."""


@dataclass(frozen=True, slots=True)
class BenchmarkJob:
    """What to compare.

    Attributes:
        data: a dataset folder.
        test_bridge: id of the bridge that is left out of training.
        models: training recipes, or anything that ``load_model`` takes: that is scored as it is.
        out: the benchmark's folder.
        shots: numbers of frames of the test bridge that train.
        seeds: how many, from 0.
        draw: frames of a seed that may be shots; None for 30, at least the most shots.
        settings: changes of every recipe.
        rules: which pixels count.
        flip: average predictions over flips.
    """

    data: Path
    test_bridge: str
    models: tuple[str, ...]
    out: Path
    shots: tuple[int, ...] = (0, 10, 20, 30)
    seeds: int = 3
    draw: int | None = None
    settings: tuple[str, ...] = ()
    rules: MetricRules = field(default_factory=MetricRules)
    flip: bool = False


@dataclass(frozen=True, slots=True)
class BenchmarkOptions:
    """How to run; on one kind of device nothing here changes a number.

    Attributes:
        jobs: cells that run at a time, each in a process of its own.
        device: to train and to score on.
        tensorboard: write for TensorBoard.
        on_cell: called with what came out of each cell, and the number of cells.
    """

    jobs: int = 1
    device: str = "auto"
    tensorboard: bool = True
    on_cell: Callable[[Outcome, int], object] = lambda _result, _total: None


def run_benchmark(job: BenchmarkJob, options: BenchmarkOptions | None = None) -> list[TableRow]:
    """Train and score every cell, write table and page, and return the rows of the table.

    A cell that fails stops no other: its row says so (:attr:`TableRow.failed`), and when the same
    is asked for again, it alone is taken up.

    Raises:
        UsageError: nothing is asked for, or the data does not have what it takes.
        TrainingError: another run lies in the folder, or no cell at all could be finished.
        OutputError: a file cannot be written.
    """
    options = options or BenchmarkOptions()
    cells = cells_of(job, options)
    _refuse_early(cells)
    with folder_lock(job.out):
        with writing(job.out):
            job.out.mkdir(parents=True, exist_ok=True)
        outcomes = _run_all(cells, options)
        results = [one for one in outcomes if isinstance(one, CellResult)]
        failures = [one for one in outcomes if isinstance(one, CellFailure)]
        if not results:
            _refuse_no_table(failures)
        rows = table_rows(outcomes)
        stem, folders = job.out / TABLE, {one.folder for one in results}
        done = [cell for cell in cells if cell.folder in folders]
        write_text(stem.with_suffix(".md"), table_markdown(rows, job.test_bridge))
        write_text(stem.with_suffix(".csv"), table_csv(rows))
        write_text(stem.with_suffix(".tex"), table_latex(rows, job.test_bridge))
        write_text(job.out / PAGE, benchmark_page(done, rows, job.test_bridge))
        write_text(job.out / RESULTS, document_text(_document(job, results, failures, rows)))
    return rows


def _refuse_no_table(failures: Sequence[CellFailure]) -> None:
    first = failures[0]
    others = f"; so did {len(failures) - 1} others" if len(failures) > 1 else ""
    raise TrainingError(
        f"there is nothing to tabulate: {first.model}, seed {first.seed}, {first.shots} shots "
        f"failed{others}: {first.what}",
        where=first.where,
        fix=first.fix,
    )


def cells_of(job: BenchmarkJob, options: BenchmarkOptions) -> list[Cell]:
    """List the cells, seed by seed: what is interrupted has whole seeds first.

    A model that is not trained knows nothing of shots: it has one cell a seed.

    Raises:
        UsageError: nothing is asked for.
    """
    if not (job.models and job.shots and job.seeds > 0 and options.jobs > 0):
        raise UsageError(
            f"{len(job.models)} models, {len(job.shots)} numbers of shots, {job.seeds} seeds and "
            f"{options.jobs} jobs make no table",
            where="benchmark",
            fix="give at least one of each",
        )
    shots = sorted(set(job.shots))
    draw = max(DRAW, *shots) if job.draw is None else job.draw
    threads = max(1, (os.cpu_count() or 1) // options.jobs) if options.jobs > 1 else 0
    return [
        Cell(
            data=job.data,
            out=job.out,
            model=model,
            request=ShotRequest(job.test_bridge, count, seed, draw),
            settings=job.settings if is_trained(model) else (),
            device=options.device,
            threads=threads,
            rules=job.rules,
            flip=job.flip,
            tensorboard=options.tensorboard,
        )
        for seed in range(job.seeds)
        for model in dict.fromkeys(job.models)
        for count in (shots if is_trained(model) else [0])
    ]


def _refuse_early(cells: Sequence[Cell]) -> None:
    """Find what cannot work before hours of training: names, splits, recipes, models."""
    models = {cell.folder.parents[1]: cell.model for cell in cells}
    for cell in cells:
        other = models[cell.folder.parents[1]]
        if other != cell.model:
            raise UsageError(
                f"{cell.model!r} and {other!r} would have one name in the table, {cell.name!r}",
                where="--models",
                fix="give one of the files another name",
            )
    for request in {cell.request for cell in cells}:
        split_of(replace(cells[0], request=request))
    for model in {cell.model: cell for cell in cells}.values():
        if is_trained(model.model):
            load_training_recipe(model.model, model.settings)
        else:
            load_model(model.model)
    for cell in cells:
        refuse_other_cell(cell)
    _warn_of_leakage(cells)


def _warn_of_leakage(cells: Sequence[Cell]) -> None:
    """Say which runs of the user's own have seen the test bridge; the table says it as well."""
    for cell in {cell.model: cell for cell in cells}.values():
        seen = seen_frames(cell, split_of(cell)).in_words(
            f"the test bridge {cell.request.test_bridge}"
        )
        if seen:
            warnings.warn(
                f"the run {cell.model}, or one that its first weights are of, was {seen}: its row "
                "in the table says so",
                stacklevel=3,
            )


def _run_all(cells: Sequence[Cell], options: BenchmarkOptions) -> list[Outcome]:
    """Run all cells; return what came out in their order."""
    found: dict[Path, Outcome] = {}
    # What is not trained comes first: a missing prediction is said before hours of training.
    for outcome in run_cells(sorted(cells, key=lambda one: is_trained(one.model)), options.jobs):
        options.on_cell(outcome, len(cells))
        found[outcome.folder] = outcome
    return [found[cell.folder] for cell in cells]


def _document(
    job: BenchmarkJob,
    results: Sequence[CellResult],
    failures: Sequence[CellFailure],
    rows: Sequence[TableRow],
) -> dict[str, object]:
    return {
        "civil_rgbd_benchmark": 1,
        "data": job.data.resolve().name,
        "test_bridge": job.test_bridge,
        "settings": list(job.settings),
        "software": results[0].results["software"],
        "rows": rows_document(rows),
        "cells": [
            {
                "model": one.model,
                "seed": one.seed,
                "shots": one.shots,
                "folder": one.folder.relative_to(job.out).as_posix(),
                "split_sha256": one.results["split"]["sha256"],
                "data_sha256": one.results["data_sha256"],
                "model_sha256": one.results["model_sha256"],
                "run": one.results["run"],
                "seen": one.seen.to_document(),
            }
            for one in results
        ],
        "failed": [
            asdict(one) | {"folder": one.folder.relative_to(job.out).as_posix()} for one in failures
        ],
    }
