"""One HTML page a benchmark, of itself alone: table, curves, predictions beside truth."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from statistics import mean
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.benchmark.cells import Cell, model_of, split_of
from civil_rgbd.benchmark.charts import range_chart, shots_chart
from civil_rgbd.benchmark.notes import caption, notes
from civil_rgbd.benchmark.pictures import depth_uri, error_scale_uri, error_uri, photo_uri
from civil_rgbd.benchmark.protocol import SAME, TESTS
from civil_rgbd.benchmark.table import TableRow
from civil_rgbd.benchmark.table_files import table_cells
from civil_rgbd.domain.frame import FrameRow
from civil_rgbd.evaluation.frames import open_bridges
from civil_rgbd.evaluation.results import RESULTS
from civil_rgbd.evaluation.run import predict_row
from civil_rgbd.format.reader import Bridge

SHOWN_FRAMES: Final = 3

_STYLE: Final = """
body { font: 15px/1.45 system-ui, sans-serif; color: #222; background: #fff; margin: 0 auto;
  max-width: 1250px; padding: 1.5rem; }
h2 { font-size: 1.2rem; margin-top: 2rem; border-top: 1px solid #ccc; padding-top: .6rem; }
table { border-collapse: collapse; font-size: .8rem; font-variant-numeric: tabular-nums; }
th, td { padding: .2rem .4rem; text-align: right; border-bottom: 1px solid #eee; }
th { vertical-align: bottom; } td { white-space: nowrap; }
th:first-child, td:first-child { text-align: left; }
td:first-child { white-space: normal; overflow-wrap: anywhere; min-width: 8rem; max-width: 15rem; }
td:nth-child(n+10) { white-space: normal; }
p { overflow-wrap: anywhere; }
.failed { border-left: .4rem solid #c00; padding-left: .6rem; } .wide { overflow-x: auto; }
svg { max-width: 100%; height: auto; }
.row { display: grid; grid-template-columns: 9rem repeat(auto-fit, minmax(8rem, 1fr)); gap: 4px;
  align-items: center; margin-bottom: 4px; overflow-wrap: anywhere; } .row small { color: #555; }
img { width: 100%; display: block; image-rendering: pixelated; }
.scale { width: 12rem; height: .8rem; display: inline-block; vertical-align: middle; }
"""


def benchmark_page(cells: Sequence[Cell], rows: Sequence[TableRow], test_bridge: str) -> str:
    """Return the page of a finished benchmark; the same results give the same page.

    Args:
        cells: those that are done; pictures are of the first seed's.
        rows: of the table.
        test_bridge: id of the bridge that was left out.

    Raises:
        FormatError: an image is damaged.
        MissingExtraError: matplotlib is not installed.
    """
    title = f"Depth on bridge {test_bridge}, unseen and with some of its frames"
    with_scores, seed = [row for row in rows if row.seeds], cells[0].request.seed
    parts = [
        f"<h1>{escape(title)}</h1>",
        *_failures(rows),
        _table(rows, test_bridge),
        "<h2>AbsRel over shots</h2>",
        shots_chart(with_scores),
        "<h2>AbsRel by range, on the same frames</h2>",
        range_chart(with_scores, [_ranges(row, cells) for row in with_scores]),
        f"<h2>Predictions and AbsRel, seed {seed}</h2>",
        _legend(),
        *_predictions([cell for cell in cells if cell.request.seed == seed]),
        "<h2>What each number rests on</h2>",
        *_details(cells),
        *(f"<p>{escape(note)}</p>" for note in notes(rows)),
    ]
    body = "\n".join(parts)
    return (
        '<!doctype html>\n<html lang="en">\n<head><meta charset="utf-8">'
        f"<title>{escape(title)}</title><style>{_STYLE}</style></head>\n<body>\n{body}\n</body>\n"
        "</html>\n"
    )


def _failures(rows: Sequence[TableRow]) -> Iterator[str]:
    for row in rows:
        for seed, cause in row.failed.items():
            yield (
                f'<p class="failed">{escape(row.model)}, {row.shots} shots, seed {seed} failed: '
                f"{escape(cause)}</p>"
            )


def _legend() -> str:
    return (
        f'<p>AbsRel per pixel: 0 <img class="scale" src="{error_scale_uri()}" alt="dark blue to '
        'red"> 100 % and more; grey where nothing was measured. Depth by its logarithm: '
        "light is near, and each frame has its own range.</p>"
    )


def _table(rows: Sequence[TableRow], test_bridge: str) -> str:
    head, body = table_cells(rows)
    return (
        f'<div class="wide">{_html_table([head, *body])}</div>'
        f"<p>{escape(caption(rows, test_bridge))}</p>"
    )


def _html_table(lines: Sequence[Sequence[str]]) -> str:
    head = "".join(f"<th>{escape(cell)}</th>" for cell in lines[0])
    body = "".join(
        "<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in cells) + "</tr>"
        for cells in lines[1:]
    )
    return f"<table><tr>{head}</tr>{body}</table>"


def _ranges(row: TableRow, cells: Sequence[Cell]) -> dict[str, float | None]:
    """AbsRel by range of one row of the table, mean over seeds."""
    own = [c for c in cells if (c.name, c.request.shots) == (row.model, row.shots)]
    spans = [
        json.loads((cell.folder / RESULTS).read_text("utf-8"))["tests"][SAME]["ranges"]
        for cell in own
    ]
    return {name: _mean_of(spans, name) for name in spans[0]}


_COUNTED: Final = ("clamped_low", "clamped_high", "prediction_nan", "prediction_infinite")


def _details(cells: Sequence[Cell]) -> Iterator[str]:
    """What was scored in each cell, what was not as it came, and the hash of its split."""
    settings = [setting for cell in cells for setting in cell.settings]
    yield f"<p>Settings: {escape(', '.join(dict.fromkeys(settings)) or 'none')}.</p>"
    head = ["Model", "seed", "shots", *(f"frames {test}" for test in TESTS), "pixels same"]
    lines = [[*head, *(name.replace("_", " ") for name in _COUNTED), "split"]]
    for cell in cells:
        document = json.loads((cell.folder / RESULTS).read_text("utf-8"))
        counts = {test: document["tests"][test]["counts"] for test in TESTS}
        frames = [one["images"] - one["images_skipped"] for one in counts.values()]
        same = [counts[SAME][name] for name in ("pixels", *_COUNTED)]
        numbers = map(str, (cell.request.seed, cell.request.shots, *frames, *same))
        lines.append([cell.name, *numbers, document["split"]["sha256"][:12]])
    yield f'<div class="wide">{_html_table(lines)}</div>'


def _mean_of(spans: Sequence[Mapping[str, Any]], name: str) -> float | None:
    values = [next(iter(span[name]["pooled"].values())) for span in spans]
    known = [value for value in values if value is not None]
    return mean(known) if known else None


def _predictions(cells: Sequence[Cell]) -> Iterator[str]:
    first = cells[0]
    test = first.request.test_bridge
    bridge = open_bridges(first.data, [test])[test]
    frames = _spread_out(split_of(first).tests[SAME][test])
    rows = {row.frame_id: row for row in bridge.rows}
    shown = [_Shown(bridge, rows[frame]) for frame in frames]
    yield _line("image", [photo_uri(one.rgb) for one in shown])
    yield _words([one.words for one in shown])
    yield _line("truth", [depth_uri(one.depth_m, one.near_far_m) for one in shown])
    for cell in cells:
        model = model_of(cell)
        answers = [predict_row(model, bridge, test, one.row, flip=cell.flip) for one in shown]
        name = f"{cell.name}, {cell.request.shots} shots"
        pairs = list(zip(answers, shown, strict=True))
        yield _line(name, [depth_uri(depth, one.near_far_m) for depth, one in pairs])
        yield _line(f"{name}: AbsRel", [error_uri(depth, one.depth_m) for depth, one in pairs])


class _Shown:
    """A frame that is shown, with the depths of its colours."""

    def __init__(self, bridge: Bridge, row: FrameRow) -> None:
        self.row = row
        self.rgb: NDArray[np.uint8] = bridge.read_rgb(row)
        self.depth_m: NDArray[np.float32] = bridge.read_depth(row)
        known = self.depth_m[self.depth_m > 0]
        near, far = np.percentile(known, [1, 99]) if len(known) else (1.0, 80.0)
        self.near_far_m = (float(near), max(float(far), float(near) * math.e))

    @property
    def words(self) -> str:
        """Which frame it is, and what its colours mean."""
        near_m, far_m = self.near_far_m
        return f"frame {self.row.frame_id}: light {near_m:.1f} m, dark {far_m:.1f} m"


def _spread_out(frames: Sequence[str]) -> list[str]:
    places = np.linspace(0, len(frames) - 1, min(SHOWN_FRAMES, len(frames)) + 2)[1:-1]
    return [frames[round(place)] for place in places.tolist()]


def _words(words: Sequence[str]) -> str:
    return (
        f'<div class="row"><span></span>{"".join(f"<small>{one}</small>" for one in words)}</div>'
    )


def _line(name: str, uris: Sequence[str]) -> str:
    images = "".join(f'<img src="{uri}" alt="{escape(name)}">' for uri in uris)
    return f'<div class="row"><span>{escape(name)}</span>{images}</div>'
