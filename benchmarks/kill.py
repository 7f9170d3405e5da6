"""Kill a build thirty times at random moments, and compare what it ends with.

    python benchmarks/kill.py [--kills 30] [--executor processes] [--seconds 12]
    python benchmarks/kill.py --parts 4        # jobs of an array, and the one that joins them

A scan is simulated and built once without interruption. Then the same build is started again and
again, killed (SIGKILL) after a random part of its time, and in the end left alone. Prints how many
kills hit which stage, and whether all bytes are equal. With --parts each kill hits one of the jobs
of an array, drawn at random: a part (`build --chunk I/N`), or the end (`finish`).
"""

from __future__ import annotations

import argparse
import hashlib
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

PROGRAM = str(Path(sys.executable).with_name("civil-rgbd"))


def main() -> int:
    """Parse, run, print; 1 when any byte differs."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kills", type=int, default=30)
    parser.add_argument("--executor", choices=["serial", "processes", "dask"], default="processes")
    parser.add_argument("--seconds", type=float, default=12.0, help="length of the scan")
    parser.add_argument("--parts", type=int, help="kill jobs of an array of so many parts")
    given = parser.parse_args()
    if given.parts and given.executor == "dask":
        parser.error("a job of an array runs on one machine: no --parts with dask")
    manner = f"{given.executor}, {given.parts} parts" if given.parts else given.executor
    dice = random.Random(manner)  # noqa: S311  # no secret
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        scan = ["--seconds", str(given.seconds), "--image-scale", "0.2", "--image-rate-hz", "30"]
        _run(["simulate", *scan, "--point-rate-hz", "48000", str(folder / "scan.mcap")])
        recipe = ["--recipe", "250k-all", "--set", "accumulate.points=20000"]
        build = ["build", *recipe, "--executor", given.executor, str(folder / "scan.mcap"), "--out"]
        _run([*build, str(folder / "reference")])
        started = time.monotonic()
        timed = folder / "timed"
        for job in _jobs([*build, str(timed)], timed, given.parts):
            _run(job)
        whole_s = time.monotonic() - started
        stages: Counter[str] = Counter()
        jobs = _jobs([*build, str(folder / "out")], folder / "out", given.parts)
        same, wanted = True, _hashes(folder / "reference")
        for _ in range(given.kills):
            job = dice.choice(jobs)
            stages[_kill(job, folder / "out", dice, whole_s / len(jobs))] += 1
            if (folder / "out/bridges/scan").exists():
                _run(job)  # whatever the kill left is cleared away
                same = same and _hashes(folder / "out") == wanted
        for job in jobs:
            _run(job)
        same = same and _hashes(folder / "out") == wanted
        frames = len(list((folder / "out").rglob("*.exr")))
    print(f"{manner}: {frames} frames, {whole_s:.1f} s without interruption")
    print(f"{given.kills} kills: " + ", ".join(f"{n} {stage}" for stage, n in stages.most_common()))
    print("all bytes equal" if same else "BYTES DIFFER")
    return 0 if same else 1


def _jobs(build: list[str], out: Path, parts: int | None) -> list[list[str]]:
    """Say what makes a bridge: one build, or the jobs of an array in order."""
    if not parts:
        return [build]
    chunks = [[*build, "--chunk", f"{number}/{parts}"] for number in range(1, parts + 1)]
    return [*chunks, ["finish", str(out)]]


def _run(arguments: Sequence[str]) -> None:
    subprocess.run([PROGRAM, *arguments], check=True, stdout=subprocess.DEVNULL)


def _kill(job: Sequence[str], out: Path, dice: random.Random, job_s: float) -> str:
    """Kill one job at a random moment of its time; return in which stage it was."""
    bridge = out / "bridges/scan"
    if bridge.exists():  # one came through: begin anew
        shutil.rmtree(out)
    before = len(list(out.glob(".partial/scan/done/*.json")))
    process = subprocess.Popen(
        [PROGRAM, *job], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    time.sleep(dice.uniform(0.0, job_s))
    process.kill()
    ended = process.wait()
    time.sleep(0.2)  # workers notice within milliseconds
    if bridge.exists():
        return "after it had appeared"
    if job[0] == "finish":
        return "while the parts were joined" if ended < 0 else "after it had found parts missing"
    made = len(list(out.glob(".partial/scan/done/*.json")))
    if made > before:
        return "after chunks of its own"
    return "before its first chunk"


def _hashes(folder: Path) -> dict[str, str]:
    return {
        path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in folder.rglob("*")
        if path.is_file()
    }


if __name__ == "__main__":
    sys.exit(main())
