"""Charts as SVG: no script, no font of their own, legible on paper and without colour."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from html import escape
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

WIDTH: Final = 540
HEIGHT: Final = 210
_LEFT, _RIGHT, _TOP, _BOTTOM = 64, 16, 12, 44
_LINE: Final = "#1f4e8c"
_BAR: Final = "#5b8cc0"
_GRID: Final = "#dddddd"
_TEXT: Final = "#333333"
_MAX_POINTS: Final = 2000  # of a line; more cannot be told apart, and make the page slow


@dataclass(frozen=True, slots=True)
class Axis:
    """One axis.

    Attributes:
        label: what it shows, with its unit.
        low: first value.
        high: last value, above ``low``.
    """

    label: str
    low: float
    high: float

    @property
    def ticks(self) -> list[float]:
        """Some three to eight round values inside."""
        step = round_step((self.high - self.low) / 7)
        first, last = math.ceil(self.low / step - 1e-9), math.floor(self.high / step + 1e-9)
        return [number * step for number in range(first, last + 1)]


def round_step(about: float) -> float:
    """Return the round number (1, 2 or 5 times a power of ten) that is at least ``about``.

    >>> round_step(0.3), round_step(7.0)
    (0.5, 10.0)
    """
    power = 10.0 ** math.floor(math.log10(about)) if about > 0 else 1.0
    return next(f * power for f in (1.0, 2.0, 5.0, 10.0) if f * power >= about * (1 - 1e-9))


def axis_over(values: NDArray[np.float64], label: str, *, from_zero: bool = False) -> Axis:
    """Return an axis that holds all values, with some room when they are all the same."""
    low = 0.0 if from_zero else float(values.min())
    high = float(values.max())
    if high - low < 1e-9 * max(1.0, abs(high)):
        high, low = high + 0.5, low if from_zero else low - 0.5
    return Axis(label, low, high + (high - low) * (0.05 if from_zero else 0.0))


def line_chart(x: NDArray[np.float64], y: NDArray[np.float64], x_axis: Axis, y_axis: Axis) -> str:
    """Draw values as a line with a dot each.

    Args:
        x: (N,) ascending.
        y: (N,).
        x_axis: below.
        y_axis: at the left.
    """
    keep = _thinned(y)
    to_x, to_y = _scales(x_axis, y_axis)
    places = [f"{to_x(a):.1f},{to_y(b):.1f}" for a, b in zip(x[keep], y[keep], strict=True)]
    marks = f'<polyline points="{" ".join(places)}" fill="none" stroke="{_LINE}"/>'
    if len(places) <= 150:
        dots = (place.split(",") for place in places)
        marks += "".join(f'<circle cx="{a}" cy="{b}" r="1.8" fill="{_LINE}"/>' for a, b in dots)
    return _framed(marks, x_axis, y_axis)


def _thinned(y: NDArray[np.float64]) -> NDArray[np.int64]:
    """Some of many values, so that every run keeps its highest and its lowest."""
    if len(y) <= _MAX_POINTS:
        return np.arange(len(y))
    runs = np.array_split(np.arange(len(y)), _MAX_POINTS // 2)
    picked = [run[[int(np.argmin(y[run])), int(np.argmax(y[run]))]] for run in runs]
    return np.unique(np.concatenate(picked))


def histogram(edges: NDArray[np.float64], shares: NDArray[np.float64], x_label: str) -> str:
    """Draw how values are spread.

    Args:
        edges: (B + 1,) of the bins, ascending.
        shares: (B,) of all values, 0 to 1.
        x_label: what is counted, with its unit.
    """
    x_axis = Axis(x_label, float(edges[0]), float(edges[-1]))
    y_axis = axis_over(100 * shares, "share of all, %", from_zero=True)
    to_x, to_y = _scales(x_axis, y_axis)
    bars = []
    for low, high, share in zip(edges[:-1], edges[1:], 100 * shares, strict=True):
        left, right, top = to_x(low) + 0.5, to_x(high) - 0.5, to_y(share)
        bars.append(
            f'<rect x="{left:.1f}" y="{top:.1f}" width="{max(right - left, 0.5):.1f}" '
            f'height="{to_y(0.0) - top:.1f}" fill="{_BAR}"/>'
        )
    return _framed("".join(bars), x_axis, y_axis)


def _scales(
    x_axis: Axis, y_axis: Axis
) -> tuple[Callable[[float], float], Callable[[float], float]]:
    def to_x(value: float) -> float:
        share = (value - x_axis.low) / (x_axis.high - x_axis.low)
        return _LEFT + share * (WIDTH - _LEFT - _RIGHT)

    def to_y(value: float) -> float:
        share = (value - y_axis.low) / (y_axis.high - y_axis.low)
        return HEIGHT - _BOTTOM - share * (HEIGHT - _TOP - _BOTTOM)

    return to_x, to_y


def _framed(marks: str, x_axis: Axis, y_axis: Axis) -> str:
    to_x, to_y = _scales(x_axis, y_axis)
    bottom, right = HEIGHT - _BOTTOM, WIDTH - _RIGHT
    parts = []
    for value, word in zip(y_axis.ticks, tick_words(y_axis.ticks), strict=True):
        y = to_y(value)
        parts.append(f'<path d="M{_LEFT} {y:.1f}H{right}" stroke="{_GRID}"/>')
        parts.append(_text(word, _LEFT - 6, y + 4, anchor="end"))
    for value, word in zip(x_axis.ticks, tick_words(x_axis.ticks), strict=True):
        x = to_x(value)
        parts.append(f'<path d="M{x:.1f} {bottom}v4" stroke="{_TEXT}"/>')
        parts.append(_text(word, x, bottom + 17))
    middle = (_TOP + bottom) / 2
    parts += [
        marks,
        f'<path d="M{_LEFT} {_TOP}V{bottom}H{right}" fill="none" stroke="{_TEXT}"/>',
        _text(x_axis.label, (_LEFT + right) / 2, HEIGHT - 8),
        f'<g transform="translate(14 {middle:.1f}) rotate(-90)">{_text(y_axis.label, 0, 0)}</g>',
    ]
    label = f"{y_axis.label} over {x_axis.label}"
    return svg("".join(parts), WIDTH, HEIGHT, label)


def tick_words(ticks: Sequence[float]) -> list[str]:
    """Write ticks with as many digits as tell them apart.

    >>> tick_words([0.0, 0.25, 0.5])
    ['0', '0.25', '0.5']
    """
    step = abs(ticks[1] - ticks[0]) if len(ticks) > 1 else 1.0
    digits = max(0, 2 - math.floor(math.log10(step))) if step else 2
    words = [f"{tick:,.{digits}f}" for tick in ticks]
    words = [word.rstrip("0").rstrip(".") if "." in word else word for word in words]
    return ["0" if word == "-0" else word for word in words]


def svg(inner: str, width: float, height: float, label: str) -> str:
    """Wrap marks into an image that says to a screen reader what it shows."""
    return (
        f'<svg viewBox="0 0 {width:g} {height:g}" role="img" aria-label="{escape(label)}" '
        f'font-family="sans-serif" font-size="12">{inner}</svg>'
    )


def _text(words: str, x: float, y: float, *, anchor: str = "middle") -> str:
    return (
        f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" fill="{_TEXT}">'
        f"{escape(words)}</text>"
    )


def track_chart(
    track_m: NDArray[np.float64], looking: NDArray[np.float64], colours: Sequence[str]
) -> str:
    """Draw a walk from above: its line from early to late, and where the camera looked.

    Args:
        track_m: (N, 2) metres, east-like and north-like of the map.
        looking: (N, 2) horizontal part of the viewing direction.
        colours: from the walk's beginning to its end.
    """
    low, high = track_m.min(axis=0), track_m.max(axis=0)
    width, margin_px = 1.4 * WIDTH, 60.0
    span_m = np.maximum(high - low, 1e-3)
    scale = min(
        (width - 2 * margin_px) / span_m[0], 420.0 / span_m[1]
    )  # pixels a metre, the same both ways
    height = max(span_m[1] * scale, 60.0) + 2 * margin_px
    centre_m = (low + high) / 2

    def place(point_m: NDArray[np.float64]) -> tuple[float, float]:
        x, y = (point_m - centre_m) * scale
        return width / 2 + float(x), height / 2 - float(y)

    keep = np.unique(np.linspace(0, len(track_m) - 1, min(len(track_m), 400)).astype(int))
    places = [place(track_m[i]) for i in keep]
    parts = [_ray(place(track_m[i]), looking[i]) for i in keep[:: max(1, len(keep) // 40)]]
    for number, ((ax, ay), (bx, by)) in enumerate(pairwise(places)):
        colour = colours[number * len(colours) // max(len(places) - 1, 1)]
        parts.append(
            f'<path d="M{ax:.1f} {ay:.1f}L{bx:.1f} {by:.1f}" stroke="{colour}" '
            'stroke-width="3.5" stroke-linecap="round"/>'
        )
    parts += _ends(places[0], places[-1])
    parts.append(_scale_bar(scale, height))
    return svg("".join(parts), width, round(height), "track of the camera in the map, from above")


def _ray(at: tuple[float, float], direction: NDArray[np.float64]) -> str:
    x, y = at
    dx, dy = 22 * float(direction[0]), -22 * float(direction[1])
    return f'<path d="M{x:.1f} {y:.1f}l{dx:.1f} {dy:.1f}" stroke="#999999"/>'


def _ends(start: tuple[float, float], end: tuple[float, float]) -> list[str]:
    (ax, ay), (bx, by) = start, end
    below, above = (ay + 22, by - 14) if ay >= by else (ay - 14, by + 22)
    ring = f'fill="#ffffff" stroke="{_TEXT}" stroke-width="2"'
    return [
        f'<circle cx="{ax:.1f}" cy="{ay:.1f}" r="6" {ring}/>',
        _text("start", ax, below),
        f'<rect x="{bx - 6:.1f}" y="{by - 6:.1f}" width="12" height="12" fill="{_TEXT}"/>',
        _text("end", bx, above),
    ]


def _scale_bar(scale: float, height: float) -> str:
    length_m = round_step(90 / scale)
    x, y, length_px = 20.0, height - 16.0, length_m * scale
    return (
        f'<path d="M{x} {y - 5}v5h{length_px:.1f}v-5" fill="none" stroke="{_TEXT}" '
        'stroke-width="2"/>' + _text(f"{length_m:g} m", x + length_px / 2, y - 8)
    )
