"""Image encoders in plain torch, with torchvision's tensor names, tapped at strides 2 to 32.

An encoder returns five feature maps, of 1/2, 1/4, 1/8, 1/16 and 1/32 of the image's size. Weights
are random at first; :mod:`civil_rgbd.baselines.imagenet` loads pretrained ones.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Final, cast

import torch
from torch import Tensor, nn

from civil_rgbd.errors import UsageError
from civil_rgbd.resources import nearest


@dataclass(frozen=True, slots=True)
class EncoderSpec:
    """What there is to know of an encoder.

    Attributes:
        build: makes the module that holds its tensors, weights random.
        taps: names of the children whose outputs are the five feature maps.
        channels: of the five feature maps.
        first_convolution: name of the convolution that sees the image.
        weights_file: torchvision's file of ImageNet weights; its last part begins its SHA-256.
    """

    build: Callable[[], nn.Module]
    taps: tuple[str, str, str, str, str]
    channels: tuple[int, int, int, int, int]
    first_convolution: str
    weights_file: str | None


class TappedEncoder(nn.Module):
    """Runs an encoder's children in order, and keeps what comes out at five of them.

    Args:
        encoder: a key of :data:`ENCODERS`.

    Raises:
        UsageError: there is no such encoder.
    """

    def __init__(self, encoder: str) -> None:
        super().__init__()
        if encoder not in ENCODERS:
            raise UsageError(
                f"there is no encoder {encoder!r}", where="encoder", fix=nearest(encoder, ENCODERS)
            )
        self.spec = ENCODERS[encoder]
        self.base_model = self.spec.build()

    def forward(self, rgb: Tensor) -> list[Tensor]:
        """Return the five feature maps of (B, 3, H, W) normalised images, largest first."""
        features, taps = rgb, []
        for name, child in self.base_model.named_children():
            features = child(features)
            if name in self.spec.taps:
                taps.append(features)
            if len(taps) == len(self.spec.taps):
                break  # what follows in a classifier has no place here
        return taps

    def freeze_early_layers(self) -> int:
        """Freeze the first convolution and the norms; return how many numbers were frozen.

        Norms of ResNet's shortcuts stay free: the original goes by names, and misses theirs.
        """
        frozen = 0
        for name, part in self.base_model.named_modules():
            is_norm = isinstance(part, nn.BatchNorm2d) and "downsample" not in name
            if is_norm or name == self.spec.first_convolution:
                for parameter in part.parameters():
                    parameter.requires_grad = False
                    frozen += parameter.numel()
        return frozen


# --- ResNet and ResNeXt -----------------------------------------------------------------------


class _Bottleneck(nn.Module):
    """1x1, 3x3, 1x1 with a shortcut; the stride is in the 3x3, as in torchvision."""

    def __init__(self, inputs: int, planes: int, *, width: int, groups: int, stride: int) -> None:
        super().__init__()
        outputs = 4 * planes
        self.conv1 = nn.Conv2d(inputs, width, 1, bias=False)
        self.bn1 = nn.BatchNorm2d(width)
        self.conv2 = nn.Conv2d(width, width, 3, stride, 1, groups=groups, bias=False)
        self.bn2 = nn.BatchNorm2d(width)
        self.conv3 = nn.Conv2d(width, outputs, 1, bias=False)
        self.bn3 = nn.BatchNorm2d(outputs)
        self.relu = nn.ReLU(inplace=True)
        self.downsample: nn.Module | None = None
        if stride != 1 or inputs != outputs:
            self.downsample = nn.Sequential(
                nn.Conv2d(inputs, outputs, 1, stride, bias=False), nn.BatchNorm2d(outputs)
            )

    def forward(self, x: Tensor) -> Tensor:
        shortcut = x if self.downsample is None else self.downsample(x)
        x = self.relu(self.bn1(self.conv1(x)))
        x = self.relu(self.bn2(self.conv2(x)))
        return cast("Tensor", self.relu(self.bn3(self.conv3(x)) + shortcut))


class _ResNet(nn.Module):
    """A ResNet of bottlenecks, or with groups a ResNeXt, with its classifier's unused weights."""

    def __init__(
        self, blocks: tuple[int, int, int, int], *, groups: int = 1, group_width: int = 64
    ) -> None:
        super().__init__()
        self.conv1 = nn.Conv2d(3, 64, 7, 2, 3, bias=False)
        self.bn1 = nn.BatchNorm2d(64)
        self.relu = nn.ReLU(inplace=True)
        self.maxpool = nn.MaxPool2d(3, 2, 1)
        inputs = 64
        for number, count in enumerate(blocks):
            planes = 64 << number
            layer = []
            for block in range(count):
                layer.append(
                    _Bottleneck(
                        inputs,
                        planes,
                        width=planes * group_width // 64 * groups,
                        groups=groups,
                        stride=2 if number and not block else 1,
                    )
                )
                inputs = 4 * planes
            self.add_module(f"layer{number + 1}", nn.Sequential(*layer))
        self.fc = nn.Linear(inputs, 1000)
        for parameter in self.fc.parameters():
            parameter.requires_grad = False  # never used: it would never get one
        _initialise(self)


# --- DenseNet ---------------------------------------------------------------------------------


class _DenseLayer(nn.Module):
    def __init__(self, inputs: int, growth: int) -> None:
        super().__init__()
        self.norm1 = nn.BatchNorm2d(inputs)
        self.relu1 = nn.ReLU(inplace=True)
        self.conv1 = nn.Conv2d(inputs, 4 * growth, 1, bias=False)
        self.norm2 = nn.BatchNorm2d(4 * growth)
        self.relu2 = nn.ReLU(inplace=True)
        self.conv2 = nn.Conv2d(4 * growth, growth, 3, padding=1, bias=False)

    def forward(self, x: Tensor) -> Tensor:
        inner = self.conv1(self.relu1(self.norm1(x)))
        return torch.cat([x, self.conv2(self.relu2(self.norm2(inner)))], 1)


def _densenet(growth: int, blocks: tuple[int, int, int, int], inputs: int) -> nn.Module:
    """The feature part of a DenseNet."""
    parts: OrderedDict[str, nn.Module] = OrderedDict(
        conv0=nn.Conv2d(3, inputs, 7, 2, 3, bias=False),
        norm0=nn.BatchNorm2d(inputs),
        relu0=nn.ReLU(inplace=True),
        pool0=nn.MaxPool2d(3, 2, 1),
    )
    for number, count in enumerate(blocks, start=1):
        layers: OrderedDict[str, nn.Module] = OrderedDict()
        for layer in range(1, count + 1):
            layers[f"denselayer{layer}"] = _DenseLayer(inputs, growth)
            inputs += growth
        parts[f"denseblock{number}"] = nn.Sequential(layers)
        if number < len(blocks):
            parts[f"transition{number}"] = nn.Sequential(
                OrderedDict(
                    norm=nn.BatchNorm2d(inputs),
                    relu=nn.ReLU(inplace=True),
                    conv=nn.Conv2d(inputs, inputs // 2, 1, bias=False),
                    pool=nn.AvgPool2d(2, 2),
                )
            )
            inputs //= 2
    parts["norm5"] = nn.BatchNorm2d(inputs)
    return _initialise(nn.Sequential(parts))


# --- MobileNetV2 and the small one ------------------------------------------------------------


def _conv_norm_relu6(
    inputs: int, outputs: int, size: int, *, stride: int = 1, groups: int = 1
) -> nn.Module:
    return nn.Sequential(
        nn.Conv2d(inputs, outputs, size, stride, size // 2, groups=groups, bias=False),
        nn.BatchNorm2d(outputs),
        nn.ReLU6(inplace=True),
    )


class _InvertedResidual(nn.Module):
    def __init__(self, inputs: int, outputs: int, *, stride: int, expansion: int) -> None:
        super().__init__()
        width = inputs * expansion
        parts = [_conv_norm_relu6(inputs, width, 1)] if expansion > 1 else []
        self.conv = nn.Sequential(
            *parts,
            _conv_norm_relu6(width, width, 3, stride=stride, groups=width),
            nn.Conv2d(width, outputs, 1, bias=False),
            nn.BatchNorm2d(outputs),
        )
        self.adds = stride == 1 and inputs == outputs

    def forward(self, x: Tensor) -> Tensor:
        y = cast("Tensor", self.conv(x))
        return x + y if self.adds else y


_MOBILENET_V2: Final = (
    (1, 16, 1, 1),
    (6, 24, 2, 2),
    (6, 32, 3, 2),
    (6, 64, 4, 2),
    (6, 96, 3, 1),
    (6, 160, 3, 2),
    (6, 320, 1, 1),
)
"""Expansion, channels, blocks, stride of each stage (arXiv 1801.04381, table 2)."""


def _mobilenet_v2() -> nn.Module:
    """The feature part of MobileNetV2."""
    parts, inputs = [_conv_norm_relu6(3, 32, 3, stride=2)], 32
    for expansion, outputs, count, stride in _MOBILENET_V2:
        for block in range(count):
            step = 1 if block else stride
            parts.append(_InvertedResidual(inputs, outputs, stride=step, expansion=expansion))
            inputs = outputs
    return _initialise(nn.Sequential(*parts, _conv_norm_relu6(inputs, 1280, 1)))


class _SmallStage(nn.Module):
    """Halves the image, then looks once more with a shortcut."""

    def __init__(self, inputs: int, outputs: int) -> None:
        super().__init__()
        self.conv1 = nn.Conv2d(inputs, outputs, 3, 2, 1, bias=False)
        self.bn1 = nn.BatchNorm2d(outputs)
        self.conv2 = nn.Conv2d(outputs, outputs, 3, padding=1, bias=False)
        self.bn2 = nn.BatchNorm2d(outputs)

    def forward(self, x: Tensor) -> Tensor:
        x = torch.relu(self.bn1(self.conv1(x)))
        return torch.relu(x + self.bn2(self.conv2(x)))


def _small(channels: tuple[int, ...]) -> nn.Module:
    """An encoder that a CPU can train in minutes."""
    stages = zip((3, *channels), channels, strict=False)
    return _initialise(
        nn.Sequential(OrderedDict((f"stage{n + 1}", _SmallStage(*s)) for n, s in enumerate(stages)))
    )


def _initialise(module: nn.Module) -> nn.Module:
    for part in module.modules():
        if isinstance(part, nn.Conv2d):
            nn.init.kaiming_normal_(part.weight, mode="fan_out", nonlinearity="relu")
    return module


# --- all of them ------------------------------------------------------------------------------


def _resnet_spec(
    blocks: tuple[int, int, int, int], weights_file: str, *, groups: int = 1, group_width: int = 64
) -> EncoderSpec:
    return EncoderSpec(
        build=partial(_ResNet, blocks, groups=groups, group_width=group_width),
        taps=("relu", "layer1", "layer2", "layer3", "layer4"),
        channels=(64, 256, 512, 1024, 2048),
        first_convolution="conv1",
        weights_file=weights_file,
    )


def _densenet_spec(
    growth: int, blocks: tuple[int, int, int, int], inputs: int, weights_file: str
) -> EncoderSpec:
    widths, width = [], inputs
    for count in blocks:
        width += count * growth
        widths.append(width)
        width //= 2
    return EncoderSpec(
        build=partial(_densenet, growth, blocks, inputs),
        taps=("relu0", "pool0", "transition1", "transition2", "norm5"),
        channels=(inputs, inputs, widths[0] // 2, widths[1] // 2, widths[3]),
        first_convolution="conv0",
        weights_file=weights_file,
    )


ENCODERS: Final[dict[str, EncoderSpec]] = {
    "densenet121": _densenet_spec(32, (6, 12, 24, 16), 64, "densenet121-a639ec97.pth"),
    "densenet161": _densenet_spec(48, (6, 12, 36, 24), 96, "densenet161-8d451a50.pth"),
    "resnet50": _resnet_spec((3, 4, 6, 3), "resnet50-0676ba61.pth"),
    "resnet101": _resnet_spec((3, 4, 23, 3), "resnet101-63fe2227.pth"),
    "resnext50": _resnet_spec(
        (3, 4, 6, 3), "resnext50_32x4d-7cdf4587.pth", groups=32, group_width=4
    ),
    "resnext101": _resnet_spec(
        (3, 4, 23, 3), "resnext101_32x8d-8ba56ff5.pth", groups=32, group_width=8
    ),
    "mobilenetv2": EncoderSpec(
        build=_mobilenet_v2,
        taps=("1", "3", "6", "10", "18"),
        channels=(16, 24, 32, 64, 1280),
        first_convolution="0.0",
        weights_file="mobilenet_v2-b0353104.pth",
    ),
    "small": EncoderSpec(
        build=partial(_small, (16, 24, 48, 96, 128)),
        taps=("stage1", "stage2", "stage3", "stage4", "stage5"),
        channels=(16, 24, 48, 96, 128),
        first_convolution="stage1.conv1",
        weights_file=None,
    ),
}
"""Every encoder: those of the original BTS, and a small one for CPUs."""
