"""``civil-rgbd check`` on planted faults: how many are found, how many clean recordings flagged.

``python benchmarks/check.py [--bases N] [--variants N] [--only CODE]... [--folder FOLDER]``

Base recordings are simulated once (20 s each, sensors that turn at more than 0.2 rad/s RMS with
changing sign, and some that do not turn at all) and kept in the folder. Each variant edits the
messages of one of them (``tests/planted.py``), at no less than twice the limit. Every result is a
line of ``results.jsonl`` there as soon as it is known: a run that was stopped goes on where it was,
and results of another version of the checks are taken anew.

The whole of it takes some five hours on one core: 12 base recordings, 19 faults and the clean ones,
200 variants each. The figures as last measured, and of how many variants, are in
``docs/tutorials/check_a_recording.md``.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import Any, Final

import numpy as np

from civil_rgbd.builder.recipes import load_recipe
from civil_rgbd.cli.check import gather
from civil_rgbd.domain.recording import RecordingOptions
from civil_rgbd.health.check import check_recording
from civil_rgbd.health.check_report import CheckReport
from civil_rgbd.resources import cache_folder
from civil_rgbd.simulator.recorder import write_recording
from civil_rgbd.simulator.spec import ScanSpec, usual_spec

ROOT: Final = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))
planted: Any = import_module("tests.planted")
faults: Any = import_module("tests.recording_faults")

CLEAN: Final = "clean"
NEEDS_TURNING: Final = ("time-offset", "extrinsics")
DEPENDS_ON: Final = (
    "civil_rgbd/health",
    "benchmarks/check.py",
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


def version() -> str:
    """Return a hash of everything that a result depends on, apart from the recordings."""
    digest = hashlib.sha256()
    for place in DEPENDS_ON:
        path = ROOT / place
        for file in sorted(path.rglob("*.py")) if path.is_dir() else [path]:
            digest.update(file.read_bytes())
    return digest.hexdigest()[:16]


def recording_of(base: Base, folder: Path) -> Path:
    """Simulate a base recording, once."""
    path = folder / f"{base.name}-{base.spec.sha256()[:12]}.mcap"
    if not path.exists():
        start = time.perf_counter()
        write_recording(path, base.spec)
        print(f"simulated {path.name} in {time.perf_counter() - start:.0f} s", flush=True)
    return path


def measure(path: Path) -> dict[str, Any]:
    """Check one recording."""
    wall, used = time.perf_counter(), time.process_time()
    given, said = gather((str(path),), RecordingOptions(source_hash=False))
    figures = check_recording(given, load_recipe("250k"))
    lacks = tuple(finding for finding in said if finding.level == "error")
    report = CheckReport(path.stem, 0.0, figures, lacks=lacks)
    offset = next((f for f in figures if f.code == "time-offset"), None)
    turn = next((f for f in figures if f.code == "extrinsics"), None)
    return {
        "found": [finding.code for finding in (*report.found, *report.missing)],
        "offset": None if offset is None or offset.value is None else offset.detail,
        "turn": None if turn is None or turn.value is None else turn.detail,
        "processor_s": time.process_time() - used,
        "wall_s": time.perf_counter() - wall,
    }


def run_variant(base: Base, code: str, number: int, folder: Path) -> dict[str, Any]:
    """Plant one variant of a fault, and check it."""
    path = recording_of(base, folder)
    extent = faults.extent_of(path)
    # The name, not its hash of this process: the same variant in every run.
    seed = int.from_bytes(hashlib.sha256(f"{base.name}/{code}/{number}".encode()).digest()[:8])
    plant = planted.clean if code == CLEAN else planted.FAULTS[code]
    variant = plant(extent, np.random.default_rng(seed))
    with tempfile.TemporaryDirectory(dir=folder) as scratch:
        edited = faults.rewrite(path, Path(scratch) / "variant.mcap", variant.edit)
        return {"planted": variant.planted, "seconds": extent.seconds, **measure(edited)}


def jobs(every: list[Base], codes: list[str], variants: int) -> Iterator[tuple[str, int, Base]]:
    """Yield the variants, all faults in turn: a run that is stopped says something of all."""
    for number in range(variants):
        for code in codes:
            fitting = [base for base in every if base.turns or code not in NEEDS_TURNING]
            yield code, number, fitting[number % len(fitting)]


def errors_of(rows: list[dict[str, Any]]) -> tuple[list[float], list[float]]:
    """Return how far off time offsets (ms) and turns (deg) are, where a number was given."""
    offsets = [
        abs(float(row["offset"].split()[0]) - row["planted"]["offset_ms"])
        for row in rows
        if row["code"] == "time-offset" and row["offset"]
    ]
    turns = []
    for row in rows:
        if row["code"] == "extrinsics" and row["turn"]:
            words = row["turn"].replace(",", "").split()
            said = np.array([float(words[words.index(axis) + 1]) for axis in "xyz"])
            off = said - np.array(row["planted"]["turn_deg"])
            turns.append(float(np.sqrt((off**2).sum())))
    return offsets, turns


def table(rows: list[dict[str, Any]], codes: list[str]) -> Iterator[str]:
    """Say how many were found."""
    yield f"{'fault':20} variants  found"
    for code in codes:
        of_code = [row for row in rows if row["code"] == code]
        hits = [row for row in of_code if (row["found"] if code == CLEAN else code in row["found"])]
        yield f"{code:20} {len(of_code):8} {len(hits):6}{' flagged' if code == CLEAN else ''}"
    for name, unit, off in zip(
        ("time offset", "turn"), ("ms", "deg"), errors_of(rows), strict=True
    ):
        if off:
            yield (
                f"{name}: {len(off)} numbers, error 90th percentile {np.quantile(off, 0.9):.2f} "
                f"{unit}, largest {max(off):.2f}"
            )
    if rows:
        share = [row["processor_s"] / row["seconds"] for row in rows]
        yield f"processor time / length of recording: median {np.median(share):.3f}"


def main() -> None:
    """Run what is missing, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--bases", type=int, default=len(bases()))
    parser.add_argument("--variants", type=int, default=200)
    parser.add_argument("--only", action="append", choices=[CLEAN, *planted.FAULTS])
    parser.add_argument("--folder", type=Path, default=cache_folder() / "benchmarks" / "check")
    asked = parser.parse_args()
    asked.folder.mkdir(parents=True, exist_ok=True)
    codes = asked.only or [CLEAN, *planted.FAULTS]
    every, results, now = bases()[: asked.bases], asked.folder / "results.jsonl", version()
    known = (
        [json.loads(line) for line in results.read_text().splitlines()] if results.exists() else []
    )
    rows = [row for row in known if row["version"] == now]
    done = {(row["code"], row["number"], row["base"]) for row in rows}
    for code, number, base in jobs(every, codes, asked.variants):
        if (code, number, base.name) in done:
            continue
        row = {"version": now, "code": code, "number": number, "base": base.name}
        row |= run_variant(base, code, number, asked.folder)
        rows.append(row)
        with results.open("a") as stream:
            stream.write(json.dumps(row) + "\n")
        hit = "clean" if code == CLEAN else ("found" if code in row["found"] else "MISSED")
        print(f"{code:20} {base.name:14} {hit:7} {','.join(row['found'])}", flush=True)
    shown = [row for row in rows if row["base"] in {base.name for base in every}]
    print("\n".join(table(shown, codes)))


if __name__ == "__main__":
    main()
