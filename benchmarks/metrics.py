"""How fast are stored predictions scored, and does another library get the same numbers?

    python benchmarks/metrics.py     # pip install "civil-rgbd[bench]": it has scikit-learn

Frames of 768x432 with 38 % truth, as a Livox Avia leaves them; predictions as 16-bit PNG, as EXR,
and in memory. One core; times are CPU seconds, best of several rounds. Wanted: 100 frames/s from
disk. torchmetrics and evaluate have none of these metrics; scikit-learn has AbsRel (by the name of
mean absolute percentage error) and RMSE, pooled over pixels, and log and variance for the others.
"""

from __future__ import annotations

import argparse
import math
import os
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from importlib.metadata import version
from pathlib import Path

import cv2
import numpy as np
from figures import Figure, Figures
from load import HEIGHT, WIDTH, make_bridge

from civil_rgbd.baselines.model import load_model
from civil_rgbd.domain.split import Split
from civil_rgbd.evaluation.frames import all_frames, open_bridges
from civil_rgbd.evaluation.metrics import METRICS, compute, update
from civil_rgbd.evaluation.run import evaluate
from civil_rgbd.evaluation.sums import measure_image
from civil_rgbd.format.depth_exr import write_depth

WANTED_PER_S = 100
WANTED_OFF = 1e-12
COMPARED = "metrics against another library, largest relative difference"


def main() -> None:
    """Print speeds, then both libraries' numbers."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--frames", type=int, default=64)
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--folder", type=Path, help="keep figures.json and figures.csv here")
    options = parser.parse_args()
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    cv2.setNumThreads(1)
    with tempfile.TemporaryDirectory() as scratch:
        figures = Figures(options.folder or Path(scratch))
        speeds(Path(scratch), options.frames, options.rounds, figures)
        compare(np.random.default_rng(0), figures)
        sys.exit(1 if figures.missed else 0)


def speeds(folder: Path, frames: int, rounds: int, figures: Figures) -> None:
    """Measure frames/s from memory and from disk."""
    bridge_folder = make_bridge(folder / "B1", frames)
    bridges = open_bridges(bridge_folder)
    split = Split(train={}, tests={"all": all_frames(bridges)})
    (bridge,) = bridges.values()
    rng = np.random.default_rng(0)
    for kind in ("png", "exr"):
        (folder / kind / "B1").mkdir(parents=True)
    for row in bridge.rows:
        truth = bridge.read_depth(row)
        guess = dense_prediction(truth, rng)
        write_depth(folder / "exr" / "B1" / f"{row.frame_id}.exr", guess, sync=False)
        millimetres = np.clip(guess * 256, 0, 65535).astype(np.uint16)
        cv2.imwrite(str(folder / "png" / "B1" / f"{row.frame_id}.png"), millimetres)
    measure_image(guess, truth)  # compiles
    alone_s = timed("metrics alone", 1, rounds * 8, lambda: measure_image(guess, truth))
    figures.add(Figure("metrics alone, frames/s", 1 / alone_s))
    for kind, settings in (("exr", {}), ("png", {"units_per_m": 256.0})):
        model = load_model(f"predictions:{folder / kind}", **settings)
        score = partial(evaluate, model, bridge_folder, split)
        seconds = timed(f"from disk, {kind}", frames, rounds, score)
        name = f"evaluation of stored {kind}, {WIDTH}x{HEIGHT}, frames/s of one core"
        told = {"frames": frames, "rounds": rounds, "seed": 0}
        figures.add(Figure(name, 1 / seconds, WANTED_PER_S, at_most=False, told=told))


def dense_prediction(truth: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Depth at every pixel, as a network gives it: smooth, some tenth off."""
    v, u = np.mgrid[0:HEIGHT, 0:WIDTH]
    smooth = 4 + 20 * v / HEIGHT + 2 * np.sin(u / 40)
    off = cv2.resize(rng.normal(1, 0.1, (27, 48)), (WIDTH, HEIGHT), interpolation=cv2.INTER_CUBIC)
    del truth
    return (np.maximum(smooth * off, 0.5)).astype(np.float32)


def timed(name: str, frames: int, rounds: int, work: Callable[[], object]) -> float:
    """Print and return the best of some rounds: CPU seconds a frame."""
    best = math.inf
    for _ in range(rounds):
        started = time.process_time()
        work()
        best = min(best, (time.process_time() - started) / frames)
    print(f"{name:22} {best * 1e3:6.2f} ms a frame, {1 / best:6.0f} frames/s")
    return best


def compare(rng: np.random.Generator, figures: Figures) -> None:
    """Compare our pooled numbers with scikit-learn's."""
    truth = np.where(rng.random((5, 96, 192)) < 0.4, rng.uniform(1, 60, (5, 96, 192)), 0)
    guess = np.where(truth > 0, truth, 5) * np.exp(rng.normal(0, 0.3, truth.shape))
    guess = np.clip(guess, 1e-3, 80)
    ours = compute(update((), guess, truth)).pooled
    try:
        from sklearn import metrics
    except ImportError:
        told = {"scikit-learn": 'is not installed: pip install "civil-rgbd[bench]"'}
        figures.add(Figure(COMPARED, None, WANTED_OFF, told=told))
        return
    g, p = truth[truth > 0], guess[truth > 0]
    logs = np.log(g), np.log(p)
    mse = metrics.mean_squared_error
    theirs = {
        "abs_rel": metrics.mean_absolute_percentage_error(g, p),
        "sq_rel": mse(g, p, sample_weight=1 / g) * np.mean(1 / g),
        "rmse": math.sqrt(mse(g, p)),
        "rmse_log": math.sqrt(mse(*logs)),
        "log10": metrics.mean_absolute_error(np.log10(g), np.log10(p)),
        "silog": 100 * math.sqrt(mse(*logs) - np.mean(logs[1] - logs[0]) ** 2),
        **{
            f"delta_{k}": metrics.accuracy_score(
                np.ones(len(g), dtype=bool), np.maximum(g / p, p / g) < 1.25**k
            )
            for k in (1, 2, 3)
        },
    }
    off = {name: abs(ours[name] - theirs[name]) / theirs[name] for name in METRICS}
    for name in METRICS:
        print(
            f"{name:10} {ours[name]:.12f} scikit-learn {theirs[name]:.12f}, off by {off[name]:.0e}"
        )
    told = {"metrics": len(off), "pixels": len(g), "scikit-learn": version("scikit-learn")}
    figures.add(Figure(COMPARED, max(off.values()), WANTED_OFF, told=told))


if __name__ == "__main__":
    main()
