"""A small simulated scan and a recipe that suits it, for all tests of the builder."""

from __future__ import annotations

from pathlib import Path

import pytest

from civil_rgbd.builder.recipes import load_recipe
from civil_rgbd.domain.bridge import BridgeInfo
from civil_rgbd.domain.recipe import Recipe
from civil_rgbd.simulator.recording import SimulatedRecording
from civil_rgbd.simulator.spec import ScanSpec

INFO = BridgeInfo("B9", licence="CC0-1.0")


@pytest.fixture(scope="session")
def recording() -> SimulatedRecording:
    return SimulatedRecording(
        ScanSpec(seconds=3.0, image_scale=0.1, point_rate_hz=12_000, image_rate_hz=15.0)
    )


@pytest.fixture(scope="session")
def recipe() -> Recipe:
    return load_recipe("250k", ["accumulate.points=8000"])


def contents(folder: Path) -> dict[str, bytes]:
    """Every file below a folder, by relative path."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }
