"""ImageNet weights: by name, old names too, never at construction."""

from __future__ import annotations

import hashlib
import socket
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from civil_rgbd.baselines import imagenet
from civil_rgbd.baselines.bts import Bts
from civil_rgbd.baselines.encoders import ENCODERS, TappedEncoder
from civil_rgbd.baselines.imagenet import load_encoder_weights
from civil_rgbd.errors import DownloadError, FormatError, UsageError


def as_torchvision_publishes(encoder: TappedEncoder) -> dict[str, torch.Tensor]:
    """The same tensors as in DenseNet's old file: prefixed, with norm.1, and a classifier."""
    state = {
        f"features.{key}".replace("norm1.", "norm.1.")
        .replace("norm2.", "norm.2.")
        .replace("conv1.", "conv.1.")
        .replace("conv2.", "conv.2."): value
        for key, value in encoder.base_model.state_dict().items()
        if "num_batches_tracked" not in key
    }
    return {**state, "classifier.weight": torch.zeros(1000, 4), "classifier.bias": torch.zeros(4)}


def test_densenets_old_names_are_understood(tmp_path: Path) -> None:
    published, fresh = TappedEncoder("densenet121"), TappedEncoder("densenet121")
    torch.save(as_torchvision_publishes(published), tmp_path / "densenet121.pth")

    load_encoder_weights(fresh, tmp_path / "densenet121.pth")

    expected = published.base_model.state_dict()
    found = fresh.base_model.state_dict()
    assert all(torch.equal(value, found[key]) for key, value in expected.items())


def test_weights_of_another_encoder_are_refused(tmp_path: Path) -> None:
    torch.save(TappedEncoder("mobilenetv2").base_model.state_dict(), tmp_path / "w.pth")

    with pytest.raises(FormatError, match=r"not those of this encoder.*stage1\.conv1") as caught:
        load_encoder_weights(TappedEncoder("small"), tmp_path / "w.pth")
    assert "very encoder" in caught.value.fix


def test_a_classifier_of_other_classes_does_no_harm(tmp_path: Path) -> None:
    encoder = TappedEncoder("resnet50")
    state = encoder.base_model.state_dict()
    torch.save({**state, "fc.weight": torch.zeros(7, 2048)}, tmp_path / "w.pth")
    torch.nn.init.zeros_(encoder.base_model.get_parameter("conv1.weight"))

    load_encoder_weights(encoder, tmp_path / "w.pth")

    assert bool(encoder.base_model.get_parameter("conv1.weight").any())


def test_nothing_is_fetched_when_a_network_is_made(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("the network was asked")

    monkeypatch.setattr(socket, "create_connection", refuse)
    with torch.device("meta"):
        for encoder in ENCODERS:
            Bts(encoder=encoder, features=16)


def test_published_files_are_fetched_and_their_hash_is_checked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    published, fresh = TappedEncoder("mobilenetv2"), TappedEncoder("mobilenetv2")
    served = tmp_path / "served"
    served.mkdir()
    torch.save(
        {f"features.{k}": v for k, v in published.base_model.state_dict().items()},
        served / "weights.pth",
    )
    digest = hashlib.sha256((served / "weights.pth").read_bytes()).hexdigest()[:8]
    (served / "weights.pth").rename(served / f"mobilenet_v2-{digest}.pth")
    monkeypatch.setattr(torch.hub, "_hub_dir", str(tmp_path / "cache"))
    monkeypatch.setattr(imagenet, "_ADDRESS", f"{served.as_uri()}/")

    fresh.spec = replace(published.spec, weights_file=f"mobilenet_v2-{digest}.pth")
    load_encoder_weights(fresh)

    assert torch.equal(
        fresh.base_model.get_parameter("0.0.weight"),
        published.base_model.get_parameter("0.0.weight"),
    )
    (served / f"mobilenet_v2-{digest}.pth").rename(served / "mobilenet_v2-00000000.pth")
    fresh.spec = replace(published.spec, weights_file="mobilenet_v2-00000000.pth")
    with pytest.raises(DownloadError, match="invalid hash value"):
        load_encoder_weights(fresh)


def test_without_a_network_the_error_names_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(torch.hub, "_hub_dir", str(tmp_path / "cache"))
    monkeypatch.setattr(imagenet, "_ADDRESS", f"{(tmp_path / 'nowhere').as_uri()}/")

    with pytest.raises(DownloadError, match="cannot fetch ImageNet weights") as caught:
        load_encoder_weights(TappedEncoder("mobilenetv2"))
    assert caught.value.where.endswith("mobilenet_v2-b0353104.pth")

    kept = tmp_path / "cache" / "checkpoints"
    assert f"put it into {kept}" in caught.value.fix
    kept.mkdir(parents=True, exist_ok=True)
    fresh, other = TappedEncoder("mobilenetv2"), TappedEncoder("mobilenetv2")
    torch.save(other.base_model.state_dict(), kept / "mobilenet_v2-b0353104.pth")
    load_encoder_weights(fresh)  # as the fix says
    name = "0.0.weight"
    assert torch.equal(fresh.base_model.get_parameter(name), other.base_model.get_parameter(name))


def test_the_small_encoder_has_none() -> None:
    with pytest.raises(UsageError, match="nobody published"):
        load_encoder_weights(TappedEncoder("small"))
