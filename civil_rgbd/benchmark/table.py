"""The rows of Table 2: mean and standard deviation over seeds, gains paired by seed."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import mean, stdev
from typing import Final

from civil_rgbd.benchmark.cells import CellFailure, CellResult, Outcome
from civil_rgbd.benchmark.protocol import SAME
from civil_rgbd.lineage import Seen

HEADLINE: Final = "abs_rel"


@dataclass(frozen=True, slots=True)
class Spread:
    """Some seeds' values of one number.

    Attributes:
        values: by seed; seeds without a value are left out.
    """

    values: Mapping[int, float]

    @property
    def mean(self) -> float:
        """Over seeds; NaN for none."""
        return mean(self.values.values()) if self.values else math.nan

    @property
    def deviation(self) -> float:
        """Standard deviation over seeds (n - 1); NaN for fewer than two."""
        return stdev(self.values.values()) if len(self.values) > 1 else math.nan


@dataclass(frozen=True, slots=True)
class TableRow:
    """One model with one number of shots.

    Attributes:
        model: what the table calls it.
        shots: frames of the test bridge that trained.
        seeds: that are in it.
        frames: scored in each set of frames, by seed.
        scores: spread by set of frames, by averaging (``per_image``, ``pooled``), by metric.
        gain: share of the headline metric that the shots take off, each seed against its own run
            without shots; empty without such runs.
        seen: what a run of the user's own has seen of the test bridge, at most over seeds.
        failed: why a seed is not in it, by seed.
        counts: what was scored, skipped and clamped, by set of frames, by seed, by name.
        splits: hash of the frames that train and are scored, by seed.
        software: versions that scored, by name.
    """

    model: str
    shots: int
    seeds: tuple[int, ...]
    frames: Mapping[str, Mapping[int, int]]
    scores: Mapping[str, Mapping[str, Mapping[str, Spread]]]
    gain: Spread
    seen: Seen
    failed: Mapping[int, str]
    counts: Mapping[str, Mapping[int, Mapping[str, int]]]
    splits: Mapping[int, str]
    software: Mapping[str, str]


def table_rows(outcomes: Sequence[Outcome]) -> list[TableRow]:
    """Summarise cells: models in their order, shots ascending; at least one cell is done.

    Args:
        outcomes: what came out of each cell, in the order of the cells.
    """
    models = list(dict.fromkeys(cell.model for cell in outcomes))
    groups: dict[tuple[str, int], list[Outcome]] = {}
    for cell in sorted(outcomes, key=lambda one: (models.index(one.model), one.shots, one.seed)):
        groups.setdefault((cell.model, cell.shots), []).append(cell)
    any_done = _done(outcomes)[0]
    return [
        _row(group, without_shots=groups.get((model, 0), []), like=any_done)
        for (model, _), group in groups.items()
    ]


def _done(outcomes: Sequence[Outcome]) -> list[CellResult]:
    return [one for one in outcomes if isinstance(one, CellResult)]


def _row(
    group: Sequence[Outcome], *, without_shots: Sequence[Outcome], like: CellResult
) -> TableRow:
    """Summarise the seeds of one model and number of shots.

    Args:
        group: all of them.
        without_shots: those of the same model without shots.
        like: any cell that is done: it has the names of sets and metrics.
    """
    done, tests = _done(group), like.results["tests"]
    scores = {
        test: {
            averaging: {
                metric: _spread(done, test, averaging, metric) for metric in tests[test][averaging]
            }
            for averaging in ("per_image", "pooled")
        }
        for test in tests
    }
    headline = next(iter(tests[SAME]["per_image"]))  # AbsRel, or AbsRel median-scaled
    own = scores[SAME]["per_image"][headline].values
    start = _spread(_done(without_shots), SAME, "per_image", headline).values
    gains = {seed: 1 - own[seed] / start[seed] for seed in own if start.get(seed)}
    return TableRow(
        model=group[0].model,
        shots=group[0].shots,
        seeds=tuple(cell.seed for cell in done),
        frames={test: {cell.seed: _frames_scored(cell, test) for cell in done} for test in tests},
        scores=scores,
        gain=Spread(gains if group[0].shots else {}),
        seen=_most_seen(done),
        failed={one.seed: one.what for one in group if isinstance(one, CellFailure)},
        counts={
            test: {cell.seed: cell.results["tests"][test]["counts"] for cell in done}
            for test in tests
        },
        splits={cell.seed: cell.results["split"]["sha256"] for cell in done},
        software=like.results["software"],
    )


def _most_seen(done: Sequence[CellResult]) -> Seen:
    return Seen(
        trained=max((cell.seen.trained for cell in done), default=0),
        scored=max((cell.seen.scored for cell in done), default=0),
        unknown=done[0].seen.unknown if done else (),
    )


def _frames_scored(cell: CellResult, test: str) -> int:
    counts = cell.results["tests"][test]["counts"]
    return int(counts["images"] - counts["images_skipped"])


def _spread(group: Sequence[CellResult], test: str, averaging: str, metric: str) -> Spread:
    found = {cell.seed: cell.results["tests"][test][averaging][metric] for cell in group}
    return Spread({seed: value for seed, value in found.items() if value is not None})
