"""Frames to train with: chosen by a split, changed at random, the same for the same seed."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial
from pathlib import Path
from typing import Any

import torch
from torch import Tensor
from torch.utils.data import DataLoader, Dataset

from civil_rgbd.dataset import BridgeDataset
from civil_rgbd.dataset.augmentations import RandomColour, RandomRoll, RandomZoom
from civil_rgbd.dataset.transforms import (
    Compose,
    RandomCrop,
    RandomHorizontalFlip,
    Sample,
    Transform,
    resize,
)
from civil_rgbd.dataset.warps import to_camera
from civil_rgbd.domain.split import FramesOf
from civil_rgbd.errors import UsageError
from civil_rgbd.training.order import Place, seed_of
from civil_rgbd.training.recipe import AugmentStage, InputStage, TrainingRecipe

Batch = dict[str, Any]
"""``image`` (B, 3, h, w) uint8, ``depth`` (B, 1, h, w) float32 metres, ``valid`` (B, 1, h, w) bool:
what is trained with, ``intrinsics`` (B, 3, 3) float32, ``names`` a list of B str."""


class TrainingFrames(Dataset[Batch]):
    """The frames of a split's training set, by epoch and number.

    The random changes of a frame follow from seed, epoch and number alone: neither workers nor a
    restart change them.

    Args:
        data: a dataset folder, or one bridge folder.
        frames: frame ids by bridge.
        recipe: how they are changed.
        seed: of the changes.

    Raises:
        UsageError: a bridge or frame is not there.
        FormatError: a document breaks the format.
    """

    def __init__(self, data: Path, frames: FramesOf, recipe: TrainingRecipe, *, seed: int) -> None:
        self._data = BridgeDataset(data, bridges=list(frames), frames=frames)
        self._seed = seed
        self._input = recipe.input
        self._prepare = Compose(*_preparations(recipe.input))
        self._change = Compose(*_changes(recipe.augment))
        self._crop: Transform | None = None

    @property
    def prepared_px(self) -> tuple[int, int]:
        """Height and width of the smallest images after resizing, before the crop."""
        sizes = [_prepared_size(size, self._input) for size in self._data.sizes_px.values()]
        return min(height for height, _ in sizes), min(width for _, width in sizes)

    def crop_to_multiples(self, side_multiple: int) -> tuple[int, int]:
        """Crop to the recipe's size, or the most that the model takes; return height and width.

        Args:
            side_multiple: sides of what comes out are multiples of this, in pixels.

        Raises:
            UsageError: an image is smaller than that.
        """
        height, width = self.prepared_px
        crop_height = _crop_side(height, self._input.crop_height_px, side_multiple)
        crop_width = _crop_side(width, self._input.crop_width_px, side_multiple)
        if min(crop_height, crop_width) < 1:
            raise UsageError(
                f"the images are {width} x {height} px, and the model takes multiples of "
                f"{side_multiple} px",
                where="input",
                fix="train with larger images: --set input.width_px=0",
            )
        self._crop = RandomCrop(width_px=crop_width, height_px=crop_height)
        return crop_height, crop_width

    def __len__(self) -> int:
        """Count the frames."""
        return len(self._data)

    def __getitem__(self, place: Place) -> Sample:
        """Decode one frame and change it."""
        with torch.random.fork_rng(devices=[]):
            torch.default_generator.manual_seed(seed_of(self._seed, place))
            sample = self._prepare(self._data[place[1]])
            sample = self._change(sample)
            sample = self._crop(sample) if self._crop else sample
        depth = sample["depth"]
        within = (depth > self._input.min_depth_m) & (depth < self._input.max_depth_m)
        return {
            "image": sample["image"],
            "depth": depth,
            "valid": sample["valid"] & within,
            "intrinsics": sample["intrinsics"],
            "names": f"{sample['bridge']}/{sample['frame']}",
        }


def _preparations(stage: InputStage) -> list[Transform]:
    steps: list[Transform] = []
    if stage.camera:
        width, height, fx, fy, cx, cy = stage.camera
        K = torch.tensor([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
        steps.append(partial(to_camera, width_px=int(width), height_px=int(height), K=K))
    if stage.width_px:
        steps.append(partial(_at_most_as_wide, width_px=stage.width_px))
    return steps


def _prepared_size(size: tuple[int, int], stage: InputStage) -> tuple[int, int]:
    height, width = size
    if stage.camera:
        width, height = int(stage.camera[0]), int(stage.camera[1])
    if stage.width_px and width > stage.width_px:
        height, width = max(1, round(height * stage.width_px / width)), stage.width_px
    return height, width


def _at_most_as_wide(sample: Sample, *, width_px: int) -> Sample:
    height, width = sample["image"].shape[-2:]
    new = _prepared_size((height, width), InputStage(width_px=width_px))
    return resize(sample, height_px=new[0], width_px=new[1]) if new != (height, width) else sample


def _changes(stage: AugmentStage) -> list[Transform]:
    steps: list[Transform] = []
    if stage.roll_deg:
        steps.append(RandomRoll(stage.roll_deg))
    if stage.zoom > 1:
        steps.append(RandomZoom(stage.zoom, keep_camera=stage.zoom_keeps_camera))
    if stage.flip:
        steps.append(RandomHorizontalFlip(stage.flip))
    if stage.colour and stage.colour_share:
        steps.append(RandomColour(stage.colour, stage.colour_share))
    return steps


def _crop_side(side: int, wanted: int, multiple: int) -> int:
    return min(side, wanted or side) // multiple * multiple


def load_batches(
    frames: TrainingFrames, batches: Iterable[list[Place]], *, workers: int
) -> DataLoader[Batch]:
    """Return a loader of the given batches, in their order.

    Args:
        frames: the training set.
        batches: what to load.
        workers: processes that decode; 0 decodes in this one. They change no pixel.
    """
    return DataLoader(
        frames,
        batch_sampler=batches,
        num_workers=workers,
        collate_fn=_collated,
        # A generator of its own: the loader must not draw from the one that a checkpoint restores.
        generator=torch.Generator().manual_seed(0),
    )


def _collated(samples: list[Sample]) -> Batch:
    tensors: dict[str, Tensor] = {
        name: torch.stack([sample[name] for sample in samples])
        for name in ("image", "depth", "valid", "intrinsics")
    }
    return {**tensors, "names": [sample["names"] for sample in samples]}
