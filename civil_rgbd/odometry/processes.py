"""Runs another program: with a time limit, its words kept, and nothing of it left behind."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import IO, Final

from civil_rgbd.errors import OdometryError

Tick = Callable[[float], object]
"""Called now and then with the seconds that a program has been running."""

_POLL_S: Final = 0.2
_GRACE_S: Final = 5.0
_TAIL_LINES: Final = 15
# What would make another Python find our packages, or paint its words.
_LEFT_OUT: Final = ("PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV", "FORCE_COLOR")


def run_program(
    command: Sequence[str | Path],
    *,
    what: str,
    folder: Path,
    timeout_s: float,
    fix: str,
    on_tick: Tick = lambda _seconds: None,
) -> str:
    """Run a program to its end.

    Args:
        command: program and arguments.
        what: names it in errors: ``"genz-lio 0.1.1"``.
        folder: where it runs.
        timeout_s: it is stopped after this.
        fix: what to do when it fails.
        on_tick: called a few times a second.

    Returns:
        the last lines that it printed.

    Raises:
        OdometryError: it cannot start, fails, is killed, or takes too long. Whatever it started
            is stopped as well, also when we are interrupted.
    """
    environment = {name: value for name, value in os.environ.items() if name not in _LEFT_OUT}
    environment |= {"NO_COLOR": "1", "TERM": "dumb", "COLUMNS": "120", "PYTHONUNBUFFERED": "1"}
    with tempfile.TemporaryFile() as words:
        try:
            process = subprocess.Popen(  # noqa: S603  # the command is ours, no shell reads it
                [str(part) for part in command],
                cwd=folder,
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=words,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
        except OSError as error:
            raise OdometryError(
                f"{what} cannot start: {error.strerror or error}", where=command[0], fix=fix
            ) from error
        try:
            code = _wait(process, timeout_s, on_tick)
        finally:
            _stop(process)
        tail = _tail(words)
    if code is None:
        raise OdometryError(
            f"{what} was stopped: it ran longer than {timeout_s:.0f} s\n{tail}",
            where=command[0],
            fix="allow more with --timeout-s, or give a shorter recording",
        )
    if code != 0:
        ended = f"was killed by signal {-code}" if code < 0 else f"failed with exit code {code}"
        raise OdometryError(f"{what} {ended}; its last words:\n{tail}", where=command[0], fix=fix)
    return tail


def _wait(process: subprocess.Popen[bytes], timeout_s: float, on_tick: Tick) -> int | None:
    started = time.monotonic()
    while True:
        seconds = time.monotonic() - started
        on_tick(seconds)
        if seconds > timeout_s:
            return None
        with contextlib.suppress(subprocess.TimeoutExpired):
            return process.wait(timeout=min(_POLL_S, max(timeout_s - seconds, 0.01)))


def _stop(process: subprocess.Popen[bytes]) -> None:
    """End the program and its children, if any are left: politely, then for good."""
    if sys.platform == "win32":
        if process.poll() is None:
            process.kill()
            process.wait()
        return
    for sign in (signal.SIGTERM, signal.SIGKILL):
        with contextlib.suppress(ProcessLookupError, PermissionError):  # nobody of it is left
            os.killpg(process.pid, sign)
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(timeout=_GRACE_S)


def _tail(words: IO[bytes]) -> str:
    size = words.seek(0, os.SEEK_END)
    words.seek(max(0, size - 20_000))
    lines = words.read().decode("utf-8", errors="replace").replace("\r", "\n").splitlines()
    kept = [line.rstrip() for line in lines if line.strip()]
    return "\n".join(f"    | {line}" for line in kept[-_TAIL_LINES:]) or "    | (nothing)"
