"""Encoders: taps, channels, numbers of parameters as published."""

from __future__ import annotations

import pytest
import torch

from civil_rgbd.baselines.encoders import ENCODERS, TappedEncoder
from civil_rgbd.errors import UsageError

PARAMETERS = {
    # torchvision's own figures; DenseNet and MobileNet without their classifiers.
    "densenet121": 7_978_856 - 1024 * 1000 - 1000,
    "densenet161": 28_681_000 - 2208 * 1000 - 1000,
    "resnet50": 25_557_032,
    "resnet101": 44_549_160,
    "resnext50": 25_028_904,
    "resnext101": 88_791_336,
    "mobilenetv2": 3_504_872 - 1280 * 1000 - 1000,
}


@pytest.mark.parametrize("name", ENCODERS)
def test_taps_have_the_channels_of_the_table_at_strides_2_to_32(name: str) -> None:
    with torch.device("meta"):  # shapes need no numbers
        encoder = TappedEncoder(name).eval()
        taps = encoder(torch.empty(1, 3, 64, 96))

    assert [tuple(tap.shape[1:]) for tap in taps] == [
        (channels, 64 >> step, 96 >> step)
        for step, channels in enumerate(ENCODERS[name].channels, start=1)
    ]


@pytest.mark.parametrize("name", PARAMETERS)
def test_parameters_are_as_many_as_published(name: str) -> None:
    with torch.device("meta"):
        encoder = TappedEncoder(name)

    assert sum(p.numel() for p in encoder.parameters()) == PARAMETERS[name]


@pytest.mark.parametrize(
    ("name", "tensor"),
    [
        ("resnext50", "layer1.0.conv2.weight (128, 4, 3, 3)"),
        ("resnext101", "layer4.2.conv2.weight (2048, 64, 3, 3)"),
        ("resnet101", "layer3.22.bn3.running_var (1024,)"),
        ("resnet50", "layer2.0.downsample.1.bias (512,)"),
        ("densenet121", "denseblock4.denselayer16.conv2.weight (32, 128, 3, 3)"),
        ("densenet121", "transition3.conv.weight (512, 1024, 1, 1)"),
        ("mobilenetv2", "1.conv.1.weight (16, 32, 1, 1)"),
        ("mobilenetv2", "2.conv.1.0.weight (96, 1, 3, 3)"),
        ("mobilenetv2", "17.conv.3.running_mean (320,)"),
        ("mobilenetv2", "18.0.weight (1280, 320, 1, 1)"),
    ],
)
def test_tensors_have_torchvisions_names(name: str, tensor: str) -> None:
    with torch.device("meta"):
        state = TappedEncoder(name).base_model.state_dict()

    assert tensor in {f"{key} {tuple(value.shape)}" for key, value in state.items()}


@pytest.mark.parametrize("name", ["resnet50", "densenet121", "mobilenetv2", "small"])
def test_everything_that_is_not_frozen_gets_a_gradient(name: str) -> None:
    encoder = TappedEncoder(name)

    sum(tap.square().mean() for tap in encoder(torch.rand(2, 3, 32, 32))).backward()

    without = [n for n, p in encoder.named_parameters() if p.requires_grad and p.grad is None]
    assert without == []


def test_early_layers_are_the_first_convolution_and_the_norms() -> None:
    encoder = TappedEncoder("small")

    frozen = encoder.freeze_early_layers()

    still = [name for name, p in encoder.base_model.named_parameters() if not p.requires_grad]
    assert frozen == 3 * 16 * 9 + 4 * (16 + 24 + 48 + 96 + 128)
    assert all(name == "stage1.conv1.weight" or ".bn" in name for name in still)


def test_an_unknown_encoder_names_the_nearest() -> None:
    with pytest.raises(UsageError, match="no encoder 'resnet5'") as caught:
        TappedEncoder("resnet5")
    assert "did you mean 'resnet50'" in caught.value.fix
