"""What accumulation buys: coverage and error of depth made of 25,000 to 2,000,000 points.

    python benchmarks/accumulation.py [--scratch FOLDER] [--quick --out FOLDER]

Five simulated bridges, walked past and looked at from where one stands, with exact and with
drifting poses, with and without traffic; windows before, around and after the image; with and
without the filter of ``250k-clean``. Writes ``docs/accumulation/conditions.csv`` (a row a condition
and bridge), the plots beside it, and the tables of ``docs/accumulation.md``: some fifteen minutes
of one core. Scenes that are finished stay in the scratch folder, and are not measured again until
the simulator, the pipeline, a recipe or the measuring changes. ``--quick`` tries it out, and
touches no page. ``--page-only`` draws plots and tables of the CSV that is there.

Plots ask for ``pip install "civil-rgbd[bench]"``.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from typing import Final

sys.path.insert(0, str(Path(__file__).resolve().parent))
from accumulation_page import renew_tables
from accumulation_plots import draw_plots
from accumulation_scenes import QUICK, Effort, Row, Scene, measured, scenes
from accumulation_table import read_rows, write_rows
from measured_code import measuring_key

from civil_rgbd.resources import cache_folder

DOCS: Final = Path(__file__).resolve().parents[1] / "docs"
CSV_NAME: Final = "conditions.csv"


def finished(scene: Scene, effort: Effort, scratch: Path) -> list[Row]:
    """Measure a scene, or read what was measured before."""
    key = measuring_key(repr((scene, effort)), _MEASURING)
    path = scratch / f"{scene.bridge}-{scene.motion}-{key}.json"
    if not path.exists():
        scratch.mkdir(parents=True, exist_ok=True)
        rows = [asdict(row) for row in measured(scene, effort)]
        partial = path.with_suffix(".partial")
        partial.write_text(json.dumps(rows), encoding="utf-8")
        partial.replace(path)
    stored = json.loads(path.read_text(encoding="utf-8"))
    return [Row(**(row | {"scene": Scene(**row["scene"])})) for row in stored]


_MEASURING: Final = ("accumulation_scenes", "visibility", "visibility_scenes")


def all_rows(effort: Effort, scratch: Path) -> Iterable[Row]:
    """Measure every scene, and say how far it is."""
    todo = scenes(effort)
    for number, scene in enumerate(todo, 1):
        started = time.process_time()
        yield from finished(scene, effort, scratch)
        words = f"{scene.bridge} {scene.motion}, traffic {scene.traffic}, drift {scene.drift}"
        took_s = time.process_time() - started
        print(f"{number:>3} of {len(todo)}: {words} ({took_s:.0f} s)", file=sys.stderr)


def main(arguments: list[str] | None = None) -> int:
    """Measure, write, draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scratch", type=Path, default=cache_folder() / "accumulation")
    parser.add_argument("--out", type=Path, default=DOCS / "accumulation")
    parser.add_argument("--quick", action="store_true", help="one bridge, few conditions, no page")
    parser.add_argument("--page-only", action="store_true", help="measure nothing")
    given = parser.parse_args(arguments)
    if given.quick and given.out == DOCS / "accumulation":
        parser.error("--quick wants an --out of its own: the page's figures stay as they are")
    given.out.mkdir(parents=True, exist_ok=True)
    table = given.out / CSV_NAME
    if not given.page_only:
        write_rows(table, list(all_rows(QUICK if given.quick else Effort(), given.scratch)))
    rows = read_rows(table)
    for plot in draw_plots(rows, given.out):
        print(plot)
    if not given.quick:
        print(renew_tables(DOCS / "accumulation.md", rows))
    return 0


if __name__ == "__main__":
    sys.exit(main())
