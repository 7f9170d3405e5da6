"""Frames of simulated bridges made of ever more points, and how far their depth is from the truth.

A scene is one bridge, walked past or looked at from places where that walk passes, with or without
traffic, with exact or drifting poses. Each of its frames is made of every number of points before,
around and after its image, by the pipeline's own functions, and scored with and without the filter
of ``250k-clean``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import product
from typing import Final

import numpy as np
from numpy.typing import NDArray
from visibility import judged
from visibility_scenes import BRIDGES

from civil_rgbd.builder.plan import plan_frames
from civil_rgbd.builder.recipes import load_recipe
from civil_rgbd.constants import NS_PER_S
from civil_rgbd.domain.recipe import Recipe, VisibilityStage
from civil_rgbd.pipeline.accumulate import PointWindow, SlidingWindow
from civil_rgbd.pipeline.frames import FrameMaker, PlannedFrame
from civil_rgbd.pipeline.prepare import MappedScan, local_origin, map_scan
from civil_rgbd.simulator.camera import true_depth
from civil_rgbd.simulator.recording import SimulatedRecording
from civil_rgbd.simulator.spec import ScanSpec, usual_spec
from civil_rgbd.simulator.walk import START_NS

POINTS: Final = (25_000, 50_000, 100_000, 250_000, 500_000, 1_000_000, 2_000_000)
WINDOWS: Final = ("past", "centred", "future")
FILTERS: Final = ("off", "on", "twice")
"""Not at all; as ``250k-clean`` does it, with 500,000 points that may hide others, or the frame's
own where these are more; with twice the frame's points."""
DRIFTS: Final = {"none": (0.0, 0.0), "usual": (0.01, 0.02), "poor": (0.03, 0.06)}
"""Random walk of the poses: metres and degrees of heading a root second."""

_IMAGE_HZ: Final = 0.5
_TWICE: Final = (500_000, 1_000_000)  # of fewer it is no more than "on"; of more, minutes of scan


@dataclass(frozen=True)
class Effort:
    """How much is tried.

    Attributes:
        bridges: which.
        points: of a frame.
        warm_up_s: scanned before the first image and after the last.
        step_s: from one image of a walk to the next; even.
        images: of one walk.
        places: where a still camera stands, of those images'.
        image_scale: stored size / raw size.
        drifts: of the poses, keys of :data:`DRIFTS`.
    """

    bridges: tuple[str, ...] = BRIDGES
    points: tuple[int, ...] = POINTS
    warm_up_s: int = 24
    step_s: int = 4
    images: int = 10
    places: int = 5
    image_scale: float = 0.6
    drifts: tuple[str, ...] = tuple(DRIFTS)


QUICK: Final = Effort(("B2",), (25_000, 100_000), 2, 2, 1, 1, 0.3, drifts=("none",))


@dataclass(frozen=True)
class Scene:
    """One bridge, and how it is scanned.

    Attributes:
        bridge: ``B1`` to ``B5``.
        motion: of the camera, ``walking`` or ``still``.
        traffic: ``none`` or ``moving``: cars and people.
        drift: of the poses, a key of :data:`DRIFTS`.
    """

    bridge: str
    motion: str
    traffic: str
    drift: str


@dataclass(frozen=True)
class Row:
    """Frames of one condition; shares, metres, seconds. What is not pooled is a mean over frames.

    Attributes:
        scene: what was scanned.
        window: ``past``, ``centred`` or ``future``.
        points: of a frame.
        filter: of :data:`FILTERS`.
        frames: which had that many points.
        span_s: from a frame's earliest point to its latest.
        solid: pixels that truly show something, of all.
        coverage: pixels with depth, of all.
        leak: pixels that show what the camera cannot see, of those with depth; pooled.
        good: pixels within 0.1 m + 2 % of the truth around them, of those with depth; pooled.
        lost: good pixels that the filter removed, of all good ones; pooled.
        abs_rel: of the depth, against the truth.
        rmse_m: same.
        median_m: of the absolute error.
    """

    scene: Scene
    window: str
    points: int
    filter: str
    frames: int
    span_s: float
    solid: float
    coverage: float
    leak: float
    good: float
    lost: float
    abs_rel: float
    rmse_m: float
    median_m: float


def scenes(effort: Effort) -> list[Scene]:
    """Return what is scanned: drift where nothing moves, traffic where nothing drifts."""
    kinds = [("none", drift) for drift in effort.drifts] + [("moving", "none")]
    return [
        Scene(bridge, motion, traffic, drift)
        for bridge, motion, (traffic, drift) in product(effort.bridges, ("walking", "still"), kinds)
    ]


def conditions(effort: Effort) -> list[tuple[str, int, str]]:
    """Return every window, number of points and filter."""
    return [
        (window, points, name)
        for window, points, name in product(WINDOWS, effort.points, FILTERS)
        if name != "twice" or points in _TWICE
    ]


def recordings(scene: Scene, effort: Effort) -> Iterator[tuple[ScanSpec, list[int]]]:
    """Yield each scan of a scene, and when its images are looked at: seconds after its start."""
    drift_m, drift_deg = DRIFTS[scene.drift]
    usual = replace(
        usual_spec(scene.bridge),
        image_rate_hz=_IMAGE_HZ,
        stands_s=0.0,
        moving=int(scene.traffic == "moving"),
        drift_m_per_root_s=drift_m,
        yaw_drift_deg_per_root_s=drift_deg,
    )
    first_s, seed = effort.warm_up_s + 1, 100 * BRIDGES.index(scene.bridge)
    instants_s = [first_s + effort.step_s * image for image in range(effort.images)]
    if scene.motion == "walking":
        seconds = float(instants_s[-1] + effort.warm_up_s)
        yield replace(usual, seconds=seconds, seed=seed), instants_s
        return
    # The walker reaches full speed after 1.5 s: so much of the way is behind him.
    for place in instants_s[:: max(1, effort.images // effort.places)][: effort.places]:
        yield (
            replace(
                usual,
                speed_m_s=0.0,
                starts_m=place - 0.75,
                seconds=float(first_s + effort.warm_up_s),
                seed=seed + place,
            ),
            [first_s],
        )


def measured(scene: Scene, effort: Effort) -> list[Row]:
    """Simulate a scene, make its frames of every condition, and score them."""
    found: dict[tuple[str, int, str], list[NDArray[np.float64]]] = {
        condition: [] for condition in conditions(effort)
    }
    for spec, instants_s in recordings(scene, effort):
        bench = _Bench(spec, effort)
        for plan in bench.plans(instants_s):
            truth_m = true_depth(spec, plan.source_index, bench.maker.images.camera)
            for window, points in product(WINDOWS, effort.points):
                for name, score in bench.scores(plan, window, points, truth_m).items():
                    found[window, points, name].append(score)
    return [_row(scene, condition, scores) for condition, scores in found.items() if scores]


class _Bench:
    """One recording, its scans in the map, and the filter."""

    def __init__(self, spec: ScanSpec, effort: Effort) -> None:
        keys = ["select.min_displacement_m=0.0", f"image.scale={effort.image_scale}"]
        self._recipe: Recipe = load_recipe("250k-clean", keys)
        self._recording = SimulatedRecording(spec)
        self.maker = FrameMaker(self._recording, self._recipe)
        # What two windows need of a recording; every condition reads the same scans.
        self._read_mapped: Callable[[int], MappedScan] = lru_cache(
            maxsize=20 * effort.warm_up_s + 20
        )(self._mapped)

    def plans(self, instants_s: list[int]) -> Iterator[PlannedFrame]:
        """Yield the images that are taken at given seconds."""
        wanted = {START_NS + second * NS_PER_S for second in instants_s}
        plans = plan_frames(self._recording, self._recipe).frames
        chosen = [plan for plan in plans if plan.stamp_ns in wanted]
        if len(chosen) != len(wanted):
            raise RuntimeError(f"{len(chosen)} images where {len(wanted)} were asked for")
        yield from chosen

    def scores(
        self, plan: PlannedFrame, window: str, points: int, truth_m: NDArray[np.float64]
    ) -> dict[str, NDArray[np.float64]]:
        """Score one frame by filter; nothing where it has too few points."""
        stage = self._recipe.visibility or VisibilityStage()
        inner = self._window(window, points, plan.stamp_ns)
        if inner.count < points:
            return {}
        depth_m, _ = self.maker.render(plan.T_map_camera, inner)
        leak, good = judged(depth_m, truth_m.astype(np.float32))
        span_s = inner.span_ns / NS_PER_S
        shown = {"off": depth_m}
        hiding = {"on": max(points, stage.points)}
        if points in _TWICE:
            hiding["twice"] = 2 * points
        for name, count in hiding.items():
            outer = self._window(window, count, plan.stamp_ns)
            shown[name] = depth_m.copy()
            self.maker.remove_hidden(shown[name], plan.T_map_camera, window=inner, around=outer)
        return {
            name: _score(shown_m, truth_m, leak=leak, good=good, span_s=span_s)
            for name, shown_m in shown.items()
        }

    def _window(self, window: str, points: int, stamp_ns: int) -> PointWindow:
        return SlidingWindow(
            self._read_mapped,
            scan_stamps_ns=self._recording.scan_stamps_ns,
            reach_ns=self._recording.point_reach_ns,
            stage=replace(self._recipe.accumulate, window=window, points=points),
        ).at(stamp_ns)

    def _mapped(self, scan: int) -> MappedScan:
        return map_scan(
            self._recording.read_scan(scan),
            trajectory=self._recording.trajectory,
            rig=self._recording.rig,
            recipe=self._recipe,
            origin_map=local_origin(self._recording.trajectory),
        )


def _score(
    depth_m: NDArray[np.float32],
    truth_m: NDArray[np.float64],
    *,
    leak: NDArray[np.bool_],
    good: NDArray[np.bool_],
    span_s: float,
) -> NDArray[np.float64]:
    """Of one frame: span, solid, coverage, AbsRel, RMSE, median; then counts to be pooled."""
    valid = depth_m > 0
    judgeable = valid & (truth_m > 0)  # a leaf's return may fall into a pixel of the sky
    true_m = truth_m[judgeable]
    error_m = np.abs(depth_m[judgeable] - true_m)
    counts = [np.count_nonzero(m) for m in (valid, leak & valid, good & valid, good)]
    return np.array(
        [
            span_s,
            (truth_m > 0).mean(),
            valid.mean(),
            (error_m / true_m).mean(),
            np.sqrt((error_m**2).mean()),
            np.median(error_m),
            *counts,
        ]
    )


def _row(scene: Scene, condition: tuple[str, int, str], scores: list[NDArray[np.float64]]) -> Row:
    window, points, name = condition
    span_s, solid, coverage, abs_rel, rmse_m, median_m = np.mean(scores, axis=0)[:6].tolist()
    valid, leaks, good, good_before = np.sum(scores, axis=0)[6:].tolist()
    return Row(
        scene,
        window,
        points,
        name,
        frames=len(scores),
        span_s=span_s,
        solid=solid,
        coverage=coverage,
        leak=leaks / valid,
        good=good / valid,
        lost=1.0 - good / good_before,
        abs_rel=abs_rel,
        rmse_m=rmse_m,
        median_m=median_m,
    )
