"""BTS: the authors' tensors and the authors' numbers."""

from __future__ import annotations

import hashlib
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from civil_rgbd.baselines.bts import KITTI_FOCAL_PX, Bts, LocalPlanarGuidance
from civil_rgbd.baselines.encoders import ENCODERS
from civil_rgbd.errors import UsageError

from ..reference.planar_guidance import planar_guidance

PARITY = json.loads((Path(__file__).parents[1] / "data" / "bts_parity.json").read_text("utf-8"))
MAPS = ("lpg8x8", "lpg4x4", "lpg2x2", "reduc1x1", "depth")


def reference_input() -> tuple[torch.Tensor, torch.Tensor]:
    n, c, i, j = np.indices((2, 3, 96, 160))
    x = np.sin(0.05 * j * (c + 1) + 0.03 * i + n) + 0.5 * np.cos(0.11 * i - 0.02 * j * (c + 1))
    return torch.from_numpy(x.astype(np.float32)), torch.tensor([518.8579, 721.5377])


def fill_by_formula(network: torch.nn.Module) -> None:
    floating = [(k, v) for k, v in network.state_dict().items() if v.is_floating_point()]
    for seed, (name, tensor) in enumerate(floating):
        random, shape = np.random.RandomState(seed), tuple(tensor.shape)
        if tensor.ndim > 1:
            values = random.standard_normal(shape) * math.sqrt(2 / math.prod(shape[1:]))
        elif name.endswith(("weight", "running_var")):
            values = 1 + 0.1 * random.uniform(-1, 1, shape)
        else:
            values = 0.1 * random.standard_normal(shape)
        tensor.copy_(torch.from_numpy(values.astype(np.float32)))


def lines_of(network: torch.nn.Module) -> list[str]:
    return [
        f"{name} {'x'.join(map(str, tensor.shape))}"
        for name, tensor in network.state_dict().items()
        if tensor.is_floating_point()
    ]


def assert_equals_reference(outputs: tuple[torch.Tensor, ...], expected: dict[str, Any]) -> None:
    for name, found in zip(MAPS, outputs, strict=True):
        flat = found.numpy().reshape(-1)
        middle = flat.size // 2
        scale = max(1.0, float(np.abs(expected[name]["first8"]).max()))
        for start, key in ((0, "first8"), (middle, "mid8")):
            np.testing.assert_allclose(
                flat[start : start + 8], expected[name][key], rtol=1e-4, atol=2e-6 * scale
            )
        assert flat.mean() == pytest.approx(expected[name]["mean"], rel=1e-4), name


@pytest.mark.slow
@pytest.mark.parametrize("encoder", PARITY["encoders"])
def test_outputs_equal_the_authors(encoder: str) -> None:
    expected = PARITY["encoders"][encoder]["outputs"]
    with torch.no_grad():
        network = Bts(encoder=encoder, max_depth_m=10.0, focal_reference_px=None).eval()
        fill_by_formula(network)
        rgb, focal_px = reference_input()
        as_on_nyu = network(rgb, focal_px)
        network.max_depth_m, network.focal_reference_px = 80.0, KITTI_FOCAL_PX
        as_on_kitti = network(rgb, focal_px)

    assert_equals_reference(as_on_nyu, expected["nyu_max10_size512"])
    assert_equals_reference(as_on_kitti, expected["kitti_max80_size512"])


@pytest.mark.parametrize("encoder", PARITY["encoders"])
def test_outputs_equal_the_authors_with_fewer_features(encoder: str) -> None:
    network = Bts(encoder=encoder, features=128, max_depth_m=10.0, focal_reference_px=None).eval()
    with torch.no_grad():
        fill_by_formula(network)
        outputs = network(*reference_input())

    assert_equals_reference(outputs, PARITY["encoders"][encoder]["outputs"]["nyu_max10_size128"])


@pytest.mark.parametrize("encoder", PARITY["encoders"])
def test_tensors_are_the_authors_by_name_order_and_shape(encoder: str) -> None:
    expected = PARITY["encoders"][encoder]
    with torch.device("meta"):
        network, small = Bts(encoder=encoder), Bts(encoder=encoder, features=128)

    digest = hashlib.sha256("\n".join(lines_of(network)).encode()).hexdigest()
    assert len(lines_of(network)) == expected["tensors"]
    assert digest == expected["tensors_sha256"]
    assert sum(p.numel() for p in network.parameters()) == expected["parameters"]["512"]
    assert sum(p.numel() for p in small.parameters()) == expected["parameters"]["128"]
    assert network.encoder.freeze_early_layers() == expected["frozen"]


def test_the_full_list_of_tensors_agrees_where_it_is_at_hand() -> None:
    path = Path(__file__).parents[3] / "shared" / "reference" / "bts_parity.json"
    if not path.is_file():
        pytest.skip("the full list is kept outside the repository")
    full = json.loads(path.read_text("utf-8"))["encoders"]
    for name, expected in full.items():
        with torch.device("meta"):
            network = Bts(encoder=name.removesuffix("_bts"))
        assert lines_of(network) == expected["tensors_in_order"]


@pytest.mark.parametrize("ratio", [2, 4, 8])
def test_guidance_equals_planes_drawn_pixel_by_pixel(ratio: int) -> None:
    # Angles up to 0.6 of their range: beyond, the largest patches come near their singularity.
    plane = np.random.default_rng(ratio).random((3, 3, 5)) * np.array([0.6, 1, 1])[:, None, None]

    found = LocalPlanarGuidance(ratio)(torch.from_numpy(plane)[None].float())

    np.testing.assert_allclose(found[0, 0].numpy(), planar_guidance(plane, ratio), rtol=1e-5)


@pytest.mark.parametrize("encoder", ENCODERS)
def test_every_encoder_makes_a_whole_network(encoder: str) -> None:
    with torch.device("meta"):
        depths = Bts(encoder=encoder, features=32).eval()(torch.empty(1, 3, 64, 96), torch.ones(1))

    assert {tuple(part.shape) for part in depths} == {(1, 1, 64, 96)}


@pytest.mark.parametrize("features", [16, 32, 64, 96])
def test_few_features_work_too(features: int) -> None:
    network = Bts(encoder="small", features=features)

    depth_m = network(torch.rand(2, 3, 32, 64), torch.full((2,), 700.0)).depth_m
    depth_m.log().mean().backward()

    assert depth_m.shape == (2, 1, 32, 64)
    assert all(p.grad is not None for p in network.parameters())


@pytest.mark.parametrize("features", [0, 8, 100])
def test_features_that_cannot_be_halved_are_refused(features: int) -> None:
    with pytest.raises(UsageError, match=f"cannot with {features}"):
        Bts(encoder="small", features=features)


def test_sides_that_are_no_multiples_are_named() -> None:
    with pytest.raises(UsageError, match="the batch has 768 x 432"):
        Bts(encoder="small", features=16)(torch.empty(1, 3, 432, 768), torch.ones(1))
