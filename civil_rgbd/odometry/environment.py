"""Where engines are installed: each in a Python environment of its own, made only on request."""

from __future__ import annotations

import os
import shutil
import sys
from pathlib import Path
from typing import Final

from civil_rgbd.errors import MissingExtraError, OutputError
from civil_rgbd.odometry.engines import Engine
from civil_rgbd.odometry.processes import Tick, run_program

_WHOLE: Final = "whole"
"""A file in an environment of ours that says: the installation reached its end."""

_PROBE_S: Final = 60.0
_CREATE_S: Final = 1800.0
_PROBE: Final = "import importlib.metadata as m, sys; sys.stdout.write(m.version(sys.argv[1]))"


def environment_folder(cache: Path, engine: Engine) -> Path:
    """Return where an engine's environment lies: one a version, as versions answer differently.

    >>> from civil_rgbd.odometry.engines import ENGINES
    >>> environment_folder(Path("cache"), ENGINES["rko-lio"]).as_posix()
    'cache/engines/rko-lio-0.4.0'
    """
    return cache / "engines" / f"{engine.name}-{engine.version}"


def find_program(engine: Engine, folder: Path) -> Path:
    """Return the engine's program, after asking its environment for the version.

    Args:
        engine: which one.
        folder: a Python environment: ours, or one that the user names.

    Raises:
        MissingExtraError: it is not there, not whole, or of another version; says how to get it.
    """
    program, python = _executable(folder, engine.program), _executable(folder, "python")
    if not program.exists() or not python.exists():
        raise _missing(engine, folder, f"{engine.name} is not installed")
    if _is_ours(folder) and not (folder / _WHOLE).exists():
        raise _missing(engine, folder, f"the installation of {engine.name} was cut short")
    found = run_program(
        [python, "-I", "-c", _PROBE, engine.name],
        what=f"the Python of {engine.name}",
        folder=folder,
        timeout_s=_PROBE_S,
        fix=_how_to_install(engine, folder),
    )
    version = found.removeprefix("    | ").strip()
    if version != engine.version:
        raise _missing(
            engine, folder, f"{engine.name} {version} is installed, {engine.version} was tried"
        )
    return program


def create_environment(
    engine: Engine, folder: Path, *, on_tick: Tick = lambda _seconds: None
) -> None:
    """Make a Python environment and install the engine's exact version into it with pip.

    Args:
        engine: which one.
        folder: where; what an earlier, unfinished attempt left there is removed first.
        on_tick: called while pip works.

    Raises:
        OutputError: something else lies there, or the folder cannot be written.
        OdometryError: pip fails; its words are in the error, and the folder is gone again.
    """
    if folder.exists() and not _is_ours(folder):
        raise OutputError(
            "the folder exists and is no environment of ours",
            where=folder,
            fix="name another folder with --environment, or remove this one",
        )
    fix = f"check the network and try again, or by hand: {_by_hand(engine, folder)}"
    try:
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        _ours(folder).write_text(f"{engine.name} {engine.version}\n", encoding="utf-8")
        steps: tuple[list[str | Path], ...] = (
            [sys.executable, "-m", "venv", str(folder)],
            [_executable(folder, "python"), "-m", "pip", "install", *_PIP, *engine.requirements],
        )
        for command in steps:
            run_program(
                command,
                what=f"installing {engine.name} {engine.version}",
                folder=folder,
                timeout_s=_CREATE_S,
                fix=fix,
                on_tick=on_tick,
            )
        (folder / _WHOLE).touch()
    except OSError as error:
        raise OutputError(
            f"cannot make an environment: {error.strerror or error}",
            where=folder,
            fix="free some space, or name another folder with --environment",
        ) from error
    finally:
        if not (folder / _WHOLE).exists():
            shutil.rmtree(folder, ignore_errors=True)


_PIP: Final = ("--disable-pip-version-check", "--no-input", "--quiet")


def _ours(folder: Path) -> Path:
    return folder / "civil_rgbd_engine.txt"


def _is_ours(folder: Path) -> bool:
    return _ours(folder).exists()


def _executable(folder: Path, name: str) -> Path:
    return folder / "Scripts" / f"{name}.exe" if os.name == "nt" else folder / "bin" / name


def _missing(engine: Engine, folder: Path, what: str) -> MissingExtraError:
    return MissingExtraError(
        f"{what} (it runs as a program of its own, licence {engine.licence}, and is no dependency)",
        where=folder,
        fix=_how_to_install(engine, folder),
    )


def _how_to_install(engine: Engine, folder: Path) -> str:
    return f"add --create-environment, or by hand: {_by_hand(engine, folder)}"


def _by_hand(engine: Engine, folder: Path) -> str:
    wanted = " ".join(f'"{requirement}"' for requirement in engine.requirements)
    python = _executable(folder, "python")
    return f'`python -m venv "{folder}"` and `"{python}" -m pip install {wanted}`'
