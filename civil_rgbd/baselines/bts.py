"""BTS: from big to small, depth through local planar guidance (Lee et al., arXiv 1907.10326).

The encoder's last feature map is brought back to the image's size in five steps. On the way, at
1/8, 1/4 and 1/2 of it, each feature predicts a small plane, which fills its patch of the full image
with depth: the guidance. The last convolution weighs these with what it sees. Only the last map is
supervised. Written anew from the paper; tensors have the names of the authors' code, so that their
checkpoints load.
"""

from __future__ import annotations

from collections import OrderedDict
from typing import Final, NamedTuple, cast

import torch
from torch import Tensor, nn
from torch.nn import functional

from civil_rgbd.baselines.encoders import TappedEncoder
from civil_rgbd.errors import UsageError

SIDE_MULTIPLE: Final = 32
"""Sides of the input are multiples of this: the encoder halves them five times."""

KITTI_FOCAL_PX: Final = 715.0873
"""The focal length that the authors' KITTI depths are scaled by."""

_NORM_EPS: Final = 1.1e-5  # of every norm in the decoder
_DILATIONS: Final = (3, 6, 12, 18, 24)


class BtsDepths(NamedTuple):
    """Maps of the image's size, (B, 1, H, W); all but the last are shares of the largest depth."""

    guidance_8: Tensor
    guidance_4: Tensor
    guidance_2: Tensor
    reduced_1: Tensor
    depth_m: Tensor


class Bts(nn.Module):
    """The network.

    Args:
        encoder: a key of :data:`civil_rgbd.baselines.encoders.ENCODERS`.
        features: channels after the first step of the decoder; a multiple of 16.
        max_depth_m: the largest depth.
        focal_reference_px: depths are multiplied by focal length over this; None for no such
            scaling. The authors do so on KITTI, not on NYU.
        norm_momentum: of the decoder's norms. The authors' 0.01 lags in short runs.

    Raises:
        UsageError: there is no such encoder, or ``features`` is no multiple of 16.
    """

    def __init__(
        self,
        *,
        encoder: str = "densenet161",
        features: int = 512,
        max_depth_m: float = 80.0,
        focal_reference_px: float | None = KITTI_FOCAL_PX,
        norm_momentum: float = 0.01,
    ) -> None:
        super().__init__()
        if features < 16 or features % 16:
            raise UsageError(
                f"the decoder halves its features four times; it cannot with {features}",
                where="features",
                fix="give a multiple of 16; the authors use 512",
            )
        self.max_depth_m, self.focal_reference_px = max_depth_m, focal_reference_px
        self.encoder = TappedEncoder(encoder)
        self.decoder = _Decoder(self.encoder.spec.channels, features, momentum=norm_momentum)

    def forward(self, rgb: Tensor, focal_px: Tensor) -> BtsDepths:
        """Predict a batch.

        Args:
            rgb: (B, 3, H, W), normalised as for ImageNet; H and W multiples of 32.
            focal_px: (B,) focal length of each image.

        Returns:
            the guidance and the depth in metres.

        Raises:
            UsageError: a side is no multiple of 32.
        """
        if rgb.shape[-1] % SIDE_MULTIPLE or rgb.shape[-2] % SIDE_MULTIPLE:
            raise UsageError(
                f"sides are multiples of {SIDE_MULTIPLE} px; the batch has "
                f"{rgb.shape[-1]} x {rgb.shape[-2]}",
                where="BTS",
                fix="crop or resize the images, or call predict, which pads them",
            )
        maps: BtsDepths = self.decoder(self.encoder(rgb))
        depth_m = self.max_depth_m * maps.depth_m
        if self.focal_reference_px is not None:
            depth_m = depth_m * (focal_px.view(-1, 1, 1, 1) / self.focal_reference_px)
        return maps._replace(depth_m=depth_m)


class _Decoder(nn.Module):
    """From five feature maps to depth as a share of the largest."""

    def __init__(self, channels: tuple[int, ...], features: int, *, momentum: float) -> None:
        super().__init__()
        f2, f4, f8, f16 = (features // n for n in (2, 4, 8, 16))
        self.upconv5 = _UpConv(channels[4], features)
        self.bn5 = _norm(features, momentum)
        self.conv5 = _conv3_elu(features + channels[3], features)
        self.upconv4 = _UpConv(features, f2)
        self.bn4 = _norm(f2, momentum)
        self.conv4 = _conv3_elu(f2 + channels[2], f2)
        self.bn4_2 = _norm(f2, momentum)
        inputs = f2
        for number, dilation in enumerate(_DILATIONS):
            part = _Atrous(inputs, f2, f4, dilation, momentum=momentum, norm_first=number > 0)
            self.add_module(f"daspp_{dilation}", part)
            # All but the first see the undecoded skip as well.
            inputs = inputs + f4 if number else f2 + channels[2] + f4
        self.daspp_conv = _conv3_elu(f2 + len(_DILATIONS) * f4, f4)
        self.reduc8x8 = _Reduction(f4, f4)
        self.lpg8x8 = LocalPlanarGuidance(8)
        self.upconv3 = _UpConv(f4, f4)
        self.bn3 = _norm(f4, momentum)
        self.conv3 = _conv3_elu(f4 + channels[1] + 1, f4)
        self.reduc4x4 = _Reduction(f4, f8)
        self.lpg4x4 = LocalPlanarGuidance(4)
        self.upconv2 = _UpConv(f4, f8)
        self.bn2 = _norm(f8, momentum)
        self.conv2 = _conv3_elu(f8 + channels[0] + 1, f8)
        self.reduc2x2 = _Reduction(f8, f16)
        self.lpg2x2 = LocalPlanarGuidance(2)
        self.upconv1 = _UpConv(f8, f16)
        self.reduc1x1 = _Reduction(f16, features // 32, to_depth=True)
        self.conv1 = _conv3_elu(f16 + 4, f16)
        self.get_depth = nn.Sequential(_conv3(f16, 1), nn.Sigmoid())
        for module in self.modules():
            if isinstance(module, nn.Conv2d):
                nn.init.xavier_uniform_(module.weight)

    def forward(self, taps: list[Tensor]) -> BtsDepths:
        skip2, skip4, skip8, skip16, deepest = taps
        x = self.bn5(self.upconv5(functional.relu(deepest)))
        x = self.conv5(torch.cat([x, skip16], 1))
        x = self.bn4(self.upconv4(x))
        x = self._dense_atrous(torch.cat([x, skip8], 1))
        guidance_8 = self.lpg8x8(self.reduc8x8(x))
        x = self.bn3(self.upconv3(x))
        x = self.conv3(torch.cat([x, skip4, guidance_8[..., ::4, ::4]], 1))
        guidance_4 = self.lpg4x4(self.reduc4x4(x))
        x = self.bn2(self.upconv2(x))
        x = self.conv2(torch.cat([x, skip2, guidance_4[..., ::2, ::2]], 1))
        guidance_2 = self.lpg2x2(self.reduc2x2(x))
        x = self.upconv1(x)
        reduced_1 = self.reduc1x1(x)
        x = self.conv1(torch.cat([x, reduced_1, guidance_2, guidance_4, guidance_8], 1))
        return BtsDepths(guidance_8, guidance_4, guidance_2, reduced_1, self.get_depth(x))

    def _dense_atrous(self, with_skip: Tensor) -> Tensor:
        """Look ever further around, each time at all that was seen before (at 1/8)."""
        x = self.bn4_2(self.conv4(with_skip))
        seen: list[Tensor] = []
        for dilation in _DILATIONS:
            part = self.get_submodule(f"daspp_{dilation}")
            seen.append(part(torch.cat([with_skip, *seen], 1) if seen else x))
        return cast("Tensor", self.daspp_conv(torch.cat([x, *seen], 1)))


class LocalPlanarGuidance(nn.Module):
    """Fills each patch of ``ratio`` x ``ratio`` pixels with the plane that its feature predicts.

    A plane is three numbers in 0 to 1: the polar angle and the azimuth of its normal n and its
    distance. Its depth at (u, v), the place in the patch measured from its centre in patches, is
    distance / (n1 u + n2 v + n3).

    Args:
        ratio: pixels along the edge of a patch.
    """

    offset: Tensor

    def __init__(self, ratio: int) -> None:
        super().__init__()
        self.ratio = ratio
        offset = (torch.arange(ratio, dtype=torch.float32) - (ratio - 1) / 2) / ratio
        self.register_buffer("offset", offset, persistent=False)

    def forward(self, plane: Tensor) -> Tensor:
        """Turn (B, 3, h, w) planes into (B, 1, ratio h, ratio w) depths, in units of distance."""
        plane = plane.float()  # half precision is too coarse near the singularity
        polar, azimuth = plane[:, 0] * (torch.pi / 3), plane[:, 1] * (2 * torch.pi)
        n1 = torch.sin(polar) * torch.cos(azimuth)
        n2 = torch.sin(polar) * torch.sin(azimuth)
        n3 = torch.cos(polar)
        # (B, h, 1, w, 1) against columns (ratio,) and rows (ratio, 1, 1): no copy of the planes.
        n1, n2, n3, distance = (part[:, :, None, :, None] for part in (n1, n2, n3, plane[:, 2]))
        u, v = self.offset, self.offset[:, None, None]
        depth = distance / (n1 * u + n2 * v + n3)
        batch, rows, _, columns, _ = depth.shape
        size = (batch, 1, rows * self.ratio, columns * self.ratio)
        return depth.reshape(size)


class _Reduction(nn.Module):
    """1x1 convolutions that halve the channels down to a plane, or to a depth; all in 0 to 1."""

    def __init__(self, inputs: int, outputs: int, *, to_depth: bool = False) -> None:
        super().__init__()
        self.reduc = nn.Sequential()
        while outputs >= 8:
            halving = nn.Sequential(nn.Conv2d(inputs, outputs, 1, bias=False), nn.ELU())
            self.reduc.add_module(f"inter_{inputs}_{outputs}", halving)
            inputs, outputs = outputs, outputs // 2
        if to_depth:
            last = nn.Sequential(nn.Conv2d(inputs, 1, 1, bias=False), nn.Sigmoid())
            self.reduc.add_module("final", last)
        else:
            self.reduc.add_module("plane_params", nn.Conv2d(inputs, 3, 1, bias=False))
            self.reduc.add_module("to_unit_range", nn.Sigmoid())

    def forward(self, x: Tensor) -> Tensor:
        return cast("Tensor", self.reduc(x))


class _Atrous(nn.Module):
    """1x1, then 3x3 with a dilation."""

    def __init__(
        self,
        inputs: int,
        width: int,
        outputs: int,
        dilation: int,
        *,
        momentum: float,
        norm_first: bool,
    ) -> None:
        super().__init__()
        sequence = nn.Sequential(
            nn.ReLU(),
            nn.Conv2d(inputs, width, 1, bias=False),
            _norm(width, momentum),
            nn.ReLU(),
            nn.Conv2d(width, outputs, 3, padding=dilation, dilation=dilation, bias=False),
        )
        parts: OrderedDict[str, nn.Module] = OrderedDict(aconv_sequence=sequence)
        if norm_first:
            parts["first_bn"] = _norm(inputs, momentum)
            parts.move_to_end("aconv_sequence")
        self.atrous_conv = nn.Sequential(parts)

    def forward(self, x: Tensor) -> Tensor:
        return cast("Tensor", self.atrous_conv(x))


class _UpConv(nn.Module):
    """Doubles the size by repeating pixels, then 3x3."""

    def __init__(self, inputs: int, outputs: int) -> None:
        super().__init__()
        self.conv = _conv3(inputs, outputs)

    def forward(self, x: Tensor) -> Tensor:
        return functional.elu(self.conv(functional.interpolate(x, scale_factor=2, mode="nearest")))


def _conv3(inputs: int, outputs: int) -> nn.Conv2d:
    return nn.Conv2d(inputs, outputs, 3, padding=1, bias=False)


def _conv3_elu(inputs: int, outputs: int) -> nn.Module:
    return nn.Sequential(_conv3(inputs, outputs), nn.ELU())


def _norm(channels: int, momentum: float) -> nn.BatchNorm2d:
    return nn.BatchNorm2d(channels, eps=_NORM_EPS, momentum=momentum)
