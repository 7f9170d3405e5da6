"""Plots of what accumulation buys: small PNG files, colours that the colour-blind tell apart."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Final

from accumulation_scenes import Row
from accumulation_table import chosen, mean, worst

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Okabe and Ito's; lines differ in marker and dashes as well.
BLUE, ORANGE, GREEN, GREY = "#0072B2", "#D55E00", "#009E73", "#555555"
_DPI: Final = 100


@dataclass(frozen=True)
class Line:
    """One line of every panel.

    Attributes:
        label: in the legend.
        condition: keywords of :func:`accumulation_table.chosen` but for the points.
        look: colour, marker, dashes.
    """

    label: str
    condition: dict[str, object]
    look: tuple[str, str, str]


@dataclass(frozen=True)
class Panel:
    """One pair of axes, always over the number of points.

    Attributes:
        measure: of a row.
        label: with the unit.
        times: turns the measure into that unit.
        log: whether the axis is logarithmic.
    """

    measure: str
    label: str
    times: float = 1.0
    log: bool = False


@dataclass(frozen=True)
class Plot:
    """One file.

    Attributes:
        name: of the file, without suffix.
        title: above all panels.
        panels: beside each other.
        lines: of every panel; the mean of the bridges.
        worst: draw the worst bridge as well, thin and dotted.
    """

    name: str
    title: str
    panels: tuple[Panel, ...]
    lines: tuple[Line, ...]
    worst: bool = field(default=False)


COVERAGE: Final = Panel("coverage", "pixels with depth (%)", 100)
LEAK: Final = Panel("leak", "pixels that see through (%)", 100)
LEAK_LOG: Final = Panel("leak", "pixels that see through (%)", 100, log=True)
ABS_REL: Final = Panel("abs_rel", "AbsRel (%)", 100)
RMSE: Final = Panel("rmse_m", "RMSE (m)")
MEDIAN: Final = Panel("median_m", "median error (cm)", 100)
GHOST: Final = Panel("ghost", "pixels in front of what is there (%)", 100)
LOST: Final = Panel("lost", "good pixels removed (%)", 100)

_LOOKS: Final = ((BLUE, "o", "-"), (ORANGE, "s", "--"), (GREEN, "^", "-."))
_WINDOWS: Final = (("past", "before"), ("centred", "around"), ("future", "after"))

PLOTS: Final = (
    Plot(
        "points",
        "Walking 1 m/s, points before the image, exact poses",
        (COVERAGE, LEAK_LOG, ABS_REL, RMSE),
        (
            Line("as it is", {}, _LOOKS[1]),
            Line("filtered", {"filtering": "on"}, _LOOKS[0]),
            Line("filtered by twice the points", {"filtering": "twice"}, _LOOKS[2]),
        ),
        worst=True,
    ),
    Plot(
        "windows",
        "Walking 1 m/s, exact poses, as it is: points before, around and after the image",
        (COVERAGE, LEAK, ABS_REL),
        tuple(
            Line(word, {"window": window}, look)
            for (window, word), look in zip(_WINDOWS, _LOOKS, strict=True)
        ),
    ),
    Plot(
        "drift",
        "Walking 1 m/s, points before the image, filtered: exact and drifting poses",
        (MEDIAN, ABS_REL, LEAK),
        tuple(
            Line(label, {"filtering": "on", "drift": drift}, look)
            for (label, drift), look in zip(
                (
                    ("exact poses", "none"),
                    ("1 cm and 0.02° a root second", "usual"),
                    ("3 cm and 0.06° a root second", "poor"),
                ),
                _LOOKS,
                strict=True,
            )
        ),
    ),
    Plot(
        "still",
        "Standing and walking, points before the image, usual drift, as it is",
        (COVERAGE, LEAK, MEDIAN),
        (
            Line("walking", {"drift": "usual"}, _LOOKS[1]),
            Line("standing", {"drift": "usual", "motion": "still"}, _LOOKS[0]),
        ),
    ),
    Plot(
        "traffic",
        "Cars and people move, points before the image, exact poses",
        (GHOST, LEAK, LOST),
        (
            Line("walking, as it is", {"traffic": "moving"}, (ORANGE, "s", "--")),
            Line("walking, filtered", {"traffic": "moving", "filtering": "on"}, (ORANGE, "s", "-")),
            Line("standing, as it is", {"traffic": "moving", "motion": "still"}, (BLUE, "o", "--")),
            Line(
                "standing, filtered",
                {"traffic": "moving", "motion": "still", "filtering": "on"},
                (BLUE, "o", "-"),
            ),
        ),
    ),
)


def draw_plots(rows: Sequence[Row], folder: Path) -> Iterator[Path]:
    """Draw every plot; yield where each lies."""
    # Not pyplot: it keeps figures alive and asks for a screen.
    from matplotlib.figure import Figure

    for plot in PLOTS:
        figure = Figure(figsize=(3.1 * len(plot.panels), 3.5), dpi=_DPI, layout="constrained")
        figure.suptitle(plot.title, fontsize=10)
        every = figure.subplots(1, len(plot.panels), squeeze=False)[0]
        for axes, panel in zip(every, plot.panels, strict=True):
            _draw(axes, panel, plot, rows)
        handles, labels = every[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=5, fontsize=9)
        path = folder / f"{plot.name}.png"
        # No version of matplotlib in it: the same numbers give the same file.
        figure.savefig(path, metadata={"Software": None})
        yield path


def _draw(axes: Axes, panel: Panel, plot: Plot, rows: Sequence[Row]) -> None:
    points = sorted({row.points for row in rows})
    for line in plot.lines:
        if panel.measure == "lost" and "filtering" not in line.condition:
            continue  # nothing is removed
        colour, marker, dashes = line.look
        found = [chosen(rows, points=count, **line.condition) for count in points]  # type: ignore[arg-type]  # by name
        counts = [count for count, some in zip(points, found, strict=True) if some]
        found = [some for some in found if some]
        means = [panel.times * mean(some, panel.measure) for some in found]
        axes.plot(counts, means, marker=marker, ls=dashes, color=colour, ms=4.5, label=line.label)
        if plot.worst:
            label = "worst bridge" if line is plot.lines[0] else None
            extremes = [panel.times * worst(some, panel.measure)[1] for some in found]
            axes.plot(counts, extremes, ls=":", lw=1, color=colour, label=label)
    axes.set_xscale("log")
    axes.set_xticks(points, [short_count(count) for count in points], fontsize=8)
    axes.minorticks_off()
    axes.set_xlabel("points of a frame", fontsize=9)
    axes.set_title(panel.label, fontsize=9)
    axes.tick_params(axis="y", labelsize=8)
    if panel.log:
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter("{x:g}")
    else:
        axes.set_ylim(bottom=0)
    axes.grid(alpha=0.3)


def short_count(points: int) -> str:
    """Write 250000 as 250k and 2000000 as 2M.

    >>> short_count(250_000), short_count(2_000_000)
    ('250k', '2M')
    """
    return f"{points // 1_000_000}M" if points >= 1_000_000 else f"{points // 1000}k"
