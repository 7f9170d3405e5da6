"""Table 2: mean and standard deviation over seeds, paired by seed; Markdown, CSV and LaTeX."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from statistics import mean, stdev
from typing import Any, Final

from civil_rgbd.benchmark.cells import CellResult
from civil_rgbd.benchmark.protocol import APART, NEAR_DEG, NEAR_M, REMAINDER, SAME
from civil_rgbd.evaluation.metrics import MEDIAN_SCALED, label_of

SHOWN: Final = ("abs_rel", "rmse", "log10", "delta_1", "delta_2", "delta_3")
"""The paper's metrics: columns of the table. The CSV has all."""

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
        seen: frames of the test bridge that a run of the user's own was trained with, and how many
            of those are scored, at most over seeds.
    """

    model: str
    shots: int
    seeds: tuple[int, ...]
    frames: Mapping[str, Mapping[int, int]]
    scores: Mapping[str, Mapping[str, Mapping[str, Spread]]]
    gain: Spread
    seen: tuple[int, int] = (0, 0)


def table_rows(cells: Sequence[CellResult]) -> list[TableRow]:
    """Summarise cells: models in their order, shots ascending."""
    models = list(dict.fromkeys(cell.model for cell in cells))
    groups: dict[tuple[str, int], list[CellResult]] = {}
    for cell in sorted(cells, key=lambda one: (models.index(one.model), one.shots, one.seed)):
        groups.setdefault((cell.model, cell.shots), []).append(cell)
    return [_row(group, groups.get((model, 0), [])) for (model, _), group in groups.items()]


def _row(group: Sequence[CellResult], without_shots: Sequence[CellResult]) -> TableRow:
    tests = list(group[0].results["tests"])
    scores = {
        test: {
            averaging: {
                metric: _spread(group, test, averaging, metric)
                for metric in group[0].results["tests"][test][averaging]
            }
            for averaging in ("per_image", "pooled")
        }
        for test in tests
    }
    frames = {test: {cell.seed: _frames_scored(cell, test) for cell in group} for test in tests}
    own = scores[SAME]["per_image"][_headline(group[0])].values
    start = _spread(without_shots, SAME, "per_image", _headline(group[0])).values
    gains = {seed: 1 - own[seed] / start[seed] for seed in own if start.get(seed)}
    return TableRow(
        model=group[0].model,
        shots=group[0].shots,
        seeds=tuple(cell.seed for cell in group),
        frames=frames,
        scores=scores,
        gain=Spread(gains if group[0].shots else {}),
        seen=max(cell.seen for cell in group),
    )


def _frames_scored(cell: CellResult, test: str) -> int:
    counts = cell.results["tests"][test]["counts"]
    return int(counts["images"] - counts["images_skipped"])


def _spread(group: Sequence[CellResult], test: str, averaging: str, metric: str) -> Spread:
    found = {cell.seed: cell.results["tests"][test][averaging][metric] for cell in group}
    return Spread({seed: value for seed, value in found.items() if value is not None})


def _headline(cell: CellResult) -> str:
    names: list[str] = list(cell.results["tests"][SAME]["per_image"])
    return names[0]  # AbsRel; its name says so when it is median-scaled


def caption(rows: Sequence[TableRow], test_bridge: str) -> str:
    """Say what the table shows."""
    seeds = max(len(row.seeds) for row in rows)
    frames = _span(rows[0].frames[SAME])
    seen = any(row.seen[0] for row in rows)
    return (
        f"Mean ± standard deviation over {seeds} seed{'s' * (seeds != 1)} on bridge {test_bridge}, "
        f"which no model without shots has seen{', but where its row says so' * seen}; each metric "
        "is taken per image, then averaged over images. Every number of shots of a seed is scored "
        f"on the same {frames} frames, which are no shots. Beside it AbsRel on the remainder (all "
        "frames but the shots, as the paper scores) and on the remainder apart (without frames "
        f"within {NEAR_M:g} m and {NEAR_DEG:g} deg of a shot), each with the number of frames that "
        "it rests on, least to most over seeds: remainder below apart is leakage by overlap. Gain "
        "is AbsRel taken off by the shots, each seed against its own run without."
    )


def table_markdown(rows: Sequence[TableRow], test_bridge: str) -> str:
    """Return the table as Markdown, with its caption."""
    head, body = _cells(rows)
    lines = [
        "| " + " | ".join(head) + " |",
        "| --- |" + " ---: |" * (len(head) - 1),
        *("| " + " | ".join(line) + " |" for line in body),
        "",
        caption(rows, test_bridge),
    ]
    return "\n".join(lines) + "\n"


def table_latex(rows: Sequence[TableRow], test_bridge: str) -> str:
    """Return the table as LaTeX for booktabs."""
    head, body = _cells(rows)
    lines = [
        "% \\usepackage{booktabs}",
        "\\begin{table}",
        f"  \\caption{{{_escaped(caption(rows, test_bridge))}}}",
        f"  \\begin{{tabular}}{{l{'r' * (len(head) - 1)}}}",
        "    \\toprule",
        f"    {' & '.join(map(_escaped, head))} \\\\",
        "    \\midrule",
        *(f"    {' & '.join(map(_escaped, line))} \\\\" for line in body),
        "    \\bottomrule",
        "  \\end{tabular}",
        "\\end{table}",
    ]
    return "\n".join(lines) + "\n"


def _escaped(text: str) -> str:
    for sign, tex in (("_", r"\_"), ("%", r"\%"), ("±", r"$\pm$"), ("δ", r"$\delta$ ")):
        text = text.replace(sign, tex)
    return text


def _cells(rows: Sequence[TableRow]) -> tuple[list[str], list[list[str]]]:
    names = [
        name
        for name in rows[0].scores[SAME]["per_image"]
        if name.removesuffix(MEDIAN_SCALED) in SHOWN
    ]
    head = [
        "Model",
        "shots",
        *map(label_of, names),
        "gain",
        "AbsRel remainder (frames)",
        "AbsRel apart (frames)",
    ]
    body = [
        [
            _name(row),
            str(row.shots),
            *(in_words(row.scores[SAME]["per_image"][name]) for name in names),
            in_words(row.gain, percent=True),
            *(
                f"{in_words(row.scores[test]['per_image'][names[0]])} ({_span(row.frames[test])})"
                for test in (REMAINDER, APART)
            ),
        ]
        for row in rows
    ]
    return head, body


def _name(row: TableRow) -> str:
    trained, scored = row.seen
    if not trained:
        return row.model
    return f"{row.model} (trained with {trained} frames of this bridge, {scored} of them scored)"


def _span(frames: Mapping[int, int]) -> str:
    """Return numbers of frames, from least to most over seeds."""
    least, most = min(frames.values()), max(frames.values())
    return str(least) if least == most else f"{least}-{most}"


def in_words(spread: Spread, *, percent: bool = False) -> str:
    """Return mean ± deviation.

    >>> in_words(Spread({0: 0.1, 1: 0.3})), in_words(Spread({0: 0.25}), percent=True)
    ('0.200 ± 0.141', '25.0 %')
    """
    if math.isnan(spread.mean):
        return "-"
    factor, form, unit = (100.0, ".1f", " %") if percent else (1.0, ".3f", "")
    text = format(spread.mean * factor, form)
    if not math.isnan(spread.deviation):
        text += f" ± {format(spread.deviation * factor, form)}"
    return text + unit


def table_csv(rows: Sequence[TableRow]) -> str:
    """Return every number of every seed, one a line."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(_values(rows))
    return text.getvalue()


def _values(rows: Sequence[TableRow]) -> Iterator[Sequence[object]]:
    yield ("model", "shots", "test", "averaging", "metric", "seed", "value")
    for row in rows:
        for test, averagings in row.scores.items():
            for averaging, metrics in averagings.items():
                for metric, spread in metrics.items():
                    for seed, value in spread.values.items():
                        yield (row.model, row.shots, test, averaging, metric, seed, value)
        for seed, value in row.gain.values.items():
            yield (row.model, row.shots, SAME, "per_image", f"{HEADLINE}_gain", seed, value)


def rows_document(rows: Sequence[TableRow]) -> list[dict[str, Any]]:
    """Return the headline of each row as JSON values."""
    return [
        {
            "model": row.model,
            "shots": row.shots,
            "seeds": list(row.seeds),
            "frames": {test: mean(one.values()) for test, one in row.frames.items()},
            "frames_by_seed": {
                test: {str(seed): count for seed, count in one.items()}
                for test, one in row.frames.items()
            },
            "test_frames_trained_with": row.seen[0],
            "test_frames_trained_with_and_scored": row.seen[1],
            "per_image": {
                test: {
                    metric: {"mean": _number(one.mean), "deviation": _number(one.deviation)}
                    for metric, one in averagings["per_image"].items()
                }
                for test, averagings in row.scores.items()
            },
            "gain": {"mean": _number(row.gain.mean), "deviation": _number(row.gain.deviation)},
        }
        for row in rows
    ]


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None
