"""Whether the quality planes are calibrated: (depth - bias - truth) / sigma on five bridges.

    python benchmarks/quality.py [--bridges B1 ...] [--seconds 34]

Frames of simulated walks without drift and with nothing moving, made as by ``250k-clean`` with a
table ``[quality]``. Truth is that along the winning return's own pixel position, from the true
pose. Pixels that leak are left out, and those whose own position truly shows the sky (counted).
In each bin 1.4826 MAD has to lie within 0.8 and 1.25, the median within 0.3 of 0, and at most 1 %
beyond 3. The four bins of range hold a quarter of the pixels each.

Exits with 1 when a target is missed.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parent))
import itertools

from visibility import judged
from visibility_scenes import BRIDGES, Walk, truth_of, warm_frames

from civil_rgbd.constants import NS_PER_S
from civil_rgbd.domain.recipe import QualityStage
from civil_rgbd.geometry.transforms import transform_points
from civil_rgbd.pipeline.frames import FrameMaker
from civil_rgbd.pipeline.winners import find_winners
from civil_rgbd.simulator.catalogue import caster_for
from civil_rgbd.simulator.recording import SimulatedRecording
from civil_rgbd.simulator.walk import START_NS

MAD, MEDIAN, BEYOND_3 = (0.8, 1.25), 0.3, 0.01
INCIDENCES_DEG = (0, 30, 60, 90)
RETURNS = ((1, 1), (2, 3), (4, 10**9))

Column = NDArray[np.float64]


@dataclass(frozen=True)
class Scores:
    """Of many pixels: standard score, range, true angle between ray and normal, returns."""

    z: Column
    range_m: Column
    incidence_deg: Column
    returns: Column


def scores_of(walk: Walk) -> Iterator[tuple[NDArray[np.float64], float]]:
    """Per frame (4, N) of :class:`Scores`' columns, and the milliseconds that the planes took."""
    recipe = replace(walk.recipe, quality=QualityStage())
    maker, caster = FrameMaker(SimulatedRecording(walk.spec), recipe), caster_for(walk.spec)
    for plan, inner, outer in warm_frames(maker):
        before_m, _ = maker.render(plan.T_map_camera, inner)
        depth_m = before_m.copy()
        maker.remove_hidden(depth_m, plan.T_map_camera, window=inner, around=outer)
        started = time.process_time()
        planes = maker.quality(plan, inner, depth_m, before_m) or {}
        took_ms = 1e3 * (time.process_time() - started)
        T = maker.camera_from_local(plan.T_map_camera)
        won = find_winners(inner, T_camera_local=T, camera=maker.images.camera, limits=recipe.depth)
        truth_m, _ = truth_of(walk.spec, plan.source_index, maker.images.camera)
        leak, _ = judged(depth_m, truth_m)
        used = (depth_m > 0) & ~leak
        points = np.concatenate(inner.segments, axis=1)[:, won.point[used]].T.astype(np.float64)
        seen = transform_points(T, points)
        rays = seen / seen[:, 2:]
        R, origin = plan.T_map_camera[:3, :3], plan.T_map_camera[np.newaxis, :3, 3]
        aimed = sum(R[np.newaxis, :, i] * rays[:, i, np.newaxis] for i in range(3))
        instants_s = np.full(len(rays), (plan.stamp_ns - START_NS) / NS_PER_S)
        hits = caster.cast(origin, np.ascontiguousarray(aimed), instants_s)
        bias_m, sigma_m, returns = (
            planes[name][used].astype(np.float64) for name in ("bias_m", "sigma_m", "returns")
        )
        z = np.where(
            hits.distances > 0, (depth_m[used] - bias_m - hits.distances) / sigma_m, np.nan
        )
        range_m = depth_m[used] * np.sqrt((rays**2).sum(axis=1))
        angle = np.degrees(np.arccos(np.clip(hits.cosines, 0, 1)))
        yield np.stack([z, range_m, angle, returns]), took_ms


def bins_of(scores: Scores) -> Iterator[tuple[str, NDArray[np.bool_], bool]]:
    """Name the bins, tell their pixels, and whether a target hangs on them."""
    edges = [0.0, *np.quantile(scores.range_m, [0.25, 0.5, 0.75]).tolist(), np.inf]
    for low, high in itertools.pairwise(edges):
        within = (scores.range_m >= low) & (scores.range_m < high)
        yield f"range {low:.1f} to {high:.1f} m", within, True
    for low, high in itertools.pairwise(INCIDENCES_DEG):
        within = (scores.incidence_deg >= low) & (scores.incidence_deg <= high)
        yield f"incidence {low} to {high} deg", within, True
    for low, high in RETURNS:
        within = (scores.returns >= low) & (scores.returns <= high)
        words = f"{low} to {high}" if high < 10 else f"{low} or more"
        yield f"{low if low == high else words} returns", within, True
    yield "beyond 20 m", scores.range_m > 20, False
    yield "all", np.ones(len(scores.z), dtype=np.bool_), True


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--bridges", nargs="+", default=BRIDGES, choices=BRIDGES)
    parser.add_argument("--seconds", type=int, default=34)
    arguments = parser.parse_args()
    parts, costs = [], []
    for bridge in arguments.bridges:
        for part, took_ms in scores_of(Walk(bridge, seconds=arguments.seconds)):
            parts.append(part)
            costs.append(took_ms)
    columns = np.concatenate(parts, axis=1)
    at_sky = np.isnan(columns[0])
    scores = Scores(*columns[:, ~at_sky])
    print(f"{'bin':<26} {'pixels':>9} {'median':>8} {'1.4826 MAD':>11} {'% beyond 3':>11}")
    ok = True
    for title, within, counts in bins_of(scores):
        z = scores.z[within]
        median = float(np.median(z))
        mad = 1.4826 * float(np.median(np.abs(z - median)))
        beyond = float((np.abs(z) > 3).mean())
        fits = MAD[0] <= mad <= MAD[1] and abs(median) <= MEDIAN and beyond <= BEYOND_3
        ok &= fits or not counts
        note = "" if fits else ("   MISSED" if counts else "   (no target)")
        print(f"{title:<26} {len(z):>9} {median:>8.3f} {mad:>11.3f} {100 * beyond:>11.2f}{note}")
    print(f"left out: {100 * at_sky.mean():.3f} % whose own position shows the sky")
    print(f"the planes take {min(costs):.0f} ms a frame on one core")
    print("every target is met" if ok else "A TARGET IS MISSED")
    return 0 if ok else 1


if __name__ == "__main__":
    sys.exit(main())
