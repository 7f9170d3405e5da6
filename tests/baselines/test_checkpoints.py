"""Models on disk: whole, compared tensor by tensor, and never code."""

from __future__ import annotations

import os
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from civil_rgbd.baselines.bts_model import BtsModel, bts_small
from civil_rgbd.baselines.checkpoints import load_weights, read_model_file, save_model
from civil_rgbd.baselines.model import load_model
from civil_rgbd.errors import FormatError, OutputError, UsageError

Batch = tuple[torch.Tensor, torch.Tensor]


def test_a_run_gives_the_same_model_back(tmp_path: Path, batch: Batch) -> None:
    model = bts_small(features=32, max_depth_m=40.0, width_px=96, height_px=64).eval()
    model(*batch)
    save_model(model, tmp_path / "model.pt")

    again = load_model(tmp_path)

    assert isinstance(again, BtsModel)
    assert again.options == model.options
    assert again.is_trained
    assert torch.equal(again.eval()(*batch), model(*batch))
    assert [path.name for path in tmp_path.iterdir()] == ["model.pt"]


def test_an_option_of_a_run_can_be_replaced(tmp_path: Path) -> None:
    save_model(bts_small(), tmp_path / "model.pt")

    again = load_model(tmp_path / "model.pt", rest="crop")

    assert isinstance(again, BtsModel)
    assert again.fit.rest == "crop"


@pytest.mark.parametrize(
    "wrap",
    [
        lambda state: state,
        lambda state: {"model": {f"module.{key}": value for key, value in state.items()}},
        lambda state: {"state_dict": state, "epoch": 3, "best": torch.zeros(9)[0].item()},
        lambda state: {f"_orig_mod.module.{key}": value for key, value in state.items()},
        lambda state: {k: v for k, v in state.items() if "num_batches_tracked" not in k},
    ],
    ids=["plain", "authors", "nested", "compiled", "old torch"],
)
def test_checkpoints_of_others_load_by_name(
    tmp_path: Path, batch: Batch, wrap: Callable[[dict[str, Any]], dict[str, Any]]
) -> None:
    trained, fresh = bts_small(features=32).eval(), bts_small(features=32).eval()
    torch.save(wrap(trained.network.state_dict()), tmp_path / "model-50000.pth")

    load_weights(fresh, tmp_path / "model-50000.pth")

    assert torch.equal(fresh(*batch), trained(*batch))


def test_tensors_of_scores_beside_the_weights_do_no_harm(tmp_path: Path) -> None:
    trained, fresh = bts_small(features=16), bts_small(features=16)
    state = {f"module.{key}": value for key, value in trained.network.state_dict().items()}
    # What the authors' program writes when it evaluates while it trains.
    beside = {
        "global_step": 7,
        "optimizer": {"state": {0: {"exp_avg": torch.zeros(2)}}},
        "best_eval_measures_higher_better": torch.zeros(3),
        "best_eval_measures_lower_better": torch.full((6,), 1e3),
        "best_eval_steps": np.zeros(9, np.int32),
    }
    torch.save({**beside, "model": state}, tmp_path / "model-7-best_d1_0.95")

    load_weights(fresh, tmp_path / "model-7-best_d1_0.95")

    own = fresh.network.state_dict()
    assert all(torch.equal(own[key.removeprefix("module.")], state[key]) for key in state)


def test_counters_in_numpys_arrays_do_no_harm(tmp_path: Path) -> None:
    trained, fresh = bts_small(features=16), bts_small(features=16)
    state = {f"module.{key}": value for key, value in trained.network.state_dict().items()}
    beside = {"steps": np.zeros(9, np.int32), "best": np.float64(0.1), "name": "bts"}
    torch.save({"model": state, **beside}, tmp_path / "zip.pth")
    torch.save(
        {"model": state, **beside}, tmp_path / "old.pth", _use_new_zipfile_serialization=False
    )

    for name in ("zip.pth", "old.pth"):
        load_weights(fresh, tmp_path / name)

    assert fresh.is_trained


def test_weights_of_another_encoder_say_which_tensors_differ(tmp_path: Path) -> None:
    torch.save(BtsModel("mobilenetv2", features=16).network.state_dict(), tmp_path / "w.pth")
    model = bts_small(features=16)
    before = {key: value.clone() for key, value in model.state_dict().items()}

    with pytest.raises(FormatError, match=r"missing: encoder\.base_model\.stage1\.conv1") as e:
        load_weights(model, tmp_path / "w.pth")

    assert "too many: encoder.base_model.0.0.weight" in e.value.what
    assert "decoder.upconv5.conv.weight is (16, 1280, 3, 3), not (16, 128, 3, 3)" in e.value.what
    assert "encoder='small'" in e.value.fix
    assert all(torch.equal(value, before[key]) for key, value in model.state_dict().items())


def test_weights_of_another_variant_say_which_shapes_differ(tmp_path: Path) -> None:
    save_model(bts_small(features=32), tmp_path / "model.pt")

    with pytest.raises(FormatError, match=r"of another shape: .* and \d+ more"):
        load_model(tmp_path, features=48)


@pytest.mark.parametrize("share", [0.0, 0.3, 0.99])
def test_a_file_that_is_cut_off_is_refused(tmp_path: Path, share: float) -> None:
    path = tmp_path / "model.pt"
    save_model(bts_small(features=16), path)
    path.write_bytes(path.read_bytes()[: int(path.stat().st_size * share)])

    with pytest.raises(FormatError, match="cannot be read as tensors") as caught:
        read_model_file(path)
    assert "cut off" in caught.value.fix


def test_a_checkpoint_runs_no_code(tmp_path: Path) -> None:
    class Trap:
        def __reduce__(self) -> tuple[Any, ...]:
            return os.mkdir, (str(tmp_path / "sprung"),)

    (tmp_path / "w.pth").write_bytes(pickle.dumps(Trap()))
    torch.save({"model": Trap()}, tmp_path / "v.pth")

    for name, words in (("w.pth", "operand"), ("v.pth", "mkdir")):
        with pytest.raises(FormatError, match=f"cannot be read as tensors: .*{words}") as caught:
            load_weights(bts_small(features=16), tmp_path / name)
        assert "weights_only" not in caught.value.what  # torch advises to run the file's code
    assert not (tmp_path / "sprung").exists()


@pytest.mark.parametrize(
    ("document", "words"),
    [
        ({"epoch": 3}, "no tensors under model, state_dict"),
        ({}, "it has nothing"),
        ([torch.zeros(1)], "holds a list"),
    ],
)
def test_a_file_without_weights_says_what_it_holds(
    tmp_path: Path, document: object, words: str
) -> None:
    torch.save(document, tmp_path / "w.pth")

    with pytest.raises(FormatError, match=words):
        load_weights(bts_small(features=16), tmp_path / "w.pth")


def test_others_checkpoints_are_no_runs(tmp_path: Path) -> None:
    torch.save(bts_small(features=16).network.state_dict(), tmp_path / "model.pt")

    with pytest.raises(FormatError, match=r"no model of civil_rgbd; it holds encoder\.") as caught:
        load_model(tmp_path)
    assert "load_weights" in caught.value.fix


def test_a_newer_file_is_refused_by_its_version(tmp_path: Path) -> None:
    save_model(bts_small(features=16), tmp_path / "model.pt")
    document = torch.load(tmp_path / "model.pt", weights_only=True)
    torch.save({**document, "civil_rgbd_model": 2}, tmp_path / "model.pt")

    with pytest.raises(FormatError, match="version 2; this release reads up to 1"):
        load_model(tmp_path)


def test_a_missing_file_and_a_missing_folder_are_told(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="no such file"):
        load_weights(bts_small(features=16), tmp_path / "w.pth")
    with pytest.raises(OutputError, match="cannot write: "):
        save_model(bts_small(features=16), tmp_path / "nowhere" / "model.pt")


def test_safetensors_load_too(tmp_path: Path, batch: Batch) -> None:
    safetensors = pytest.importorskip("safetensors.torch", reason="comes with the extra zoe")
    trained, fresh = bts_small(features=16).eval(), bts_small(features=16).eval()
    safetensors.save_file(trained.network.state_dict(), tmp_path / "w.safetensors")

    load_weights(fresh, tmp_path / "w.safetensors")

    assert torch.equal(fresh(*batch), trained(*batch))
    (tmp_path / "w.safetensors").write_bytes(b"cut")
    with pytest.raises(FormatError, match="cannot be read as tensors"):
        load_weights(fresh, tmp_path / "w.safetensors")


@pytest.mark.parametrize(
    "text", ["<!doctype html><title>404</title>", "ever the same words\n", "epoch,loss\n1,2\n", "."]
)
def test_text_that_was_saved_as_a_checkpoint_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "model.pt").write_text(text, "utf-8")

    with pytest.raises(FormatError, match=r"the file cannot be read as tensors: \w"):
        load_model(tmp_path)


def test_a_model_file_without_weights_says_what_it_lacks(tmp_path: Path) -> None:
    torch.save({"civil_rgbd_model": 1, "name": "bts-small"}, tmp_path / "model.pt")

    with pytest.raises(FormatError, match="the model file lacks options, weights"):
        load_model(tmp_path)


def test_long_options_are_cut_short_in_messages(tmp_path: Path) -> None:
    model = bts_small(features=16)
    model.options["config"] = "x" * 5000
    torch.save({"a": torch.zeros(1)}, tmp_path / "w.pth")

    with pytest.raises(FormatError, match="the weights are not those") as caught:
        load_weights(model, tmp_path / "w.pth")
    assert len(caught.value.fix) < 500
