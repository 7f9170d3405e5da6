"""Engines that are not: programs in an environment of their own that answer as a test wants."""

from __future__ import annotations

import sys
from pathlib import Path

from civil_rgbd.odometry.engines import Engine


def fake_environment(
    folder: Path, engine: Engine, code: str, *, version: str | None = None
) -> Path:
    """Make a folder that looks like a Python environment with the engine in it.

    Args:
        folder: where.
        engine: which one.
        code: Python; ``out`` is the folder for its answer, ``truth`` a TUM text.
        version: that it claims; None is the one that was tried.

    Returns:
        the folder.
    """
    programs = folder / "bin"
    programs.mkdir(parents=True)
    python = programs / "python"
    python.write_text(f"#!/bin/sh\nprintf '%s' '{version or engine.version}'\n")
    program = programs / engine.program
    flags = "('--output', '--log_dir')"
    program.write_text(
        f"#!{sys.executable}\nimport sys\nfrom pathlib import Path\n"
        f"out = Path(next(b for a, b in zip(sys.argv, sys.argv[1:]) if a in {flags}))\n"
        f"truth = Path({str(folder / 'truth.tum')!r}).read_text()\n{code}\n"
    )
    for path in (python, program):
        path.chmod(0o755)
    return folder
