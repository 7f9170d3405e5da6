"""``python -m civil_rgbd`` and the command ``civil-rgbd``."""

from __future__ import annotations

import atexit
import contextlib
import os
import sys
from typing import NoReturn

from civil_rgbd.cli import main


def run() -> NoReturn:
    """Run the command line and leave the process with its exit code."""
    code = main()
    if "obstore" in sys.modules:
        # Its native threads now and then abort an interpreter that takes itself apart beneath them,
        # after all work is done: everything that an exit owes is paid here, and the rest left out.
        atexit._run_exitfuncs()  # noqa: SLF001  # no public way to run them early
        for stream in (sys.stdout, sys.stderr):
            with contextlib.suppress(OSError, ValueError):  # its reader may be gone
                stream.flush()
        os._exit(code)
    sys.exit(code)


if __name__ == "__main__":
    run()
