"""A depth model made of torch: called with a batch it trains, asked for an image it predicts."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import Parameter

from civil_rgbd.baselines.fitting import InputFit, apply_fit, plan_fit, undo_fit
from civil_rgbd.errors import UsageError
from civil_rgbd.geometry.camera import PinholeCamera


class TorchDepthModel(nn.Module, ABC):
    """A :class:`~civil_rgbd.baselines.model.DepthModel` that can be trained.

    Preprocessing is inside: whoever trains it gives plain images. It is an ordinary module, so
    ``train()``, ``to()``, ``state_dict()`` and DistributedDataParallel do what they always do.

    Attributes:
        name: what :func:`~civil_rgbd.baselines.model.load_model` calls it.
        options: the keyword options that make the same model again; JSON values only.
        network: holds every parameter; its ``state_dict`` is what is saved.
        fit: what :meth:`predict` does to images of other sizes.
        min_depth_m: the least depth that it answers.
        max_depth_m: the largest depth that it answers, before any scaling by focal length.
        is_trained: whether weights were loaded; without, its answers are noise.
    """

    network: nn.Module

    def __init__(
        self,
        name: str,
        options: Mapping[str, Any],
        *,
        fit: InputFit,
        min_depth_m: float,
        max_depth_m: float,
    ) -> None:
        super().__init__()
        self.name, self.options, self.fit = name, dict(options), fit
        self.min_depth_m, self.max_depth_m = min_depth_m, max_depth_m
        self.is_trained = False

    @abstractmethod
    def forward(self, rgb: Tensor, intrinsics: Tensor) -> Tensor:
        """Predict a batch, with gradient.

        Args:
            rgb: (B, 3, H, W) uint8, or floating in 0 to 1; red first. H and W are multiples of
                ``side_multiple``.
            intrinsics: (B, 3, 3) of those images, pixels.

        Returns:
            (B, 1, H, W) float32, metres along the optical axis.
        """

    @abstractmethod
    def parameter_groups(self) -> dict[str, list[Parameter]]:
        """Return what is trained, by ``encoder`` and ``decoder``, without what is frozen."""

    @abstractmethod
    def freeze_early_layers(self) -> int:
        """Freeze what fine-tuning from pretrained weights leaves alone; return how many numbers."""

    @property
    def side_multiple(self) -> int:
        """Height and width of a batch are multiples of this, in pixels."""
        return self.fit.side_multiple

    @property
    def device(self) -> torch.device:
        """Where the parameters are."""
        return next(self.parameters()).device

    def predict(self, rgb: NDArray[np.uint8], camera: PinholeCamera) -> NDArray[np.float32]:
        """Predict the depth of every pixel.

        Args:
            rgb: (H, W, 3) uint8, red first.
            camera: the pinhole of that image, W x H pixels.

        Returns:
            (H, W) float32, metres along the optical axis; NaN where ``fit`` cuts the image.

        Raises:
            UsageError: image and camera do not belong together.
        """
        expected = (camera.height_px, camera.width_px, 3)
        if rgb.shape != expected or rgb.dtype != np.uint8:
            raise UsageError(
                f"the image is {rgb.dtype} {rgb.shape}; its camera asks for uint8 {expected}",
                where="predict",
                fix="give (H, W, 3) uint8, red first, and the camera of this very image",
            )
        batch = torch.from_numpy(np.ascontiguousarray(rgb.transpose(2, 0, 1)))[None]
        K = torch.from_numpy(camera.matrix).to(torch.float32)[None]
        depth_m: NDArray[np.float32] = self.predict_batch(batch, K)[0, 0].cpu().numpy()
        return depth_m

    @torch.no_grad()
    def predict_batch(self, rgb: Tensor, intrinsics: Tensor) -> Tensor:
        """Predict a batch of any size, in evaluation mode and without gradient.

        Args:
            rgb: (B, 3, H, W) uint8, or floating in 0 to 1; red first.
            intrinsics: (B, 3, 3) of those images, pixels.

        Returns:
            (B, 1, H, W) float32 on the model's device, metres; NaN where ``fit`` cuts the image.
        """
        was_training = self.training
        self.eval()
        try:
            plan = plan_fit(self.fit, height_px=rgb.shape[-2], width_px=rgb.shape[-1])
            fitted, K = apply_fit(plan, as_unit_range(rgb.to(self.device)), intrinsics)
            depth_m = self(fitted, K.to(self.device))
        finally:
            self.train(was_training)
        return undo_fit(plan, depth_m.float())


def as_unit_range(rgb: Tensor) -> Tensor:
    """Bring uint8 to 0 to 1; what is floating is there already."""
    return rgb if rgb.is_floating_point() else rgb.to(torch.float32) / 255


def trainable(module: nn.Module) -> list[Parameter]:
    """Return the parameters that are not frozen."""
    return [parameter for parameter in module.parameters() if parameter.requires_grad]
