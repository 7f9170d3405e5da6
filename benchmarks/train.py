"""Do training and the few-shot protocol reach what they must, on five simulated bridges?

    python benchmarks/train.py data      # draws the bridges, once (some two minutes)
    python benchmarks/train.py unseen    # BTS small on a bridge it has not seen, some 3 minutes
    python benchmarks/train.py table     # four shot counts, 3 seeds, two runs at a time
    python benchmarks/train.py zoe       # tiny ZoeDepth, one seed, apart
    python benchmarks/train.py all --quick     # everything for a few steps: does it run?

Bridges of different sizes, 192 x 96 px, 160 sparse training frames of B1 to B4, 180 frames of B5,
which is left out. Wanted: AbsRel of *unseen* at most 0.65 times that of predicting each pixel's
median over the training frames; in the *table* 30 shots take off at least 25 % AbsRel, mean of 3
seeds, on the frames outside the 30-draw, in less than 40 minutes. What is done is kept in --folder,
and a command that is given again goes on.

Last measured, torch 2.13, one thread of a busy machine of two cores, seed 0, 600 steps:

    training median 0.272; BTS small, no shots 0.163 (ratio 0.60); 400 steps 0.171 (0.63)
    frames outside the 30-draw: no shots 0.163, 30 shots 0.113 (31 % less); apart 0.112
"""

from __future__ import annotations

import argparse
import os
import time
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from train_bridges import make_dataset

from civil_rgbd.baselines.model import load_model
from civil_rgbd.benchmark.cells import CellResult
from civil_rgbd.benchmark.protocol import REMAINDER, ShotRequest, draw_split
from civil_rgbd.benchmark.run import BenchmarkJob, BenchmarkOptions, run_benchmark
from civil_rgbd.benchmark.table_files import table_markdown
from civil_rgbd.domain.split import FramesOf, Split
from civil_rgbd.evaluation.frames import open_bridges, rows_of
from civil_rgbd.evaluation.run import evaluate
from civil_rgbd.geometry.camera import PinholeCamera
from civil_rgbd.resources import cache_folder
from civil_rgbd.training.recipe_files import load_training_recipe
from civil_rgbd.training.run import TrainingJob, TrainingOptions, train

TEST_BRIDGE = "B5"
QUICK = ("run.steps=4", "run.norm_batches=1", "model_options.features=32")
QUICK_ZOE = ("run.steps=2",)


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
    """Run the parts that are asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("part", choices=["data", "unseen", "table", "zoe", "all"])
    parser.add_argument("--folder", type=Path, default=cache_folder() / "train-benchmark")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--threads", type=int, default=os.cpu_count(), help="of unseen")
    parser.add_argument("--quick", action="store_true", help="a few steps: does it run?")
    parser.add_argument("--set", dest="settings", action="append", default=[])
    options = parser.parse_args()
    torch.set_num_threads(options.threads or 1)
    folder = options.folder / "quick" if options.quick else options.folder
    data = make_dataset(folder / "data", test_frames=40 if options.quick else None)
    settings = (*(QUICK if options.quick else ()), *options.settings)
    if options.part in {"unseen", "all"}:
        unseen(data, folder / "unseen", settings)
    if options.part in {"table", "all"}:
        table(data, folder / "table", settings, seeds=options.seeds, jobs=options.jobs)
    if options.part in {"zoe", "all"}:
        zoe(data, folder / "zoe", QUICK_ZOE if options.quick else ())


def unseen(data: Path, out: Path, settings: tuple[str, ...]) -> None:
    """Train on four bridges, score on the fifth, against the training median."""
    split = draw_split(open_bridges(data), ShotRequest(TEST_BRIDGE), where=data)
    test = Split(train={}, tests={REMAINDER: split.tests[REMAINDER]})
    floor = abs_rel(TrainingMedian(data, split.train), data, test)
    recipe = load_training_recipe("bts-small", settings)
    report = train(TrainingJob(data, split, recipe, out), TrainingOptions(tensorboard=False))
    ours = abs_rel(load_model(out), data, test)
    print(
        f"unseen: AbsRel {ours:.3f}; training median {floor:.3f}; ratio {ours / floor:.2f}, "
        f"wanted 0.65 or less; {report.steps} steps in {report.seconds:.0f} s"
    )


def abs_rel(model: object, data: Path, split: Split) -> float:
    """AbsRel on the remainder, mean over images."""
    scores = evaluate(model, data, split).scores(REMAINDER)  # type: ignore[arg-type]  # a model
    return scores.per_image["abs_rel"]


def table(data: Path, out: Path, settings: tuple[str, ...], *, seeds: int, jobs: int) -> None:
    """Make the table of BTS small."""
    started = time.monotonic()
    job = BenchmarkJob(data, TEST_BRIDGE, ("bts-small",), out, seeds=seeds, settings=settings)
    rows = run_benchmark(job, BenchmarkOptions(jobs=jobs, tensorboard=False, on_cell=say))
    minutes = (time.monotonic() - started) / 60
    print(table_markdown(rows, TEST_BRIDGE))
    gain = rows[-1].gain.mean
    print(
        f"table: {rows[-1].shots} shots take off {gain:.0%} AbsRel, wanted 25 % or more; "
        f"{minutes:.1f} minutes, wanted less than 40; page {out / 'index.html'}"
    )


def zoe(data: Path, out: Path, settings: tuple[str, ...]) -> None:
    """Make the table of tiny ZoeDepth, one seed."""
    started = time.monotonic()
    job = BenchmarkJob(
        data, TEST_BRIDGE, ("zoe-small",), out, shots=(0, 30), seeds=1, settings=settings
    )
    rows = run_benchmark(job, BenchmarkOptions(jobs=2, tensorboard=False, on_cell=say))
    print(table_markdown(rows, TEST_BRIDGE))
    print(f"zoe: {(time.monotonic() - started) / 60:.1f} minutes")


def say(result: CellResult, total: int) -> None:
    """Say that a cell is done."""
    print(f"  {result.model}, seed {result.seed}, {result.shots} shots: done ({total} in all)",
          flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
