"""Do training and the few-shot protocol reach what they must, on five simulated bridges?

    python benchmarks/train.py data      # draws the bridges, once (some two minutes)
    python benchmarks/train.py unseen    # BTS small on a bridge it has not seen, some 3 minutes
    python benchmarks/train.py table     # four shot counts, 3 seeds, two runs at a time
    python benchmarks/train.py zoe       # tiny ZoeDepth, one seed, apart
    python benchmarks/train.py speed     # evaluation of stored predictions (benchmarks/metrics.py)
    python benchmarks/train.py all       # all of it, some 45 minutes
    python benchmarks/train.py all --quick     # everything for a few steps: does it run?

Bridges of different sizes, 192 x 96 px, 160 sparse training frames of B1 to B4, 180 frames of B5,
which is left out. Wanted: AbsRel of *unseen* at most 0.65 times that of predicting each pixel's
median over the training frames; in the *table* 30 shots take off at least 25 % AbsRel, mean of 3
seeds, on the frames outside the 30-draw, in less than 40 minutes; 100 frames/s of evaluation. Each
figure is printed with PASS or MISS, and kept in figures.json and figures.csv of --folder with what
it was measured with. What is done is kept there, too, and a command that is given again goes on.

Last measured, torch 2.13, two cores, seeds 0, 1, 2, 600 steps:

    training median 0.272; BTS small, no shots 0.160 (ratio 0.59), trained in 98 s
    frames outside the 30-draw: no shots 0.158, 30 shots 0.114 (28 % less); the table in 20 minutes
    stored predictions: 107 frames/s (EXR), 103 (16-bit PNG)
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import torch
from figures import Figure, Figures
from numpy.typing import NDArray
from train_bridges import make_dataset

from civil_rgbd.baselines.model import load_model
from civil_rgbd.benchmark.cells import CellFailure, Outcome
from civil_rgbd.benchmark.protocol import REMAINDER, SAME, ShotRequest, draw_split
from civil_rgbd.benchmark.run import RESULTS, BenchmarkJob, BenchmarkOptions, run_benchmark
from civil_rgbd.benchmark.table import TableRow
from civil_rgbd.benchmark.table_files import table_markdown
from civil_rgbd.domain.split import FramesOf, Split
from civil_rgbd.evaluation.frames import open_bridges, rows_of
from civil_rgbd.evaluation.run import evaluate
from civil_rgbd.geometry.camera import PinholeCamera
from civil_rgbd.resources import cache_folder
from civil_rgbd.training.job import TrainingJob, TrainingOptions
from civil_rgbd.training.recipe_files import load_training_recipe
from civil_rgbd.training.run import train

TEST_BRIDGE = "B5"
QUICK = ("run.steps=4", "run.norm_batches=1", "model_options.features=32")
QUICK_ZOE = ("run.steps=2",)
UNSEEN_S = "unseen: seconds of training"


class TrainingMedian:
    """Answers each pixel's median over the training frames, whatever it is shown."""

    def __init__(self, data: Path, frames: FramesOf) -> None:
        bridges = open_bridges(data, frames)
        rows = rows_of(frames, bridges, where=data)
        depths = np.stack([bridges[name].read_depth(row) for name, row in rows])
        known = np.where(depths > 0, depths, np.nan)
        everywhere = np.nanmedian(known)
        seen = ~np.isnan(known).all(axis=0)
        self._median_m = np.full(seen.shape, everywhere, dtype=np.float32)
        self._median_m[seen] = np.nanmedian(known[:, seen], axis=0)

    def predict(self, rgb: NDArray[np.uint8], camera: PinholeCamera) -> NDArray[np.float32]:
        """Return the median: (H, W) float32 metres."""
        del rgb, camera
        return self._median_m


def main() -> None:
    """Run the parts that are asked for; exit code 1 says that a figure misses its target."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("part", choices=["data", "unseen", "table", "zoe", "speed", "all"])
    parser.add_argument("--folder", type=Path, default=cache_folder() / "train-benchmark")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--threads", type=int, default=os.cpu_count(), help="of unseen")
    parser.add_argument("--quick", action="store_true", help="a few steps: does it run?")
    parser.add_argument("--set", dest="settings", action="append", default=[])
    options = parser.parse_args()
    torch.set_num_threads(options.threads or 1)
    folder = options.folder / "quick" if options.quick else options.folder
    folder.mkdir(parents=True, exist_ok=True)
    data = make_dataset(folder / "data", test_frames=40 if options.quick else None)
    settings = (*(QUICK if options.quick else ()), *options.settings)
    figures = Figures(folder)
    if options.part in {"unseen", "all"}:
        unseen(data, folder / "unseen", settings, figures)
    if options.part in {"table", "all"}:
        table(data, folder / "table", settings, figures, seeds=options.seeds, jobs=options.jobs)
    if options.part in {"zoe", "all"}:
        zoe(data, folder / "zoe", QUICK_ZOE if options.quick else (), figures)
    if options.part in {"speed", "all"}:
        speed(folder, quick=options.quick)
    missed = Figures(folder).missed
    print(f"{folder / 'figures.json'}: {len(missed)} missed{': ' * bool(missed)}", end="")
    print("; ".join(missed))
    sys.exit(1 if missed else 0)


def unseen(data: Path, out: Path, settings: tuple[str, ...], figures: Figures) -> None:
    """Train on four bridges, score on the fifth, against the training median."""
    split = draw_split(open_bridges(data), ShotRequest(TEST_BRIDGE), where=data)
    test = Split(train={}, tests={REMAINDER: split.tests[REMAINDER]})
    floor = abs_rel(TrainingMedian(data, split.train), data, test)
    recipe = load_training_recipe("bts-small", settings)
    report = train(TrainingJob(data, split, recipe, out), TrainingOptions(tensorboard=False))
    ours = abs_rel(load_model(out), data, test)
    told = {
        "AbsRel": f"{ours:.3f}",
        "of the training median": f"{floor:.3f}",
        "frames trained": report.frames,
        "frames scored": len(test.tests[REMAINDER][TEST_BRIDGE]),
        "steps": report.steps,
        "seed": 0,
    }
    figures.add(Figure("unseen: AbsRel, share of the training median's", ours / floor, 0.65,
                       told=told))  # fmt: skip
    # A run that was found done, or gone on with, tells nothing of how long it takes.
    seconds = figures.value(UNSEEN_S) if report.steps_found else report.seconds
    told = {"threads": torch.get_num_threads(), "steps": report.steps}
    figures.add(Figure(UNSEEN_S, seconds, 180, told=told))


def abs_rel(model: object, data: Path, split: Split) -> float:
    """AbsRel on the remainder, mean over images."""
    scores = evaluate(model, data, split).scores(REMAINDER)  # type: ignore[arg-type]  # a model
    return scores.per_image["abs_rel"]


def table(
    data: Path,
    out: Path,
    settings: tuple[str, ...],
    figures: Figures,
    *,
    seeds: int,
    jobs: int,
) -> None:
    """Make the table of BTS small."""
    job = BenchmarkJob(data, TEST_BRIDGE, ("bts-small",), out, seeds=seeds, settings=settings)
    rows, minutes = run_timed(job, jobs)
    print(table_markdown(rows, TEST_BRIDGE))
    last = rows[-1]
    told: dict[str, object] = {
        "shots": last.shots,
        "by seed": {seed: round(gain, 3) for seed, gain in last.gain.values.items()},
        "frames scored": last.frames[SAME],
        "failed": {row.shots: dict(row.failed) for row in rows if row.failed},
    }
    gain = last.gain.mean if last.gain.values and not told["failed"] else None
    figures.add(Figure("table: AbsRel that 30 shots take off", gain, 0.25, at_most=False,
                       told=told))  # fmt: skip
    least = min(last.frames[SAME].values(), default=0)
    figures.add(Figure("table: frames of the unseen bridge that are scored", least, 150,
                       at_most=False, told={"least of": f"{seeds} seeds"}))  # fmt: skip
    shots = [row.shots for row in rows]
    told = {"shots": shots, "seeds": seeds, "at a time": jobs, "page": out / "index.html"}
    figures.add(Figure("table: minutes", minutes, 40, told=told))


def zoe(data: Path, out: Path, settings: tuple[str, ...], figures: Figures) -> None:
    """Make the table of tiny ZoeDepth, one seed."""
    job = BenchmarkJob(
        data, TEST_BRIDGE, ("zoe-small",), out, shots=(0, 30), seeds=1, settings=settings
    )
    rows, minutes = run_timed(job, 2)
    print(table_markdown(rows, TEST_BRIDGE))
    for row in rows:
        own = row.scores[SAME]["per_image"]["abs_rel"].mean
        told = {"seed": 0, "frames scored": row.frames[SAME], "failed": dict(row.failed)}
        figures.add(Figure(f"tiny ZoeDepth, {row.shots} shots: AbsRel",
                           None if row.failed else own, told=told))  # fmt: skip
    figures.add(Figure("tiny ZoeDepth: minutes", minutes, told={"cells": 2, "at a time": 2}))


def speed(folder: Path, *, quick: bool) -> None:
    """Measure evaluation of stored predictions, in a process that keeps to one core."""
    script = str(Path(__file__).with_name("metrics.py"))
    fewer = ["--frames", "6", "--rounds", "2"] if quick else []
    subprocess.run([sys.executable, script, "--folder", str(folder), *fewer], check=False)


def run_timed(job: BenchmarkJob, jobs: int) -> tuple[list[TableRow], float]:
    """Run a benchmark; return its rows, and the minutes of all commands that made its cells."""
    clock = job.out.with_suffix(".seconds")
    before = float(clock.read_text("utf-8")) if clock.exists() else 0.0
    whole, started = (job.out / RESULTS).exists(), time.monotonic()

    def say(cell: Outcome, total: int) -> None:
        verb = "failed" if isinstance(cell, CellFailure) else "done"
        print(f"  {cell.model}, seed {cell.seed}, {cell.shots} shots: {verb} ({total} in all)",
              flush=True)  # fmt: skip
        if not whole:  # a table that is there takes no time to make again
            clock.write_text(str(before + time.monotonic() - started), encoding="utf-8")

    rows = run_benchmark(job, BenchmarkOptions(jobs=jobs, tensorboard=False, on_cell=say))
    if not whole:
        clock.write_text(str(before + time.monotonic() - started), encoding="utf-8")
    return rows, float(clock.read_text("utf-8")) / 60


if __name__ == "__main__":
    main()
