"""Crops, flips and resizes of a sample that move the camera along.

Each is a pure function: it returns a new sample and leaves the given one as it was. All work on
samples of :class:`~civil_rgbd.dataset.BridgeDataset` and on windows of
:class:`~civil_rgbd.dataset.BridgeSequenceDataset`: whatever stands before the last axes is kept,
and every frame of a window is treated alike. Keys that are not touched are handed on.

Pixel (0, 0) is a pixel's centre, so a resize follows ``cx' = (cx + 0.5) s - 0.5``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor
from torch.nn import functional

from civil_rgbd.errors import UsageError

Sample = dict[str, Any]
Transform = Callable[[Sample], Sample]

_PLANES = ("image", "depth", "valid")


def over_planes(
    sample: Sample, change: Callable[[Tensor], Tensor], *, names: tuple[str, ...] = _PLANES
) -> Sample:
    """Return the planes of a sample, changed: those named, and all of ``quality`` where it is.

    Args:
        sample: as the datasets give it.
        change: of (..., H, W) tensors.
        names: of planes.
    """
    changed: Sample = {name: change(sample[name]) for name in names}
    if "quality" in sample:
        changed["quality"] = {name: change(plane) for name, plane in sample["quality"].items()}
    return changed


@dataclass(frozen=True, slots=True, init=False)
class Compose:
    """Apply transforms one after another.

    >>> from functools import partial
    >>> smaller = Compose(partial(resize, width_px=384, height_px=216), flip_horizontally)
    >>> len(smaller.transforms)
    2
    """

    transforms: tuple[Transform, ...]

    def __init__(self, *transforms: Transform) -> None:
        object.__setattr__(self, "transforms", transforms)

    def __call__(self, sample: Sample) -> Sample:
        """Return the sample after all transforms."""
        for transform in self.transforms:
            sample = transform(sample)
        return sample


def crop(sample: Sample, *, left_px: int, top_px: int, width_px: int, height_px: int) -> Sample:
    """Cut a window out of image, depth and valid; the principal point moves along.

    Args:
        sample: as the datasets give it.
        left_px: first column that stays.
        top_px: first row that stays.
        width_px: columns that stay.
        height_px: rows that stay.

    Returns:
        A new sample whose planes are (..., height_px, width_px).

    Raises:
        UsageError: the window is empty or reaches over the image's edge.
    """
    height, width = sample["image"].shape[-2:]
    right_px, bottom_px = left_px + width_px, top_px + height_px
    if not (0 <= left_px < right_px <= width and 0 <= top_px < bottom_px <= height):
        raise UsageError(
            f"the crop of {width_px} x {height_px} px at ({left_px}, {top_px}) "
            f"does not lie in the image of {width} x {height} px",
            where=_place(sample),
            fix="choose a window inside the image, or resize before cropping",
        )
    cropped = over_planes(
        sample, lambda plane: plane[..., top_px:bottom_px, left_px:right_px].contiguous()
    )
    K = sample["intrinsics"].clone()
    K[..., 0, 2] -= left_px
    K[..., 1, 2] -= top_px
    return {**sample, **cropped, "intrinsics": K}


def resize(sample: Sample, *, width_px: int, height_px: int) -> Sample:
    """Scale to a new size: the image is filtered, other planes take the nearest pixel.

    Depth is never averaged: between a pier and the wall behind it there is no surface. Each new
    pixel takes the depth of the old pixel under its centre, so depth may lie up to half an old
    pixel off; the camera is exact.

    Args:
        sample: as the datasets give it.
        width_px: new number of columns.
        height_px: new number of rows.

    Returns:
        A new sample whose planes are (..., height_px, width_px).

    Raises:
        UsageError: the new size has no pixels.
    """
    if min(width_px, height_px) < 1:
        raise UsageError(
            f"the new size has no pixels: {width_px} x {height_px}",
            where=_place(sample),
            fix="give a width_px and a height_px of at least 1",
        )
    height, width = sample["image"].shape[-2:]
    rows, columns = _nearest_centres(height, height_px), _nearest_centres(width, width_px)
    sx, sy = width_px / width, height_px / height
    K = sample["intrinsics"].clone()
    K[..., 0, 0] *= sx
    K[..., 1, 1] *= sy
    K[..., 0, 2] = (K[..., 0, 2] + 0.5) * sx - 0.5
    K[..., 1, 2] = (K[..., 1, 2] + 0.5) * sy - 0.5
    picked = over_planes(
        sample,
        lambda plane: plane.index_select(-2, rows).index_select(-1, columns),
        names=("depth", "valid"),
    )
    image = _filtered(sample["image"], width_px=width_px, height_px=height_px)
    return {**sample, **picked, "image": image, "intrinsics": K}


def flip_horizontally(sample: Sample) -> Sample:
    """Mirror image, depth and valid left to right; ``cx' = width - 1 - cx``.

    No rigid pose describes a mirrored view. ``T_map_camera`` therefore stays what it was, the pose
    of the real camera, and ``mirrored`` says that camera coordinates have their x reversed: a point
    goes to the map by ``T_map_camera @ diag(-1, 1, 1, 1)``. Flipping twice gives the sample back,
    with ``mirrored`` False.

    Args:
        sample: as the datasets give it.

    Returns:
        A new sample with the key ``mirrored`` (bool).
    """
    K = sample["intrinsics"].clone()
    K[..., 0, 2] = sample["image"].shape[-1] - 1 - K[..., 0, 2]
    flipped = over_planes(sample, lambda plane: plane.flip(-1))
    return {**sample, **flipped, "intrinsics": K, "mirrored": not sample.get("mirrored", False)}


@dataclass(frozen=True, slots=True)
class RandomCrop:
    """Cut a window of fixed size out of a random place, the same for all frames of a window.

    Randomness comes from torch's generator of this process, which a DataLoader seeds differently in
    each worker; a generator kept in here would be copied to the workers, and all would crop alike.

    Attributes:
        width_px: columns that stay.
        height_px: rows that stay.
    """

    width_px: int
    height_px: int

    def __call__(self, sample: Sample) -> Sample:
        """Return the cropped sample."""
        height, width = sample["image"].shape[-2:]
        return crop(
            sample,
            left_px=_random_below(width - self.width_px + 1),
            top_px=_random_below(height - self.height_px + 1),
            width_px=self.width_px,
            height_px=self.height_px,
        )


@dataclass(frozen=True, slots=True)
class RandomHorizontalFlip:
    """Mirror a share of the samples; each gets the key ``mirrored``, so that batches collate.

    Attributes:
        probability: of a flip, 0 to 1. Randomness as in :class:`RandomCrop`.
    """

    probability: float = 0.5

    def __call__(self, sample: Sample) -> Sample:
        """Return the sample, mirrored or not."""
        if float(torch.rand(())) < self.probability:
            return flip_horizontally(sample)
        return {**sample, "mirrored": sample.get("mirrored", False)}


def _random_below(limit: int) -> int:
    # A limit below 1 means that the window is too large: crop() says so in words.
    return int(torch.randint(limit, ())) if limit > 1 else 0


def _nearest_centres(old: int, new: int) -> Tensor:
    # floor((i + 0.5) old / new): the old pixel that holds the new pixel's centre, in whole numbers.
    return (2 * torch.arange(new) + 1) * old // (2 * new)


def _filtered(image: Tensor, *, width_px: int, height_px: int) -> Tensor:
    planes = image.reshape(-1, *image.shape[-3:])
    # align_corners=False is the half-pixel rule; antialias keeps thin cracks from flickering.
    scaled = functional.interpolate(
        planes, size=(height_px, width_px), mode="bilinear", align_corners=False, antialias=True
    )
    return scaled.reshape(*image.shape[:-2], height_px, width_px)


def _place(sample: Sample) -> str:
    return f"bridge {sample.get('bridge', '?')}, frame {sample.get('frame', '?')}"
