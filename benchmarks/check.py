"""``civil-rgbd check`` on planted faults: how many are found, how many clean recordings flagged.

``python benchmarks/check.py [--variants N] [--only CODE]... [--jobs N] [--folder FOLDER]``
``python benchmarks/check.py --table [--into-docs] [--folder FOLDER]``

12 base recordings are simulated once (20 s each, with sensors that turn at more than 0.2 rad/s RMS
with changing sign, and one that does not) and kept in the folder. Each variant edits the messages
of one of them (``tests/planted.py``), at no less than twice the limit, and is opened and checked
anew, as ``civil-rgbd check`` does: for the planted code; harmless edits, and everything in the
recording whose sensors do not turn, for all codes. Every result is a line of ``results.jsonl``
there as soon as it is known: a run that was stopped goes on where it was, and results of another
version of the checks are taken anew. ``--table`` prints what is known so far, without running
anything; ``--into-docs`` writes it into ``docs/tutorials/check_a_recording.md``.

The whole of it, every fault and the harmless edits, 200 variants each, takes about an hour of two
cores.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import multiprocessing
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any, Final

import check_table as report
import cv2
import numpy as np
from measured_code import measuring_key

from civil_rgbd.builder.recipes import load_recipe
from civil_rgbd.cli.check import gather
from civil_rgbd.domain.recording import RecordingOptions
from civil_rgbd.health.check import check_recording
from civil_rgbd.health.check_report import CheckReport
from civil_rgbd.health.checks import CHECKS
from civil_rgbd.resources import cache_folder
from civil_rgbd.simulator.recorder import write_recording
from civil_rgbd.simulator.spec import ScanSpec, usual_spec

ROOT: Final = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))
planted: Any = import_module("tests.planted")
faults: Any = import_module("tests.recording_faults")

CLEAN: Final = report.CLEAN
MEMORY: Final = Path("/dev/shm")  # noqa: S108  # a disk in memory, where there is one
NEEDS_TURNING: Final = ("time-offset", "extrinsics")
DEPENDS_ON: Final = (
    "civil_rgbd/health",
    "civil_rgbd/odometry/surfaces.py",
    "civil_rgbd/trajectories",
    "conversion",
    "tests/planted.py",
    "tests/recording_faults.py",
)


@dataclass(frozen=True)
class Base:
    """A recording to plant faults in."""

    name: str
    spec: ScanSpec
    turns: bool = True


def bases() -> list[Base]:
    """Return 12 recordings: five bridges and the demo, two walks each."""
    found = []
    for walk, sway in enumerate((2.0, 3.0)):
        for number, bridge in enumerate(("B1", "B3", "B5", "B2", "B4")):
            spec = replace(
                usual_spec(bridge), seconds=20.0, image_scale=0.5, image_rate_hz=15.0,
                stands_s=1.0, sway=sway, seed=10 * walk + number, scene_seed=walk,
            )  # fmt: skip
            found.append(Base(f"{bridge}-{walk}", spec))
    for name, sway in (("demo-turning", 2.0), ("demo-still", 0.2)):
        spec = ScanSpec(
            seconds=20.0, image_scale=0.5, image_rate_hz=15.0, range_noise_m=0.02, sway=sway,
            speed_m_s=0.8,
        )  # fmt: skip
        found.append(Base(name, spec, turns=sway > 1))
    return found


def recording_of(base: Base, folder: Path) -> Path:
    """Simulate a base recording, once."""
    path = folder / f"{base.name}-{base.spec.sha256()[:12]}.mcap"
    if not path.exists():
        start = time.perf_counter()
        write_recording(path, base.spec)
        print(f"simulated {path.name} in {time.perf_counter() - start:.0f} s", flush=True)
    return path


def measure(path: Path, codes: tuple[str, ...]) -> dict[str, Any]:
    """Check one recording, for some codes."""
    wall, used = time.perf_counter(), time.process_time()
    given, said = gather((str(path),), RecordingOptions(source_hash=False))
    figures = check_recording(given, load_recipe("250k"), codes)
    lacks = tuple(finding for finding in said if finding.level == "error")
    told = CheckReport(path.stem, 0.0, figures, lacks=lacks)
    offset = next((f for f in figures if f.code == "time-offset"), None)
    turn = next((f for f in figures if f.code == "extrinsics"), None)
    stamps_ns = given.recording.scan_stamps_ns
    return {
        "seconds": float(stamps_ns.max() - stamps_ns.min()) / 1e9,
        "found": [finding.code for finding in (*told.found, *told.missing)],
        "offset": None if offset is None or offset.value is None else offset.detail,
        "turn": None if turn is None or turn.value is None else turn.detail,
        "processor_s": time.process_time() - used,
        "wall_s": time.perf_counter() - wall,
    }


@cache
def in_memory(path: Path) -> Any:  # noqa: ANN401  # what the tests' module gives
    """Read a base recording once."""
    return faults.contents_of(path)


def run_variant(base: Base, code: str, number: int, folder: Path) -> dict[str, Any]:
    """Plant one variant of a fault, and check it."""
    path = recording_of(base, folder)
    extent, contents = faults.extent_of(path), in_memory(path)
    # The name, not its hash of this process: the same variant in every run.
    seed = int.from_bytes(hashlib.sha256(f"{base.name}/{code}/{number}".encode()).digest()[:8])
    plant = planted.clean if code == CLEAN else planted.FAULTS[code]
    variant = plant(extent, np.random.default_rng(seed))
    with tempfile.TemporaryDirectory(dir=MEMORY if MEMORY.is_dir() else None) as scratch:
        edited = faults.rewrite(contents, Path(scratch) / "variant.mcap", variant.edit)
        # A figure does not depend on the others (a test holds it): a variant asks for its own.
        codes = (*CHECKS,) if code == CLEAN or not base.turns else (code,)
        return {"planted": variant.planted, "whole": len(codes) > 1, **measure(edited, codes)}


def jobs(every: list[Base], codes: list[str], variants: int) -> Iterator[tuple[str, int, Base]]:
    """Yield the variants, all faults in turn: a run that is stopped says something of all."""
    for number in range(variants):
        for code in codes:
            fitting = [base for base in every if base.turns or code not in NEEDS_TURNING]
            yield code, number, fitting[number % len(fitting)]


def taken(job: tuple[str, int, Base, Path, str]) -> dict[str, Any]:
    """Run one variant, as a row of the results."""
    code, number, base, folder, now = job
    cv2.setNumThreads(1)
    row = {"version": now, "code": code, "number": number, "base": base.name, "turns": base.turns}
    return row | run_variant(base, code, number, folder)


def known_rows(results: Path, now: str) -> list[dict[str, Any]]:
    """Read the results of this version; a line that was cut off is none."""
    rows = []
    for line in results.read_text().splitlines() if results.exists() else []:
        try:
            row = json.loads(line)
        except json.JSONDecodeError:
            continue
        if row["version"] == now:
            rows.append(row)
    return rows


def run_missing(
    jobs_left: list[tuple[str, int, Base, Path, str]], results: Path, processes: int
) -> Iterator[dict[str, Any]]:
    """Run variants, and write down each as soon as it is known."""
    with (
        multiprocessing.get_context("spawn").Pool(processes) as pool,
        results.open("a") as stream,
    ):
        for row in pool.imap_unordered(taken, jobs_left):
            stream.write(json.dumps(row) + "\n")
            stream.flush()
            hit = "clean" if row["code"] == CLEAN else "found"
            if row["code"] != CLEAN and row["code"] not in row["found"]:
                hit = "MISSED"
            print(f"{row['code']:20} {row['base']:14} {hit:7} {','.join(row['found'])}", flush=True)
            yield row


def main() -> None:
    """Run what is missing, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--variants", type=int, default=200)
    parser.add_argument("--only", action="append", choices=[CLEAN, *planted.FAULTS])
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    parser.add_argument("--folder", type=Path, default=cache_folder() / "benchmarks" / "check")
    parser.add_argument("--table", action="store_true", help="run nothing, print what is known")
    parser.add_argument("--into-docs", action="store_true", help="write the table into the docs")
    asked = parser.parse_args()
    asked.folder.mkdir(parents=True, exist_ok=True)
    codes = asked.only or [CLEAN, *planted.FAULTS]
    every, results, now = (
        bases(),
        asked.folder / "results.jsonl",
        measuring_key("check", ("check",), more=DEPENDS_ON),
    )
    rows = known_rows(results, now)
    if not asked.table:
        for base in every:
            recording_of(base, asked.folder)
        done = {(row["code"], row["number"], row["base"]) for row in rows}
        left = [
            (code, number, base, asked.folder, now)
            for code, number, base in jobs(every, codes, asked.variants)
            if (code, number, base.name) not in done
        ]
        rows += run_missing(left, results, asked.jobs)
    lines = report.table(rows, [CLEAN, *planted.FAULTS])
    print("\n".join(lines))
    if asked.into_docs:
        report.into_page(lines, ROOT / "docs" / "tutorials" / "check_a_recording.md")


if __name__ == "__main__":
    main()
