"""``python -m civil_rgbd`` and the command ``civil-rgbd``."""

from __future__ import annotations

import sys

from civil_rgbd.cli import main

if __name__ == "__main__":
    sys.exit(main())
