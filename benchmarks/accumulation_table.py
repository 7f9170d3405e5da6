"""Conditions as a tidy CSV, one row a condition and bridge, and what a page says of several."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import Final

import numpy as np
from accumulation_scenes import Row, Scene

_OF_SCENE: Final = tuple(field.name for field in fields(Scene))
_OF_ROW: Final = tuple(field.name for field in fields(Row) if field.name != "scene")
_WHOLE: Final = ("points", "frames")
_NAMES: Final = ("window", "filter")


def write_rows(path: Path, rows: Sequence[Row]) -> None:
    """Write the CSV: shares as shares, metres, seconds; five digits."""
    partial = path.with_suffix(".partial")
    with partial.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow([*_OF_SCENE, *_OF_ROW])
        for row in rows:
            scene = [getattr(row.scene, name) for name in _OF_SCENE]
            writer.writerow([*scene, *(_text(getattr(row, name)) for name in _OF_ROW)])
    partial.replace(path)


def _text(value: str | float) -> str:
    return f"{value:.5g}" if isinstance(value, float) else str(value)


def read_rows(path: Path) -> list[Row]:
    """Read the CSV."""
    with path.open(newline="", encoding="utf-8") as stream:
        return [_row(cells) for cells in csv.DictReader(stream)]


def _row(cells: dict[str, str]) -> Row:
    numbers = {
        name: int(cells[name]) if name in _WHOLE else float(cells[name])
        for name in _OF_ROW
        if name not in _NAMES
    }
    texts = {name: cells[name] for name in _NAMES}
    scene = Scene(**{name: cells[name] for name in _OF_SCENE})
    return Row(scene, **(texts | numbers))  # type: ignore[arg-type]  # by name: each as its field


def chosen(
    rows: Sequence[Row],
    *,
    motion: str = "walking",
    traffic: str = "none",
    drift: str = "none",
    window: str = "past",
    points: int,
    filtering: str = "off",
) -> list[Row]:
    """Return the rows of one condition, one a bridge."""
    wanted = (motion, traffic, drift, window, points, filtering)
    return [
        row
        for row in rows
        if (
            row.scene.motion,
            row.scene.traffic,
            row.scene.drift,
            row.window,
            row.points,
            row.filter,
        )
        == wanted
    ]


def values(rows: Sequence[Row], measure: str) -> dict[str, float]:
    """Return a measure by bridge; ``ghost`` is what is neither good nor leaks."""
    return {row.scene.bridge: _value(row, measure) for row in rows}


def _value(row: Row, measure: str) -> float:
    if measure == "ghost":
        return max(1.0 - row.good - row.leak, 0.0)
    return float(getattr(row, measure))


def mean(rows: Sequence[Row], measure: str) -> float:
    """Return the mean of a measure over the bridges; not a number without any."""
    found = list(values(rows, measure).values())
    return float(np.mean(found)) if found else float("nan")


def worst(rows: Sequence[Row], measure: str) -> tuple[str, float]:
    """Return the bridge with the worst of a measure: the least coverage, the most of the others."""
    found = values(rows, measure)
    pick = min if measure in {"coverage", "good"} else max
    bridge = pick(found, key=lambda name: found[name])
    return bridge, found[bridge]
