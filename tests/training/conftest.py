"""Three small bridges that a small network can learn: the brighter, the further."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from civil_rgbd.domain.frame import RgbdFrame
from civil_rgbd.domain.split import Split
from civil_rgbd.geometry.camera import PinholeCamera
from civil_rgbd.geometry.transforms import transform_from
from civil_rgbd.training.recipe import TrainingRecipe
from civil_rgbd.training.recipe_files import load_training_recipe

from ..dataset.conftest import write_bridge

CAMERA = PinholeCamera(96, 64, 70.0, 70.0, 47.5, 31.5)
START_NS = 1_700_000_000_000_000_000
FRAMES = 6


@pytest.fixture(autouse=True)
def _one_thread() -> None:
    torch.set_num_threads(1)


def learnable_frame(bridge: int, number: int) -> RgbdFrame:
    """Depth 2 to 20 m as a smooth surface, sparse; grey values tell it."""
    rng = np.random.default_rng([bridge, number])
    v, u = np.mgrid[0:64, 0:96]
    depth = 9 + 5 * np.sin(u / 96 * 3 + rng.uniform(0, 6)) + 3 * np.cos(v / 64 * 2 + bridge)
    rgb = np.repeat((depth * 10)[..., None], 3, axis=2) + rng.normal(0, 2, (64, 96, 3))
    depth_m = np.where(rng.random(depth.shape) < 0.4, depth, 0).astype(np.float32)
    return RgbdFrame(
        source_index=number,
        stamp_ns=START_NS + number * 100_000_000,
        source_stamp_ns=START_NS + number * 100_000_000,
        rgb=np.clip(rgb, 0, 255).astype(np.uint8),
        depth_m=depth_m,
        camera=CAMERA,
        T_map_camera=transform_from(np.eye(3), [0.5 * number, 0.0, 0.0]),
    )


def write_learnable(folder: Path, frames: int = FRAMES) -> Path:
    """A dataset of bridges B1, B2 and B3."""
    for bridge in (1, 2, 3):
        some = [learnable_frame(bridge, number) for number in range(frames)]
        write_bridge(folder / "bridges" / f"B{bridge}", some)
    return folder


@pytest.fixture(scope="session")
def learnable(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Bridges B1, B2 and B3 of six frames each; read only."""
    return write_learnable(tmp_path_factory.mktemp("training") / "data")


def ids(*numbers: int) -> tuple[str, ...]:
    return tuple(f"{number:06d}" for number in numbers)


SPLIT = Split(
    train={"B1": ids(*range(FRAMES)), "B2": ids(*range(FRAMES))},
    tests={"all": {"B3": ids(*range(FRAMES))}},
)

TINY = (
    "model_options.features=16",
    "run.batch=4",
    "run.norm_batches=2",
    "run.checkpoint_every=3",
)


def tiny_recipe(*settings: str) -> TrainingRecipe:
    """BTS small with the fewest features: a step takes some hundredths of a second."""
    return load_training_recipe("bts-small", [*TINY, *settings])
