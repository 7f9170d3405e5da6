"""Small models and images; torch on one thread."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from civil_rgbd.geometry.camera import PinholeCamera


@pytest.fixture(autouse=True)
def one_thread() -> Iterator[None]:
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    torch.manual_seed(0)
    yield
    torch.set_num_threads(before)


@pytest.fixture
def camera() -> PinholeCamera:
    """Sides that are no multiples of anything."""
    return PinholeCamera(75, 50, 40.0, 41.0, 37.0, 24.5)


@pytest.fixture
def rgb(camera: PinholeCamera) -> NDArray[np.uint8]:
    size = (camera.height_px, camera.width_px, 3)
    return np.random.default_rng(1).integers(0, 256, size, dtype=np.uint8)


@pytest.fixture
def batch() -> tuple[torch.Tensor, torch.Tensor]:
    """Two images of 64 x 96 px in 0 to 1, and their intrinsics."""
    generator = torch.Generator().manual_seed(2)
    K = torch.tensor([[50.0, 0.0, 47.5], [0.0, 50.0, 31.5], [0.0, 0.0, 1.0]])
    return torch.rand(2, 3, 64, 96, generator=generator), K.repeat(2, 1, 1)
