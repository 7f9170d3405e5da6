"""Kill a build thirty times at random moments, and compare what it ends with.

    python benchmarks/kill.py [--kills 30] [--executor processes] [--seconds 12]

A scan is simulated and built once without interruption. Then the same build is started again and
again, killed (SIGKILL) after a random part of its time, and in the end left alone. Prints how many
kills hit which stage, how many frames each next start found made, and whether all bytes are equal.
"""

from __future__ import annotations

import argparse
import hashlib
import random
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
    given = parser.parse_args()
    dice = random.Random(given.executor)  # noqa: S311  # no secret
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        scan = ["--seconds", str(given.seconds), "--image-scale", "0.2", "--image-rate-hz", "30"]
        _run(["simulate", *scan, "--point-rate-hz", "48000", str(folder / "scan.mcap")])
        recipe = ["--recipe", "250k-all", "--set", "accumulate.points=20000"]
        build = ["build", *recipe, "--executor", given.executor, str(folder / "scan.mcap"), "--out"]
        started = time.monotonic()
        _run([*build, str(folder / "reference")])
        whole_s = time.monotonic() - started
        stages: Counter[str] = Counter()
        for _ in range(given.kills):
            stages[_kill([*build, str(folder / "out")], folder / "out", dice, whole_s)] += 1
        _run([*build, str(folder / "out")])
        same = _hashes(folder / "out") == _hashes(folder / "reference")
        frames = len(list((folder / "out").rglob("*.exr")))
    print(f"{given.executor}: {frames} frames, {whole_s:.1f} s without interruption")
    print(f"{given.kills} kills: " + ", ".join(f"{n} {stage}" for stage, n in stages.most_common()))
    print("all bytes equal" if same else "BYTES DIFFER")
    return 0 if same else 1


def _run(arguments: Sequence[str]) -> None:
    subprocess.run([PROGRAM, *arguments], check=True, stdout=subprocess.DEVNULL)


def _kill(build: Sequence[str], out: Path, dice: random.Random, whole_s: float) -> str:
    """Kill one build at a random moment; return in which stage it was."""
    bridge = out / "bridges/scan"
    if bridge.exists():  # one came through: begin anew
        subprocess.run(["rm", "-rf", str(out)], check=True)  # noqa: S607  # by PATH
    before = len(list(out.glob(".partial/scan/done/*.json")))
    process = subprocess.Popen(
        [PROGRAM, *build], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    time.sleep(dice.uniform(0.0, whole_s))
    process.kill()
    process.wait()
    time.sleep(0.2)  # workers notice within milliseconds
    if bridge.exists():
        return "after it had appeared"
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
