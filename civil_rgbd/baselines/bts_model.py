"""BTS as a depth model: plain images in, metres out."""

from __future__ import annotations

from typing import Any, Final

import torch
from torch import Tensor
from torch.nn import Parameter

from civil_rgbd.baselines import imagenet
from civil_rgbd.baselines.bts import KITTI_FOCAL_PX, SIDE_MULTIPLE, Bts
from civil_rgbd.baselines.fitting import InputFit, Rest
from civil_rgbd.baselines.torch_model import TorchDepthModel, as_unit_range, trainable

MIN_DEPTH_M: Final = 1e-6
"""What the sigmoid's underflow becomes, so that its logarithm stays finite."""


class BtsModel(TorchDepthModel):
    """BTS with its preprocessing: ImageNet normalisation, sides to multiples of 32.

    Args:
        encoder: a key of :data:`civil_rgbd.baselines.encoders.ENCODERS`.
        features: channels after the first step of the decoder; a multiple of 16.
        max_depth_m: the largest depth, before it is scaled by focal length.
        focal_reference_px: depths are multiplied by fx over this; None for no such scaling.
        norm_momentum: of the norms. The authors' 0.01 (decoder) lags in short runs.
        width_px: columns of the network's input; None keeps the image's.
        height_px: rows of the network's input; None keeps the image's.
        rest: what is done with sides that are no multiple of 32: pad, crop or resize.
    """

    network: Bts
    mean: Tensor
    deviation: Tensor

    def __init__(
        self,
        encoder: str = "densenet161",
        *,
        features: int = 512,
        max_depth_m: float = 80.0,
        focal_reference_px: float | None = KITTI_FOCAL_PX,
        norm_momentum: float = 0.01,
        width_px: int | None = None,
        height_px: int | None = None,
        rest: Rest = "pad",
        name: str = "bts",
    ) -> None:
        fit = InputFit(SIDE_MULTIPLE, width_px=width_px, height_px=height_px, rest=rest)
        options: dict[str, Any] = {
            "encoder": encoder,
            "features": features,
            "max_depth_m": max_depth_m,
            "focal_reference_px": focal_reference_px,
            "norm_momentum": norm_momentum,
            "width_px": width_px,
            "height_px": height_px,
            "rest": rest,
        }
        super().__init__(name, options, fit=fit, min_depth_m=MIN_DEPTH_M, max_depth_m=max_depth_m)
        self.network = Bts(
            encoder=encoder,
            features=features,
            max_depth_m=max_depth_m,
            focal_reference_px=focal_reference_px,
            norm_momentum=norm_momentum,
        )
        for buffer, values in (("mean", imagenet.MEAN), ("deviation", imagenet.DEVIATION)):
            self.register_buffer(buffer, torch.tensor(values).view(3, 1, 1), persistent=False)

    def forward(self, rgb: Tensor, intrinsics: Tensor) -> Tensor:
        """Predict a batch, with gradient; see :class:`TorchDepthModel`."""
        normalised = (as_unit_range(rgb) - self.mean) / self.deviation
        maps = self.network(normalised, intrinsics[:, 0, 0])
        depth_m: Tensor = maps.depth_m.float()
        return depth_m.clamp_min(self.min_depth_m)

    def parameter_groups(self) -> dict[str, list[Parameter]]:
        """Return what is trained, by ``encoder`` and ``decoder``, without what is frozen."""
        return {
            "encoder": trainable(self.network.encoder),
            "decoder": trainable(self.network.decoder),
        }

    def freeze_early_layers(self) -> int:
        """Freeze the first convolution and the encoder's norms; return how many numbers."""
        return self.network.encoder.freeze_early_layers()


def bts_small(
    *,
    features: int = 64,
    max_depth_m: float = 80.0,
    focal_reference_px: float | None = None,
    norm_momentum: float = 0.1,
    width_px: int | None = None,
    height_px: int | None = None,
    rest: Rest = "pad",
    encoder: str = "small",
) -> BtsModel:
    """Make a BTS that a CPU trains in minutes: the small encoder, few features, quick norms."""
    return BtsModel(
        encoder,
        features=features,
        max_depth_m=max_depth_m,
        focal_reference_px=focal_reference_px,
        norm_momentum=norm_momentum,
        width_px=width_px,
        height_px=height_px,
        rest=rest,
        name="bts-small",
    )
