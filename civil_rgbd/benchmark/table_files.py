"""The table as Markdown, LaTeX, CSV and JSON."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator, Sequence
from statistics import mean
from typing import Any, Final

from civil_rgbd.benchmark.notes import caption, notes, span
from civil_rgbd.benchmark.protocol import APART, REMAINDER, SAME
from civil_rgbd.benchmark.table import Spread, TableRow
from civil_rgbd.evaluation.metrics import MEDIAN_SCALED, label_of
from civil_rgbd.evaluation.results import in_words as versions_in_words

SHOWN: Final = ("abs_rel", "rmse", "log10", "delta_1", "delta_2", "delta_3")
"""The paper's metrics: columns of the table. The CSV has all."""

HEADLINE: Final = "abs_rel"

_TEX: Final = {
    "\\": r"\textbackslash{}",
    **{sign: rf"\{sign}" for sign in "_%&#${}"},
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "±": r"$\pm$",
    "δ": r"$\delta$ ",
}
"""What LaTeX reads otherwise: names of models are paths at times, and causes are anything."""


def table_markdown(rows: Sequence[TableRow], test_bridge: str) -> str:
    """Return the table as Markdown, with its caption."""
    head, body = table_cells(rows)
    lines = [
        "| " + " | ".join(head) + " |",
        "| --- |" + " ---: |" * (len(head) - 1),
        *("| " + " | ".join(line) + " |" for line in body),
        "",
        caption(rows, test_bridge),
        "",
        *(f"- {note}" for note in notes(rows)),
    ]
    return "\n".join(lines) + "\n"


def table_latex(rows: Sequence[TableRow], test_bridge: str) -> str:
    """Return the table as LaTeX for booktabs."""
    head, body = table_cells(rows)
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
        "  \\footnotesize",
        *(f"  \\par {_escaped(note)}" for note in notes(rows)),
        "\\end{table}",
    ]
    return "\n".join(lines) + "\n"


def _escaped(text: str) -> str:
    return "".join(_TEX.get(sign, sign) for sign in text)


def table_cells(rows: Sequence[TableRow]) -> tuple[list[str], list[list[str]]]:
    """Return the words of the table: its head, and its lines."""
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
                f"{in_words(row.scores[test]['per_image'][names[0]])} ({span(row.frames[test])})"
                for test in (REMAINDER, APART)
            ),
        ]
        for row in rows
    ]
    return head, body


def _name(row: TableRow) -> str:
    """Return the model, and what a reader must not miss: what it has seen, and what failed."""
    failed = len(row.failed)
    told = [row.seen.in_words()] if row.seen.in_words() else []
    told += [f"FAILED: {failed} of {failed + len(row.seeds)} seeds"] * bool(failed)
    return f"{row.model} ({'; '.join(told)})" if told else row.model


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
    head = ("model", "shots", "test", "averaging", "metric", "seed", "value")
    yield (*head, "split_sha256", "software")
    for row in rows:
        versions = versions_in_words(row.software)
        for value in _row_values(row):
            yield (row.model, row.shots, *value, row.splits.get(value[3], ""), versions)


def _row_values(row: TableRow) -> Iterator[tuple[str, str, str, int, object]]:
    """Yield set of frames, averaging, metric, seed and value; what failed, with its cause."""
    for test, averagings in row.scores.items():
        for averaging, metrics in averagings.items():
            for metric, spread in metrics.items():
                for seed, value in spread.values.items():
                    yield test, averaging, metric, seed, value
    for test, seeds in row.counts.items():
        for seed, counts in seeds.items():
            for name, count in counts.items():
                yield test, "count", name, seed, count
    for seed, value in row.gain.values.items():
        yield SAME, "per_image", f"{HEADLINE}_gain", seed, value
    for seed, cause in row.failed.items():
        yield "", "", "failed", seed, cause


def rows_document(rows: Sequence[TableRow]) -> list[dict[str, Any]]:
    """Return the headline of each row as JSON values."""
    return [
        {
            "model": row.model,
            "shots": row.shots,
            "seeds": list(row.seeds),
            "failed": {str(seed): cause for seed, cause in row.failed.items()},
            "frames": {
                test: mean(one.values()) if one else None for test, one in row.frames.items()
            },
            "frames_by_seed": {
                test: {str(seed): count for seed, count in one.items()}
                for test, one in row.frames.items()
            },
            "seen": row.seen.to_document(),
            "split_sha256": {str(seed): sha for seed, sha in row.splits.items()},
            "counts": {
                test: {str(seed): dict(one) for seed, one in seeds.items()}
                for test, seeds in row.counts.items()
            },
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
