"""Other programs: their last words, their time, and nothing of them left running."""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path

import pytest

from civil_rgbd.errors import OdometryError
from civil_rgbd.odometry.processes import run_program


def run(folder: Path, code: str, timeout_s: float = 20.0) -> str:
    return run_program(
        [sys.executable, "-c", code], what="the engine", folder=folder, timeout_s=timeout_s, fix="x"
    )


def test_the_last_words_come_back(tmp_path: Path) -> None:
    said = run(tmp_path, "import os; print('a'); print(os.getcwd())")

    assert said == f"    | a\n    | {os.path.realpath(tmp_path)}"


def test_a_failure_says_the_code_and_what_was_on_stderr(tmp_path: Path) -> None:
    with pytest.raises(OdometryError, match=r"(?s)exit code 3.*no such topic"):
        run(tmp_path, "import sys; sys.stderr.write('no such topic'); sys.exit(3)")


@pytest.mark.skipif(os.name == "nt", reason="Windows knows no signals")
def test_a_killed_program_is_said_to_be_killed(tmp_path: Path) -> None:
    with pytest.raises(OdometryError, match="was killed by signal 9"):
        run(tmp_path, "import os, signal; os.kill(os.getpid(), signal.SIGKILL)")


@pytest.mark.skipif(os.name == "nt", reason="process groups are POSIX")
def test_who_takes_too_long_is_stopped_with_all_it_started(tmp_path: Path) -> None:
    child = "import os, time; open('pid', 'w').write(str(os.getpid())); time.sleep(60)"
    code = f"import subprocess, sys; subprocess.run([sys.executable, '-c', {child!r}])"
    started = time.monotonic()

    with pytest.raises(OdometryError, match="ran longer than 1 s") as info:
        run(tmp_path, code, timeout_s=1.0)

    assert time.monotonic() - started < 10
    assert "--timeout-s" in info.value.fix
    pid = int((tmp_path / "pid").read_text())
    assert not _runs(pid)


def _runs(pid: int) -> bool:
    for _ in range(50):
        try:
            os.kill(pid, 0)
            state = Path(f"/proc/{pid}/stat")
            if state.exists() and state.read_text().rpartition(")")[2].split()[0] == "Z":
                return False
        except ProcessLookupError:
            return False
        time.sleep(0.1)
    return True


def test_a_program_that_is_not_there_is_said_so(tmp_path: Path) -> None:
    with pytest.raises(OdometryError, match="the engine cannot start: No such file"):
        run_program(
            [tmp_path / "missing"], what="the engine", folder=tmp_path, timeout_s=5, fix="x"
        )


def test_our_own_packages_are_not_forced_upon_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))

    assert "None" in run(tmp_path, "import os; print(os.environ.get('PYTHONPATH'))")
