"""Any metric depth model of transformers, on tiny random weights."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

pytest.importorskip("transformers", reason="comes with the extra zoe")

from transformers import AutoConfig, AutoModelForDepthEstimation

from civil_rgbd.baselines.checkpoints import save_model
from civil_rgbd.baselines.model import load_model
from civil_rgbd.baselines.torch_model import TorchDepthModel
from civil_rgbd.baselines.transformers_model import Preparation, TransformersModel
from civil_rgbd.baselines.zoedepth import ZoeModel, zoe_small
from civil_rgbd.errors import FormatError, UsageError
from civil_rgbd.geometry.camera import PinholeCamera

Batch = tuple[torch.Tensor, torch.Tensor]

_DINO = {
    "model_type": "dinov2",
    "hidden_size": 16,
    "num_hidden_layers": 4,
    "num_attention_heads": 2,
    "intermediate_size": 32,
}
_PRO = {**_DINO, "num_hidden_layers": 2, "image_size": 16, "patch_size": 4}
CONFIGS: dict[str, dict[str, Any]] = {
    "depth_anything": {
        "depth_estimation_type": "metric",
        "max_depth": 80,
        "patch_size": 14,
        "fusion_hidden_size": 8,
        "reassemble_hidden_size": 16,
        "neck_hidden_sizes": [8, 8, 8, 8],
        "head_hidden_size": 8,
        "backbone_config": {
            **_DINO,
            "image_size": 70,
            "patch_size": 14,
            "out_indices": [1, 2, 3, 4],
            "reshape_hidden_states": False,
        },
    },
    "glpn": {
        "hidden_sizes": [8, 8, 16, 16],
        "depths": [1, 1, 1, 1],
        "decoder_hidden_size": 8,
        "num_attention_heads": [1, 1, 2, 2],
    },
    "depth_pro": {
        "patch_size": 16,
        "fusion_hidden_size": 8,
        "intermediate_hook_ids": [1, 0],
        "intermediate_feature_dims": [8, 8],
        "scaled_images_feature_dims": [8, 8, 8],
        "image_model_config": _PRO,
        "patch_model_config": _PRO,
        "fov_model_config": _PRO,
    },
}
SMALL_INPUT = {"depth_anything": {"height_px": 70, "width_px": 70}}


def make(kind: str, **options: Any) -> TransformersModel:
    config = {"model_type": kind, **CONFIGS[kind]}
    return TransformersModel(config=config, preparation=SMALL_INPUT.get(kind), **options)


@pytest.fixture(params=CONFIGS)
def kind(request: pytest.FixtureRequest) -> str:
    return str(request.param)


def test_it_answers_metres_of_the_images_size(
    kind: str, rgb: NDArray[np.uint8], camera: PinholeCamera
) -> None:
    depth_m = make(kind).predict(rgb, camera)

    assert depth_m.shape == rgb.shape[:2]
    assert depth_m.dtype == np.float32
    assert np.isfinite(depth_m).all()
    assert (depth_m > 0).all()


def test_what_is_not_frozen_gets_a_gradient_and_is_in_one_group(kind: str, batch: Batch) -> None:
    model = make(kind)

    model(*batch).log().mean().backward()

    trained = [p for p in model.parameters() if p.requires_grad]
    groups = model.parameter_groups()
    assert all(p.grad is not None for p in trained)
    assert sorted(id(p) for g in groups.values() for p in g) == sorted(map(id, trained))
    assert all(groups.values())


def test_a_run_gives_the_same_model_back(kind: str, batch: Batch, tmp_path: Path) -> None:
    model = make(kind).eval()
    save_model(model, tmp_path / "model.pt")

    again = load_model(tmp_path)

    assert isinstance(again, TorchDepthModel)
    assert torch.equal(again.eval()(*batch), model(*batch))


def test_an_answer_equals_a_direct_calculation(
    tmp_path: Path, rgb: NDArray[np.uint8], camera: PinholeCamera
) -> None:
    config = AutoConfig.for_model("depth_anything", **CONFIGS["depth_anything"])
    network = AutoModelForDepthEstimation.from_config(config).eval()
    network.save_pretrained(tmp_path)
    said = {
        "size": {"height": 56, "width": 84},
        "image_mean": [0.4, 0.5, 0.6],
        "image_std": [0.2, 0.3, 0.4],
        "resample": 2,
        "ensure_multiple_of": 14,
        "keep_aspect_ratio": False,
    }
    (tmp_path / "preprocessor_config.json").write_text(json.dumps(said))
    image = torch.from_numpy(rgb.transpose(2, 0, 1).copy())[None] / 255
    resized = torch.nn.functional.interpolate(image, (56, 84), mode="bilinear", antialias=True)
    mean, deviation = (torch.tensor(said[k]).view(3, 1, 1) for k in ("image_mean", "image_std"))
    with torch.no_grad():
        small = network((resized - mean) / deviation).predicted_depth[None]
    expected = torch.nn.functional.interpolate(small, (50, 75), mode="bilinear")[0, 0]

    model = load_model(f"transformers:{tmp_path}")

    assert isinstance(model, TransformersModel)
    np.testing.assert_allclose(model.predict(rgb, camera), expected.numpy(), rtol=1e-4)


def test_a_doubled_focal_length_doubles_the_depth_of_depth_pro(batch: Batch) -> None:
    model = make("depth_pro").eval()
    doubled = batch[1] * torch.tensor([[2.0, 1, 1], [1, 1, 1], [1, 1, 1]])  # fx alone

    torch.testing.assert_close(model(batch[0], doubled), 2 * model(*batch))


def test_relative_depth_is_refused() -> None:
    config = {"model_type": "depth_anything", "depth_estimation_type": "relative"}

    with pytest.raises(UsageError, match="relative depth, which has no unit") as caught:
        TransformersModel(config=config)
    assert "metric=True" in caught.value.fix


def test_a_network_that_estimates_no_depth_is_refused() -> None:
    with pytest.raises(FormatError, match="a 'bert' estimates no depth") as caught:
        TransformersModel(config={"model_type": "bert"})
    assert "depth_anything" in caught.value.fix


def test_no_source_is_a_question() -> None:
    with pytest.raises(UsageError, match="no model is named"):
        load_model("transformers")


def test_zoedepth_is_loaded_as_our_own(tmp_path: Path) -> None:
    zoe_small().network.save_pretrained(tmp_path)

    model = load_model(f"transformers:{tmp_path}")

    assert isinstance(model, ZoeModel)
    assert model.max_depth_m == 80.0


@pytest.mark.parametrize(
    ("rule", "size"),
    [
        (Preparation(518, 518, keep_aspect=True, side_multiple=14), (518, 924)),
        (Preparation(384, 384, side_multiple=32), (384, 384)),
        (Preparation(side_multiple=32, round_down=True), (416, 768)),
        (Preparation(), (432, 768)),
    ],
)
def test_sizes_are_those_of_the_processors(rule: Preparation, size: tuple[int, int]) -> None:
    assert rule.size(height_px=432, width_px=768) == size


def test_a_depth_without_bound_says_so() -> None:
    assert make("depth_pro").max_depth_m == math.inf
    assert make("glpn").max_depth_m == 10.0
