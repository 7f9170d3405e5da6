"""How long the command line takes to start, beside Python itself.

    python benchmarks/startup.py [--dataset FOLDER]

CPU seconds of a process, user and system, the best of several, in turns. ``--help`` may cost at
most 8 times `python -c pass`, ``info`` of a built bridge at most 20 times.
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

TURNS = 15
LIMITS = {"--help": 8.0, "info": 20.0}


def main() -> int:
    """Measure, print, and return 1 when a limit is broken."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--dataset", help="look at this one and build none")
    given = parser.parse_args().dataset
    program = str(Path(sys.executable).with_name("civil-rgbd"))
    with tempfile.TemporaryDirectory() as folder:
        if not given:
            build = ("--recipe", "demo", "--workers", "1", "--out", folder)
            subprocess.run([program, "build", *build], check=True, capture_output=True)
        commands: dict[str, Sequence[str]] = {
            "python -c pass": [sys.executable, "-c", "pass"],
            "--help": [program, "--help"],
            "info": [program, "info", given or folder],
        }
        best = dict.fromkeys(commands, float("inf"))
        for _ in range(TURNS):
            for name, command in commands.items():
                best[name] = min(best[name], _cpu_seconds(command))
    python = best["python -c pass"]
    print(f"python -c pass {1e3 * python:8.1f} ms of CPU, best of {TURNS}")
    for name, limit in LIMITS.items():
        ratio = best[name] / python
        print(f"{name:<14} {1e3 * best[name]:8.1f} ms, {ratio:4.1f} times (at most {limit:g})")
    return int(any(best[name] > limit * python for name, limit in LIMITS.items()))


def _cpu_seconds(command: Sequence[str]) -> float:
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


if __name__ == "__main__":
    sys.exit(main())
