"""The whole table: every model, seed and number of shots; finished cells are kept."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field, replace
from multiprocessing import get_context
from pathlib import Path
from typing import Final

from civil_rgbd.baselines.model import load_model
from civil_rgbd.benchmark.cells import (
    Cell,
    CellResult,
    is_trained,
    run_cell,
    seen_frames,
    split_of,
)
from civil_rgbd.benchmark.page import benchmark_page
from civil_rgbd.benchmark.protocol import DRAW, ShotRequest
from civil_rgbd.benchmark.table import (
    TableRow,
    rows_document,
    table_csv,
    table_latex,
    table_markdown,
    table_rows,
)
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
        on_cell: called with each result and the number of cells.
    """

    jobs: int = 1
    device: str = "auto"
    tensorboard: bool = True
    on_cell: Callable[[CellResult, int], object] = lambda _result, _total: None


def run_benchmark(job: BenchmarkJob, options: BenchmarkOptions | None = None) -> list[TableRow]:
    """Train and score every cell, write table and page, and return the rows of the table.

    Raises:
        UsageError: nothing is asked for, or the data does not have what it takes.
        CivilRgbdError: a cell cannot be trained or scored; the finished ones are kept.
    """
    options = options or BenchmarkOptions()
    cells = cells_of(job, options)
    _refuse_early(cells)
    with folder_lock(job.out):
        with writing(job.out):
            job.out.mkdir(parents=True, exist_ok=True)
        results = sorted(
            _run_all(cells, options),
            key=lambda one: [_cell_key(cell) for cell in cells].index(
                (one.model, one.seed, one.shots)
            ),
        )
        rows = table_rows(results)
        stem = job.out / TABLE
        write_text(stem.with_suffix(".md"), table_markdown(rows, job.test_bridge))
        write_text(stem.with_suffix(".csv"), table_csv(rows))
        write_text(stem.with_suffix(".tex"), table_latex(rows, job.test_bridge))
        write_text(job.out / PAGE, benchmark_page(cells, rows, job.test_bridge))
        write_text(job.out / RESULTS, document_text(_document(job, results, rows)))
    return rows


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
    _warn_of_leakage(cells)


def _warn_of_leakage(cells: Sequence[Cell]) -> None:
    """Say which runs of the user's own have seen the test bridge; the table says it as well."""
    for cell in {cell.model: cell for cell in cells}.values():
        trained, _ = seen_frames(cell, split_of(cell))
        if trained:
            warnings.warn(
                f"the run {cell.model} was trained with {trained} frames of the test bridge "
                f"{cell.request.test_bridge}: its row in the table says so",
                stacklevel=3,
            )


def _cell_key(cell: Cell) -> tuple[str, int, int]:
    return cell.name, cell.request.seed, cell.request.shots


def _run_all(cells: Sequence[Cell], options: BenchmarkOptions) -> Iterator[CellResult]:
    # What is not trained comes first: a missing prediction is found before hours of training.
    for result in _results(sorted(cells, key=lambda one: is_trained(one.model)), options.jobs):
        options.on_cell(result, len(cells))
        yield result


def _results(cells: Sequence[Cell], jobs: int) -> Iterator[CellResult]:
    if jobs == 1:
        yield from map(run_cell, cells)
        return
    # spawn: a process that was forked from one with threads of torch may wait for them for ever.
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        waiting = [pool.submit(run_cell, cell) for cell in cells]
        try:
            for done in as_completed(waiting):
                yield done.result()
        except BrokenProcessPool as error:
            raise TrainingError(
                "a process of the benchmark was killed, perhaps for want of memory",
                where=cells[0].out,
                fix="give the command again, with fewer --jobs: finished cells are kept, and the "
                "others go on from their checkpoints",
            ) from error
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


def _document(
    job: BenchmarkJob, results: Sequence[CellResult], rows: Sequence[TableRow]
) -> dict[str, object]:
    return {
        "civil_rgbd_benchmark": 1,
        "data": job.data.resolve().name,
        "test_bridge": job.test_bridge,
        "settings": list(job.settings),
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
                "test_frames_trained_with": one.seen[0],
                "test_frames_trained_with_and_scored": one.seen[1],
            }
            for one in results
        ],
    }
