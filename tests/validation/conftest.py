"""The golden dataset, and copies of it to break."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

GOLDEN = Path(__file__).resolve().parents[1] / "data" / "format_v1"


@pytest.fixture
def golden() -> Path:
    """The golden dataset; read only."""
    return GOLDEN


@pytest.fixture
def golden_copy(tmp_path: Path) -> Path:
    """A copy of the golden dataset, without what made it."""
    copy = tmp_path / "golden"
    shutil.copytree(GOLDEN, copy, ignore=shutil.ignore_patterns("make.py", "__pycache__"))
    return copy
