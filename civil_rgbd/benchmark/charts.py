"""Charts of a benchmark as SVG: errors over shots, and over range."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

from civil_rgbd.benchmark.protocol import APART, REMAINDER, SAME
from civil_rgbd.benchmark.table import TableRow
from civil_rgbd.errors import MissingExtraError
from civil_rgbd.evaluation.metrics import label_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_STYLES: Final = {SAME: "-", REMAINDER: "--", APART: ":"}
_SIZE_IN: Final = (10.0, 3.8)
_LONGEST_LABEL: Final = 28  # letters


def require_matplotlib() -> None:
    """Refuse to draw without matplotlib.

    Raises:
        MissingExtraError: it is not installed.
    """
    try:
        import matplotlib as mpl  # noqa: F401  # only whether it is there
    except ImportError as error:
        raise MissingExtraError(
            f"matplotlib cannot be imported: {error}",
            where="benchmark",
            fix='pip install "civil-rgbd[train]"',
        ) from error


def shots_chart(rows: Sequence[TableRow]) -> str:
    """Draw AbsRel over shots, a line a model and set of frames; bars are deviations over seeds."""
    figure, axes = _figure()
    metric = next(iter(rows[0].scores[SAME]["per_image"]))
    for number, model in enumerate(dict.fromkeys(row.model for row in rows)):
        own = [row for row in rows if row.model == model]
        for test, line in _STYLES.items():
            spreads = [row.scores[test]["per_image"][metric] for row in own]
            kept = [(row.shots, one) for row, one in zip(own, spreads, strict=True) if one.values]
            errors = [0.0 if math.isnan(one.deviation) else one.deviation for _, one in kept]
            axes.errorbar(
                [shots for shots, _ in kept],
                [one.mean for _, one in kept],
                yerr=errors if test == SAME else None,
                fmt=f"o{line}",
                color=f"C{number}",
                capsize=3,
                label=f"{_short(model)}, {test}",
            )
    axes.set_xlabel("shots: frames of the test bridge among the training frames")
    axes.set_ylabel(label_of(metric))
    return _svg(figure, axes)


def range_chart(rows: Sequence[TableRow], ranges: Sequence[dict[str, float | None]]) -> str:
    """Draw AbsRel by range of true depth, pooled over pixels, a line a row of the table.

    Args:
        rows: of the table.
        ranges: for each row, AbsRel by name of the range; None where nothing was measured.
    """
    figure, axes = _figure()
    for row, values in zip(rows, ranges, strict=True):
        axes.plot(
            list(values),
            [math.nan if value is None else value for value in values.values()],
            marker="o",
            label=f"{_short(row.model)}, {row.shots} shots",
        )
    axes.set_xlabel("true depth")
    axes.set_ylabel("AbsRel, pixels pooled")
    return _svg(figure, axes)


def _short(model: str) -> str:
    """Return the end of a long name: a path in a legend would leave no room for the axes.

    >>> _short("runs/cells/bts-small/seed-0/shots-20/model.pt")
    '.../seed-0/shots-20/model.pt'
    """
    return model if len(model) <= _LONGEST_LABEL else "..." + model[-(_LONGEST_LABEL - 3) :]


def _figure() -> tuple[Figure, Axes]:
    require_matplotlib()
    # Not pyplot: it keeps figures alive and asks for a screen.
    from matplotlib.figure import Figure

    figure = Figure(figsize=_SIZE_IN, layout="constrained")
    return figure, figure.add_subplot()


def _svg(figure: Figure, axes: Axes) -> str:
    import matplotlib as mpl

    axes.set_ylim(bottom=0)
    axes.grid(alpha=0.3)
    axes.legend(fontsize="small", loc="center left", bbox_to_anchor=(1.0, 0.5))
    text = io.StringIO()
    # No date and a fixed salt: the same numbers give the same page.
    with mpl.rc_context({"svg.hashsalt": "civil_rgbd"}):
        figure.savefig(text, format="svg", metadata={"Date": None})
    svg = text.getvalue()
    return svg[svg.index("<svg") :]
