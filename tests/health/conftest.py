"""A short simulated walk on disk, with sensors that turn left and right."""

from __future__ import annotations

from pathlib import Path

import pytest

from civil_rgbd.simulator.recorder import write_recording
from civil_rgbd.simulator.spec import ScanSpec


@pytest.fixture(scope="session")
def turning_walk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Nine seconds past the demo's bridge, small images, few points: written once, read by many."""
    path = tmp_path_factory.mktemp("walks") / "walk.mcap"
    spec = ScanSpec(
        seconds=9.0,
        image_scale=0.3,
        image_rate_hz=10.0,
        point_rate_hz=60_000,
        range_noise_m=0.02,
        sway=3.0,
        speed_m_s=0.8,
    )
    write_recording(path, spec)
    return path
