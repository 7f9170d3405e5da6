"""How the process of the command line ends."""

from __future__ import annotations

import subprocess
import sys

import pytest

PROGRAM = """
import sys, threading, types
sys.modules["obstore"] = types.ModuleType("obstore")  # as after a command that used it
threading.Thread(target=threading.Event().wait, daemon=True).start()
import atexit
atexit.register(lambda: print("bye"))
sys.argv = ["civil-rgbd", *sys.argv[1:]]
from civil_rgbd.__main__ import run
run()
"""


@pytest.mark.parametrize(("argument", "code"), [("recipes", 0), ("no-such-command", 2)])
def test_all_is_said_and_the_code_is_kept_when_native_threads_are_left_behind(
    argument: str, code: int
) -> None:
    command = [sys.executable, "-c", PROGRAM, argument]

    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)

    assert done.returncode == code
    assert done.stdout.endswith("bye\n")
    assert ("250k" in done.stdout) == (code == 0)
    assert ("no-such-command" in done.stderr) == (code == 2)
