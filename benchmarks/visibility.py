"""How much of the depth shows what the camera cannot see, and what removing it costs.

    python benchmarks/visibility.py --cache FOLDER [--speeds 0.3 1.0 1.5] [--bridges B1 ...]

Five simulated bridges, walked through at three speeds, with images of three sizes, with three
densities, with drifting poses, and with cars and people that move; frames made as by the recipe
``250k-clean``. Truth is the dense depth at the image's instant from the true pose. A valid pixel
*leaks* when its depth exceeds the largest truth in its 3 x 3 neighbourhood by more than 0.1 m + 2 %
(sky counts as infinite); it is *good* within 0.1 m + 2 % of the range of truth there; *lost* are
good pixels that are removed, of all that were good. The first run simulates for some ten minutes;
later ones read the cache until the code changes.

Exits with 1 when a target is missed.
"""

# ruff: noqa: E402  # libraries read the number of threads when they load: it is set before

from __future__ import annotations

import os

for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[_variable] = "1"

import argparse
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parent))
from visibility_scenes import BRIDGES, RAILING, SOFFIT, Frames, Walk, walked

from civil_rgbd.builder.plan import plan_frames
from civil_rgbd.domain.recipe import VisibilityStage
from civil_rgbd.pipeline.frames import FrameMaker
from civil_rgbd.pipeline.visibility import closed_front, forget_gone, remove_hidden
from civil_rgbd.simulator.recording import SimulatedRecording

LEAKS, LOST, COST_MS, KEPT = 0.0005, 0.005, 3.0, 0.95
"""Targets: of the mean of the five bridges, still and without drift; milliseconds; share."""

MARGIN_M, MARGIN_SHARE = 0.1, 0.02
THIN_PX, FAR_M = 3, 30.0
GONE_PX = 7
"""Tried beside the recipe's own, which takes nothing for gone."""

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Score:
    """Of one walk. Shares; of thin railings and far soffit the pixels that show them."""

    leaks_before: float
    leaks: float
    lost: float
    railing: float
    railing_pixels: int
    soffit: float
    soffit_pixels: int


def score_of(frames: Frames, stage: VisibilityStage) -> Score:
    """Remove what is hidden, and compare with the truth."""
    sums = np.zeros(10)
    for depth_m, surface_m, truth_m, kind in zip(
        frames.depth_m, frames.surface_m, frames.truth_m, frames.kind, strict=True
    ):
        kept_m, seen_m = depth_m.copy(), surface_m.copy()
        forget_gone(seen_m, depth_m, camera=frames.camera, stage=stage)
        front_m = closed_front(seen_m, camera=frames.camera, stage=stage)
        remove_hidden(kept_m, front_m, stage=stage)
        leak, good = judged(depth_m, truth_m)
        valid, kept = depth_m > 0, kept_m > 0
        shows = good & (np.abs(depth_m - truth_m) <= MARGIN_M + MARGIN_SHARE * truth_m)
        railing = shows & thin(kind == RAILING)
        soffit = shows & (kind == SOFFIT) & (truth_m > FAR_M)
        masks = (valid, leak, kept, leak & kept, good, good & ~kept)
        masks += (railing, railing & kept, soffit, soffit & kept)
        sums += [np.count_nonzero(mask) for mask in masks]
    valid, leaks, kept, left, good, lost, rail, rail_kept, soffit, soffit_kept = sums.tolist()
    return Score(
        leaks_before=leaks / valid,
        leaks=left / kept,
        lost=lost / good,
        railing=rail_kept / rail if rail else 1.0,
        railing_pixels=int(rail),
        soffit=soffit_kept / soffit if soffit else 1.0,
        soffit_pixels=int(soffit),
    )


def judged(depth_m: NDArray[np.float32], truth_m: NDArray[np.float32]) -> tuple[Mask, Mask]:
    """Tell the valid pixels that leak from those that are good; some are neither."""
    sky = np.where(truth_m > 0, truth_m, np.float32(np.inf)).astype(np.float64)
    around = np.ones((3, 3), dtype=np.uint8)
    most, least = cv2.dilate(sky, around), cv2.erode(sky, around)
    valid = depth_m > 0
    leak = valid & (depth_m > most + MARGIN_M + MARGIN_SHARE * most)
    with np.errstate(invalid="ignore"):  # nothing but sky around: no depth is good
        near = depth_m >= least - (MARGIN_M + MARGIN_SHARE * least)
    return leak, valid & ~leak & near


def thin(mask: Mask) -> Mask:
    """Keep the pixels whose run of the mask, across or down, is at most three pixels long."""
    image = mask.astype(np.uint8)
    wide = cv2.morphologyEx(image, cv2.MORPH_OPEN, np.ones((1, THIN_PX + 1), np.uint8))
    high = cv2.morphologyEx(image, cv2.MORPH_OPEN, np.ones((THIN_PX + 1, 1), np.uint8))
    return mask & ((wide == 0) | (high == 0))


def cost_ms(image_scale: float, repeat: int = 40) -> tuple[float, float]:
    """Processor time of rendering one frame, and of looking what hides what: best of many."""
    cv2.setNumThreads(1)
    walk = Walk("B3", seconds=12, image_scale=image_scale)
    recording = SimulatedRecording(walk.spec)
    maker = FrameMaker(recording, walk.recipe)
    plan = plan_frames(recording, walk.recipe).frames[-1]
    occluders = maker.occluders()
    if occluders is None:
        raise SystemExit("the recipe 250k-clean has no stage visibility")
    inner, outer = maker.windows().at(plan.stamp_ns), occluders.at(plan.stamp_ns)
    best = [np.inf, np.inf]
    for _ in range(repeat):
        started = time.process_time()
        depth_m, _ = maker.render(plan.T_map_camera, inner)
        drawn = time.process_time()
        maker.remove_hidden(depth_m, plan.T_map_camera, window=inner, around=outer)
        best = [min(best[0], drawn - started), min(best[1], time.process_time() - drawn)]
    return 1e3 * best[0], 1e3 * best[1]


def row(title: str, scores: Sequence[Score]) -> str:
    """Mean over the bridges, and the worst of them."""
    names = ("leaks_before", "leaks", "lost")
    means = [100 * float(np.mean([getattr(s, name) for s in scores])) for name in names]
    worst = [100 * max(getattr(s, name) for s in scores) for name in names]
    cells = [f"{mean:8.4f} {high:8.4f}" for mean, high in zip(means, worst, strict=True)]
    seen = [(s.railing, s.railing_pixels, s.soffit, s.soffit_pixels) for s in scores]
    thin_kept = sum(a * n for a, n, _, _ in seen) / max(sum(n for _, n, _, _ in seen), 1)
    far_kept = sum(a * n for _, _, a, n in seen) / max(sum(n for *_, n in seen), 1)
    counted = sum(n for _, n, _, _ in seen), sum(n for *_, n in seen)
    kept = [
        f"{100 * share:7.2f}" if count else f"{'none':>7}"
        for share, count in zip((thin_kept, far_kept), counted, strict=True)
    ]
    return f"{title:<34} {'  '.join(cells)}  {' '.join(kept)}  of {counted[0]} and {counted[1]} px"


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cache", type=Path, required=True)
    parser.add_argument("--speeds", type=float, nargs="+", default=[0.3, 1.0, 1.5])
    parser.add_argument("--bridges", nargs="+", default=BRIDGES, choices=BRIDGES)
    arguments = parser.parse_args()
    conditions = {f"{v} m/s": {"speed_m_s": v} for v in arguments.speeds}
    conditions |= {f"1.0 m/s, image scale {s}": {"image_scale": s} for s in (1.0, 0.3)}
    conditions["1.5 m/s, image scale 1.0"] = {"speed_m_s": 1.5, "image_scale": 1.0}
    targets = tuple(conditions)
    conditions |= {
        "1.0 m/s, 100,000 points": {"points": 100_000},
        "1.0 m/s, 1,000,000 points": {"points": 1_000_000},
        "1.0 m/s, poses drift": {"drift": True},
        "1.0 m/s, cars and people move": {"moving": True},
    }
    heads = ("leaks before", "leaks left", "good lost")
    print(f"{'percent; mean and worst bridge':<34}", *(f"{head:>17} " for head in heads), end="")
    print(f" {'railing':>7} {'soffit':>7}  (kept of 3 px thin, of beyond 30 m)")
    ok, alone = True, []
    for title, changed in conditions.items():
        walks = [Walk(bridge, **changed) for bridge in arguments.bridges]
        frames = [walked(walk, arguments.cache) for walk in walks]
        stages = [walk.recipe.visibility or VisibilityStage() for walk in walks]
        scores = list(map(score_of, frames, stages))
        print(row(title, scores), flush=True)
        forgetting = [replace(stage, gone_px=GONE_PX) for stage in stages]
        print(row(f"  with gone_px = {GONE_PX}", list(map(score_of, frames, forgetting))))
        if title in targets:
            alone += [
                row(f"  {title} {walk.bridge}", [score])
                for walk, score in zip(walks, scores, strict=True)
            ]
            ok &= float(np.mean([s.leaks for s in scores])) <= LEAKS
            ok &= float(np.mean([s.lost for s in scores])) <= LOST
            ok &= all(s.railing >= KEPT and s.soffit >= KEPT for s in scores)
    print(*alone, sep="\n")
    for scale, most_ms in ((0.6, COST_MS), (1.0, np.inf)):
        plain_ms, cost = cost_ms(scale)
        print(
            f"cost at scale {scale}: {cost:.2f} ms a frame beside {plain_ms:.2f} ms for rendering"
        )
        ok &= cost <= most_ms
    print("every target is met" if ok else "A TARGET IS MISSED")
    return 0 if ok else 1


if __name__ == "__main__":
    sys.exit(main())
