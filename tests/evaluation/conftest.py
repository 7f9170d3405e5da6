"""Two bridges whose frames can be predicted exactly: depth is coded in the image."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from civil_rgbd.domain.frame import RgbdFrame

from ..dataset.conftest import b1_frames, b3_frames, write_bridge


def coded(frame: RgbdFrame) -> RgbdFrame:
    """The frame with quarter metres of depth as grey values: a model can read them off."""
    quarters = np.clip(np.round(frame.depth_m * 4), 0, 255)
    rgb = np.repeat(quarters[..., np.newaxis], 3, axis=2).astype(np.uint8)
    return replace(frame, rgb=rgb, depth_m=(quarters / 4).astype(np.float32))


@pytest.fixture(scope="session")
def coded_data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dataset of B1 (six frames) and B3 (four); read only."""
    folder = tmp_path_factory.mktemp("scoring") / "kitchener"
    write_bridge(folder / "bridges" / "B1", [coded(frame) for frame in b1_frames()])
    write_bridge(folder / "bridges" / "B3", [coded(frame) for frame in b3_frames()])
    return folder
