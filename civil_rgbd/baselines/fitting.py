"""How an image of any size becomes a network's input, and its answer an image's depth again."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

import torch
from torch import Tensor
from torch.nn import functional

from civil_rgbd.errors import UsageError

Rest = Literal["pad", "crop", "resize"]

RESTS: Final = ("pad", "crop", "resize")
"""What is done with sides that are no multiple of what the network takes."""


@dataclass(frozen=True, slots=True)
class InputFit:
    """What a network asks of its input's size.

    First the image is resized to ``width_px`` x ``height_px``, where these are given. Then ``rest``
    makes its sides multiples of ``side_multiple``: ``pad`` repeats the last column and row to the
    right and below, and cuts the answer there; ``crop`` takes the middle, and leaves the frame
    around it without an answer (NaN); ``resize`` goes to the nearest multiples.

    Attributes:
        side_multiple: sides of the input are multiples of this, in pixels.
        width_px: columns of the input; None keeps the image's.
        height_px: rows of the input; None keeps the image's.
        rest: what to do with other sides.
    """

    side_multiple: int = 1
    width_px: int | None = None
    height_px: int | None = None
    rest: Rest = "pad"

    def __post_init__(self) -> None:
        if self.rest not in RESTS:
            raise UsageError(
                f"sides that do not fit are {', '.join(RESTS)}; not {self.rest!r}",
                where="rest",
                fix="choose one of them",
            )
        if (self.width_px is None) != (self.height_px is None):
            raise UsageError(
                f"half a size is given: width_px {self.width_px}, height_px {self.height_px}",
                where="width_px, height_px",
                fix="give both, or neither",
            )
        sides = (self.side_multiple, self.width_px, self.height_px)
        if min(side for side in sides if side is not None) < 1:
            raise UsageError(
                f"the input has no pixels: {self.width_px} x {self.height_px}",
                where="width_px, height_px",
                fix="give a size of at least one pixel",
            )


@dataclass(frozen=True, slots=True)
class FitPlan:
    """The sizes of one fit, all as (rows, columns) in pixels.

    Attributes:
        image: of the image.
        resized: after resizing.
        start: first row and column of the input in the resized image.
        input: of what the network sees; it reaches over the resized image where that is padded.
    """

    image: tuple[int, int]
    resized: tuple[int, int]
    start: tuple[int, int]
    input: tuple[int, int]


def plan_fit(fit: InputFit, *, height_px: int, width_px: int) -> FitPlan:
    """Work out the sizes for an image.

    >>> plan_fit(InputFit(side_multiple=32), height_px=432, width_px=768).input
    (448, 768)
    >>> plan_fit(InputFit(side_multiple=32, rest="crop"), height_px=432, width_px=768).start
    (8, 0)

    Raises:
        UsageError: nothing is left of the image when it is cropped.
    """
    image = (height_px, width_px)
    resized = (fit.height_px or height_px, fit.width_px or width_px)
    step = fit.side_multiple
    if fit.rest == "resize":
        resized = (_nearest_multiple(resized[0], step), _nearest_multiple(resized[1], step))
    if fit.rest == "pad":
        padded = (-(-resized[0] // step) * step, -(-resized[1] // step) * step)
        return FitPlan(image, resized, (0, 0), padded)
    cropped = (resized[0] // step * step, resized[1] // step * step)
    if min(cropped) == 0:
        raise UsageError(
            f"nothing is left of {resized[1]} x {resized[0]} px cut to multiples of {step} px",
            where="rest",
            fix="give a larger image, or rest='pad'",
        )
    start = ((resized[0] - cropped[0]) // 2, (resized[1] - cropped[1]) // 2)
    return FitPlan(image, resized, start, cropped)


def _nearest_multiple(side: int, step: int) -> int:
    return max(step, (side + step // 2) // step * step)


def apply_fit(plan: FitPlan, rgb: Tensor, intrinsics: Tensor) -> tuple[Tensor, Tensor]:
    """Bring images to the network's size; the camera moves along.

    Args:
        plan: the sizes.
        rgb: (B, 3, H, W) floating.
        intrinsics: (B, 3, 3), pixels; pixel (0, 0) is a pixel's centre.

    Returns:
        (B, 3, h, w) and (B, 3, 3) of what the network sees.
    """
    K = intrinsics.clone()
    if plan.resized != plan.image:
        rgb = functional.interpolate(
            rgb, size=plan.resized, mode="bilinear", align_corners=False, antialias=True
        )
        sy, sx = (new / old for new, old in zip(plan.resized, plan.image, strict=True))
        K[:, 0] *= sx
        K[:, 1] *= sy
        # A pixel's centre is at a whole number, so the principal point shifts: (c + 1/2) s - 1/2.
        K[:, 0, 2] += 0.5 * sx - 0.5
        K[:, 1, 2] += 0.5 * sy - 0.5
    (top, left), (height, width) = plan.start, plan.input
    K[:, 0, 2] -= left
    K[:, 1, 2] -= top
    rgb = rgb[..., top : top + height, left : left + width]
    below, right = height - rgb.shape[-2], width - rgb.shape[-1]
    if below or right:
        rgb = functional.pad(rgb, (0, right, 0, below), mode="replicate")
    return rgb, K


def undo_fit(plan: FitPlan, depth_m: Tensor) -> Tensor:
    """Bring the network's answer back to the image.

    Args:
        plan: the sizes.
        depth_m: (B, 1, h, w) metres, of what the network saw.

    Returns:
        (B, 1, H, W) metres; NaN where the network saw nothing.
    """
    (top, left), (rows, columns) = plan.start, plan.resized
    seen = depth_m[..., : rows - top, : columns - left]
    around = (left, columns - left - seen.shape[-1], top, rows - top - seen.shape[-2])
    if any(around):
        seen = functional.pad(seen, around, value=torch.nan)
    if plan.resized == plan.image:
        return seen
    return functional.interpolate(seen, size=plan.image, mode="bilinear", align_corners=False)
