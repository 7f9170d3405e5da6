"""Which model it is: known by content, or not at all."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from civil_rgbd.baselines.bts_model import bts_small
from civil_rgbd.baselines.checkpoints import save_model
from civil_rgbd.baselines.identity import model_sha256, run_folder_of
from civil_rgbd.baselines.model import load_model


def test_a_run_is_named_by_its_folder_or_its_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    save_model(bts_small(features=16), tmp_path / "model.pt")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "bts").mkdir()

    assert run_folder_of(tmp_path) == tmp_path
    assert run_folder_of(tmp_path / "model.pt") == tmp_path
    assert run_folder_of("bts") is None  # load_model takes the name before the folder
    assert run_folder_of("predictions:elsewhere") is None


def test_a_run_is_known_by_its_weights(tmp_path: Path) -> None:
    hashes = []
    for seed in (0, 0, 1):
        torch.manual_seed(seed)
        save_model(bts_small(features=16), tmp_path / "model.pt")
        hashes.append(model_sha256(load_model(tmp_path), tmp_path))
    by_file = model_sha256(load_model(tmp_path), tmp_path / "model.pt")

    assert hashes[0] == hashes[1] != hashes[2]
    assert by_file == hashes[2]


def test_a_built_in_network_is_known_by_options_and_weights() -> None:
    def hash_of(seed: int, **options: float) -> str | None:
        torch.manual_seed(seed)
        return model_sha256(load_model("bts-small", features=16, **options), "bts-small")

    assert hash_of(0) == hash_of(0)
    assert len({hash_of(0), hash_of(1), hash_of(0, max_depth_m=40.0)}) == 3


def test_what_may_lean_on_anything_is_not_known(tmp_path: Path) -> None:
    (tmp_path / "own.py").write_text(
        "class Own:\n    def predict(self, rgb, camera):\n        return rgb[..., 0]\n"
    )
    own, stored = f"{tmp_path / 'own.py'}:Own", f"predictions:{tmp_path}"

    assert model_sha256(load_model(own), own) is None
    assert model_sha256(load_model(stored), stored) is None
