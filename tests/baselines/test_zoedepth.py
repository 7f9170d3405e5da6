"""ZoeDepth: the authors' numbers on the network of transformers."""

from __future__ import annotations

import json
import socket
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

pytest.importorskip("transformers", reason="comes with the extra zoe")

from transformers import ZoeDepthConfig, ZoeDepthForDepthEstimation

from civil_rgbd.baselines.checkpoints import save_model
from civil_rgbd.baselines.model import load_model
from civil_rgbd.baselines.zoedepth import ZoeModel, zoe_input, zoe_small
from civil_rgbd.errors import DownloadError, FormatError, UsageError
from civil_rgbd.geometry.camera import PinholeCamera

from ..reference.zoe_resize import resize_corners

Batch = tuple[torch.Tensor, torch.Tensor]


@pytest.fixture(scope="module")
def published(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder as the hub has it, with its traps: max_depth 10, epsilon 1e-12, drop path 0.1."""
    torch.manual_seed(5)
    folder = tmp_path_factory.mktemp("zoedepth-tiny")
    config = dict(zoe_small().options["config"])
    config["bin_configurations"] = [{"n_bins": 64, "min_depth": 1e-3, "max_depth": 10.0}]
    config["backbone_config"] |= {"layer_norm_eps": 1e-12, "drop_path_rate": 0.1}
    network = ZoeDepthForDepthEstimation(ZoeDepthConfig.from_dict(config))
    for parameter in network.parameters():  # random, but far from the flat start
        parameter.data += 0.05 * torch.randn_like(parameter)
    network.save_pretrained(folder)
    return folder


def load(folder: Path, **options: Any) -> ZoeModel:
    return ZoeModel(str(folder), **{"width_px": 96, "height_px": 64, **options}).eval()


def test_the_input_equals_a_direct_calculation(rgb: NDArray[np.uint8]) -> None:
    tensor = torch.from_numpy(rgb.transpose(2, 0, 1).copy())[None] / 255

    found = zoe_input(tensor, (64, 96))[0].numpy()

    expected = [(resize_corners(rgb[..., c] / 255, 64, 96) - 0.5) / 0.5 for c in range(3)]
    np.testing.assert_allclose(found, expected, atol=1e-5)


def test_a_prediction_equals_a_direct_calculation(
    published: Path, rgb: NDArray[np.uint8], camera: PinholeCamera
) -> None:
    settings = ZoeDepthConfig.from_pretrained(published)
    settings.backbone_config.layer_norm_eps = 1e-6
    settings.bin_configurations = [{"n_bins": 64, "min_depth": 1e-3, "max_depth": 80.0}]
    network = ZoeDepthForDepthEstimation.from_pretrained(published, config=settings).eval()
    planes = [(resize_corners(rgb[..., c] / 255, 64, 96) - 0.5) / 0.5 for c in range(3)]
    with torch.no_grad():
        pixels = torch.from_numpy(np.float32(planes))[None]
        small = network(pixels).predicted_depth[0].numpy().astype(np.float64)

    found = load(published).predict(rgb, camera)

    np.testing.assert_allclose(found, resize_corners(small, 50, 75), rtol=1e-4)
    assert found.std() > 1e-3  # says something about the image


def test_published_settings_are_put_right(published: Path) -> None:
    settings = load(published).network.config

    assert settings.backbone_config.layer_norm_eps == 1e-6
    assert settings.backbone_config.drop_path_rate == 0.0
    assert settings.bin_configurations[0]["max_depth"] == 80.0


def test_the_largest_depth_is_what_was_asked_for(published: Path, batch: Batch) -> None:
    far, near = load(published), load(published, max_depth_m=10.0)

    torch.testing.assert_close(far(*batch), near(*batch) * 8, rtol=1e-3, atol=0)


def test_training_is_not_shaken_by_stochastic_depth(published: Path, batch: Batch) -> None:
    model = load(published)
    expected = model(*batch)

    torch.testing.assert_close(model.train()(*batch), expected)


@pytest.mark.parametrize("head", ["normed", "softplus"])
def test_what_is_not_frozen_gets_a_gradient(head: Any, batch: Batch) -> None:
    model = zoe_small(head=head)

    model(*batch).log().square().mean().backward()

    without = [n for n, p in model.named_parameters() if p.requires_grad and p.grad is None]
    frozen = [n for n, p in model.named_parameters() if not p.requires_grad]
    assert without == []
    assert {n.rsplit(".", 2)[0] for n in frozen} == {
        "network.neck.fusion_stage.layers.0.residual_layer1"
    }


def test_the_two_heads_are_two_networks() -> None:
    bounded, free = (zoe_small(head=head).network for head in ("normed", "softplus"))

    assert bounded.config.bin_centers_type == "normed"
    assert free.config.bin_centers_type == "softplus"
    key = "metric_head.attractors.0.conv2.weight"
    assert len(bounded.state_dict()[key]) == 2 * len(free.state_dict()[key])


def test_groups_hold_every_trained_parameter_once() -> None:
    model = zoe_small()

    groups = model.parameter_groups()

    ids = [id(p) for group in groups.values() for p in group]
    assert sorted(ids) == sorted(id(p) for p in model.parameters() if p.requires_grad)
    backbone = {id(p) for p in model.network.backbone.parameters()}
    assert {id(p) for p in groups["encoder"]} == backbone


def test_a_run_needs_neither_hub_nor_folder(
    published: Path, tmp_path: Path, batch: Batch, monkeypatch: pytest.MonkeyPatch
) -> None:
    model = load(published, head="normed")
    save_model(model, tmp_path / "model.pt")

    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("the network was asked")

    monkeypatch.setattr(socket.socket, "connect", refuse)
    again = load_model(tmp_path)

    assert isinstance(again, ZoeModel)
    assert again.is_trained
    assert torch.equal(again.eval()(*batch), model(*batch))


def test_the_other_head_of_a_run_says_which_tensors_differ(tmp_path: Path) -> None:
    save_model(zoe_small(), tmp_path / "model.pt")

    with pytest.raises(FormatError, match=r"metric_head\.attractors\.0\.conv2\.weight is \(32,"):
        load_model(tmp_path, head="softplus")


def test_published_weights_for_the_other_head_are_warned_of(published: Path) -> None:
    with pytest.warns(UserWarning, match=r"start at random: metric_head\.attractors\.0\.conv2"):
        model = load(published, head="softplus")

    assert model.network.config.bin_centers_type == "softplus"


def test_weights_that_do_not_fit_their_settings_are_refused(
    published: Path, tmp_path: Path
) -> None:
    for path in published.iterdir():
        (tmp_path / path.name).write_bytes(path.read_bytes())
    config = json.loads((tmp_path / "config.json").read_text("utf-8"))
    (tmp_path / "config.json").write_text(json.dumps({**config, "num_attractors": [8, 8, 4, 1]}))

    with pytest.raises(FormatError, match=r"another shape metric_head\.attractors\.0\.conv2"):
        load(tmp_path)


def test_a_folder_of_another_network_is_refused(tmp_path: Path) -> None:
    (tmp_path / "config.json").write_text('{"model_type": "glpn"}')

    with pytest.raises(FormatError, match="describes 'glpn', not ZoeDepth") as caught:
        load(tmp_path)
    assert "transformers:" in caught.value.fix


def test_an_empty_folder_is_told(tmp_path: Path) -> None:
    with pytest.raises(DownloadError, match="cannot load") as caught:
        load(tmp_path)
    assert "config.json" in caught.value.fix


def test_a_hub_out_of_reach_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    import huggingface_hub.constants

    monkeypatch.setattr(huggingface_hub.constants, "HF_HUB_OFFLINE", True)

    with pytest.raises(DownloadError, match="cannot load 'nobody/zoedepth'") as caught:
        ZoeModel("nobody/zoedepth")
    assert "give a folder" in caught.value.fix


@pytest.mark.parametrize(
    ("options", "words"),
    [({"head": "sigmoid"}, "no head 'sigmoid'"), ({"width_px": 100}, "not 100 x 96")],
)
def test_options_that_cannot_be_are_refused(options: dict[str, Any], words: str) -> None:
    with pytest.raises(UsageError, match=words):
        zoe_small(**options)
