"""The tables of ``docs/accumulation.md``, written between its markers from the rows of the CSV."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

from accumulation_plots import short_count
from accumulation_scenes import Row
from accumulation_table import chosen, mean, worst

Rows = Sequence[Row]

_PERCENT: Final = {"coverage": 1, "leak": 3, "lost": 2, "ghost": 2, "abs_rel": 2, "good": 2}
_METRES: Final = {"rmse_m": (1, 2), "median_m": (100, 1)}
_WINDOWS: Final = {"past": "before", "centred": "around", "future": "after"}
_DRIFTS: Final = {"none": "exact", "usual": "usual", "poor": "poor"}
_STAGES: Final = {"off": "as it is", "on": "filtered", "twice": "by twice"}
_TWO: Final = ("off", "on")


def renew_tables(page: Path, rows: Rows) -> Path:
    """Write the tables into the page; return it."""
    page.write_text(renewed(page.read_text(encoding="utf-8"), rows), encoding="utf-8")
    return page


def renewed(text: str, rows: Rows) -> str:
    """Return a page's text with the tables of these rows.

    Raises:
        ValueError: the page has no place for a table, or more than one.
    """
    for name, make in TABLES.items():
        begin, end = f"<!-- table {name} -->\n", f"<!-- end {name} -->"
        pattern = re.compile(f"{re.escape(begin)}.*?{re.escape(end)}", re.DOTALL)
        table = begin + "\n".join(make(rows)) + "\n" + end
        text, count = pattern.subn(lambda _, table=table: table, text)  # type: ignore[misc]  # bound
        if count != 1:
            raise ValueError(f"the page has {count} places for the table {name!r}, not one")
    return text


def _shown(value: float, measure: str) -> str:
    if measure in _METRES:
        times, digits = _METRES[measure]
        return f"{value * times:.{digits}f}"
    if measure == "span_s":
        return f"{value:.1f}"
    return f"{100 * value:.{_PERCENT[measure]}f}"


def _cell(rows: Rows, measure: str, *, with_worst: bool = True) -> str:
    """Write the mean of the bridges, and the worst of them by name."""
    if not rows:
        return "none"
    text = _shown(mean(rows, measure), measure)
    if with_worst:
        bridge, value = worst(rows, measure)
        text += f" ({bridge} {_shown(value, measure)})"
    return text


def _line(*cells: str) -> str:
    return f"| {' | '.join(cells)} |"


def _head(*cells: str) -> list[str]:
    return [_line(*cells), _line(*("---" for _ in cells))]


def _points(rows: Rows) -> list[int]:
    return sorted({row.points for row in rows})


def _table_of_points(rows: Rows) -> list[str]:
    """Walking, exact poses, before the image: everything, as it is and filtered."""
    lines = _head(
        "points", "", "seconds", "coverage %", "see-through %", "good lost %", "AbsRel %",
        "RMSE m", "median error cm",
    )  # fmt: skip
    for points in _points(rows):
        for filtering, stage in _STAGES.items():
            some = chosen(rows, points=points, filtering=filtering)
            if not some:
                continue
            lines.append(
                _line(
                    short_count(points),
                    stage,
                    _cell(some, "span_s", with_worst=False),
                    _cell(some, "coverage"),
                    _cell(some, "leak"),
                    _cell(some, "lost") if filtering != "off" else "-",
                    *(_cell(some, measure) for measure in ("abs_rel", "rmse_m", "median_m")),
                )
            )
    return lines


def _table_of_windows(rows: Rows) -> list[str]:
    """Walking, exact poses: windows beside each other."""
    lines = _head(
        "points", "window", "coverage %", "see-through %", "filtered", "good lost %",
        "AbsRel %", "filtered", "RMSE m", "filtered",
    )  # fmt: skip
    for points in _points(rows):
        for window, word in _WINDOWS.items():
            plain, clean = (
                chosen(rows, points=points, window=window, filtering=name) for name in _TWO
            )
            cells = [_cell(plain, "coverage"), _cell(plain, "leak"), _cell(clean, "leak")]
            cells.append(_cell(clean, "lost"))
            for measure in ("abs_rel", "rmse_m"):
                cells += [_cell(some, measure, with_worst=False) for some in (plain, clean)]
            lines.append(_line(short_count(points), word, *cells))
    return lines


def _table_of_drift(rows: Rows) -> list[str]:
    """Walking, filtered: what poses that drift do to windows of each length."""
    measures = ("median_m", "good", "abs_rel", "leak", "lost")
    lines = _head(
        "points", "poses", "window", "median error cm", "good %", "AbsRel %", "see-through %",
        "good lost %",
    )  # fmt: skip
    for points in _points(rows):
        for drift, poses in _DRIFTS.items():
            for window in ("past", "centred"):
                some = chosen(rows, points=points, drift=drift, window=window, filtering="on")
                cells = [_cell(some, measure, with_worst=False) for measure in measures]
                lines.append(_line(short_count(points), poses, _WINDOWS[window], *cells))
    return lines


def _table_of_still(rows: Rows) -> list[str]:
    """Standing beside walking, before the image, as it is."""
    lines = _head(
        "points", "camera", "seconds", "coverage %", "see-through %", "AbsRel %",
        "median error cm", "same, usual drift", "same, poor drift",
    )  # fmt: skip
    for points in _points(rows):
        for motion, word in (("walking", "walks"), ("still", "stands")):
            by_drift = [chosen(rows, points=points, motion=motion, drift=d) for d in _DRIFTS]
            exact = by_drift[0]
            lines.append(
                _line(
                    short_count(points),
                    word,
                    _cell(exact, "span_s", with_worst=False),
                    *(_cell(exact, measure) for measure in ("coverage", "leak", "abs_rel")),
                    *(_cell(some, "median_m", with_worst=False) for some in by_drift),
                )
            )
    return lines


def _table_of_traffic(rows: Rows) -> list[str]:
    """What moves, walking and standing, as it is and filtered."""
    lines = _head(
        "points", "camera", "in front %", "filtered", "see-through %", "filtered", "good lost %",
        "AbsRel %", "filtered",
    )  # fmt: skip
    for points in _points(rows):
        for motion, word in (("walking", "walks"), ("still", "stands")):
            plain, clean = (
                chosen(rows, points=points, motion=motion, traffic="moving", filtering=name)
                for name in _TWO
            )
            cells = [_cell(some, m) for m in ("ghost", "leak") for some in (plain, clean)]
            cells += [_cell(clean, "lost"), _cell(plain, "abs_rel"), _cell(clean, "abs_rel")]
            lines.append(_line(short_count(points), word, *cells))
    return lines


RECIPES: Final = {
    "50k": (50_000, "off"),
    "250k, 250k-all": (250_000, "off"),
    "250k-clean": (250_000, "on"),
    "1m": (1_000_000, "off"),
    "250k-clean --set accumulate.points=50_000": (50_000, "on"),
    "250k-clean --set accumulate.points=1_000_000": (1_000_000, "on"),
}
"""Recipes that ship, and one with another number: points before the image, filter."""


def _table_of_recipes(rows: Rows) -> list[str]:
    """Recipes that ship, walking, in what a site is like: drift; and with traffic."""
    lines = _head(
        "recipe", "seconds", "coverage %", "see-through %", "AbsRel %", "RMSE m",
        "median error cm", "in front of what is there %, with traffic",
    )  # fmt: skip
    for recipe, (points, name) in RECIPES.items():
        usual = chosen(rows, points=points, filtering=name, drift="usual")
        moving = chosen(rows, points=points, filtering=name, traffic="moving")
        cells = [_cell(usual, m) for m in ("coverage", "leak", "abs_rel", "rmse_m", "median_m")]
        span = _cell(usual, "span_s", with_worst=False)
        names = ", ".join(f"`{name}`" for name in recipe.split(", "))
        lines.append(_line(names, span, *cells, _cell(moving, "ghost")))
    return lines


def _frames(rows: Rows) -> list[str]:
    """How many frames stand behind a figure."""
    counts = {
        motion: sorted({row.frames for row in rows if row.scene.motion == motion})
        for motion in ("walking", "still")
    }
    words = {motion: " to ".join({str(c[0]), str(c[-1])}) for motion, c in counts.items()}
    bridges = len({row.scene.bridge for row in rows})
    solid = mean(chosen(rows, points=_points(rows)[0]), "solid")
    return [
        f"Behind every figure are {words['walking']} frames of each of {bridges} bridges, walking,",
        f"and {words['still']} standing; {100 * solid:.0f} % of the pixels of a walk show",
        "something, the rest is sky.",
    ]


TABLES: Final[dict[str, Callable[[Rows], list[str]]]] = {
    "frames": _frames,
    "recipes": _table_of_recipes,
    "points": _table_of_points,
    "windows": _table_of_windows,
    "drift": _table_of_drift,
    "still": _table_of_still,
    "traffic": _table_of_traffic,
}
"""What makes each table, by the name between the page's markers."""
