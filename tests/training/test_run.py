"""Training runs: they learn, go on exactly after a kill, and refuse what cannot be."""

from __future__ import annotations

import json
import os
import shutil
import signal
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import multiprocessing

from civil_rgbd.baselines.checkpoints import read_model_file
from civil_rgbd.baselines.model import load_model
from civil_rgbd.domain.split import Split
from civil_rgbd.errors import FormatError, TrainingError, UsageError
from civil_rgbd.evaluation.run import evaluate
from civil_rgbd.format.split_files import read_split
from civil_rgbd.lineage import Seen, lineage_of, seen_of
from civil_rgbd.training.frames import TrainingFrames
from civil_rgbd.training.job import TrainingJob, TrainingOptions
from civil_rgbd.training.journal import StepRecord, read_steps
from civil_rgbd.training.run import train

from .conftest import SPLIT, ids, learnable_frame, tiny_recipe, write_bridge

QUIET = TrainingOptions(tensorboard=False)


def job(data: Path, out: Path, *settings: str, **changes: Any) -> TrainingJob:
    return replace(TrainingJob(data, SPLIT, tiny_recipe(*settings), out), **changes)


def weights(run: Path) -> dict[str, torch.Tensor]:
    return dict(read_model_file(run / "model.pt").weights)


def assert_same_weights(a: Path, b: Path) -> None:
    one, other = weights(a), weights(b)
    assert one.keys() == other.keys()
    assert all(torch.equal(one[name], other[name]) for name in one)


@pytest.mark.slow
def test_one_batch_is_learnt_by_heart(learnable: Path, tmp_path: Path) -> None:
    by_heart = Split(train={"B1": ids(0, 1, 2, 3)}, tests={"all": {"B1": ids(0, 1, 2, 3)}})
    settings = (
        *("augment.flip=0.0", "augment.roll_deg=0.0", "augment.colour=0.0"),
        *("run.steps=50", "optimiser.learning_rate=3e-3", "run.checkpoint_every=1000"),
        *("model_options.features=32", "model_options.max_depth_m=20.0"),
    )
    report = train(job(learnable, tmp_path / "run", *settings, split=by_heart), QUIET)
    test = Split(train={}, tests=by_heart.tests)
    scores = evaluate(load_model(tmp_path / "run"), learnable, test).scores("all")

    assert scores.per_image["abs_rel"] < 0.05
    assert report.steps == 50
    assert report.last_loss < 1


def test_a_run_leaves_model_split_steps_and_no_checkpoint(learnable: Path, tmp_path: Path) -> None:
    seen: list[tuple[int, int]] = []
    options = TrainingOptions(on_step=lambda record, steps: seen.append((record.step, steps)))
    report = train(job(learnable, tmp_path / "run", "run.steps=4"), options)

    assert sorted(path.name for path in (tmp_path / "run").iterdir()) == [
        "model.pt",
        "run.json",
        "split.json",
        "steps.csv",
        "tensorboard",
    ]
    assert read_split(tmp_path / "run" / "split.json") == SPLIT
    assert seen == [(1, 4), (2, 4), (3, 4), (4, 4)]
    assert (report.frames, report.steps, report.steps_found) == (12, 4, 0)
    assert [record.step for record in read_steps(tmp_path / "run")] == [1, 2, 3, 4]
    assert all(record.valid_pixels > 1000 for record in read_steps(tmp_path / "run"))
    assert list((tmp_path / "run" / "tensorboard").iterdir())


def test_the_seed_decides_and_workers_do_not(learnable: Path, tmp_path: Path) -> None:
    train(job(learnable, tmp_path / "a", "run.steps=3"), QUIET)
    train(job(learnable, tmp_path / "b", "run.steps=3"), replace(QUIET, workers=1))
    train(job(learnable, tmp_path / "c", "run.steps=3", seed=1), QUIET)

    assert read_steps(tmp_path / "a") == read_steps(tmp_path / "b")
    assert_same_weights(tmp_path / "a", tmp_path / "b")
    assert read_steps(tmp_path / "a")[0].loss != read_steps(tmp_path / "c")[0].loss


def killed_at(step: int, data: str, out: str) -> None:
    torch.set_num_threads(1)

    def kill(record: StepRecord, _steps: int) -> None:
        if record.step == step:
            os.kill(os.getpid(), signal.SIGKILL)

    train(job(Path(data), Path(out), *RESUMED), replace(QUIET, on_step=kill))


RESUMED = ("run.steps=10", "run.ema_decay=0.9", "augment.zoom=1.2")


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="Windows has no SIGKILL")
@pytest.mark.usefixtures("spawned_tests")
def test_a_killed_run_goes_on_as_if_it_had_not_been(learnable: Path, tmp_path: Path) -> None:
    context = multiprocessing.get_context("spawn")
    process = context.Process(target=killed_at, args=(8, str(learnable), str(tmp_path / "killed")))
    process.start()
    process.join()
    assert process.exitcode == -signal.SIGKILL
    assert len(read_steps(tmp_path / "killed")) == 8  # two more than the checkpoint has
    report = train(job(learnable, tmp_path / "killed", *RESUMED), QUIET)
    train(job(learnable, tmp_path / "whole", *RESUMED), QUIET)

    assert report.steps_found == 6
    steps = [(tmp_path / run / "steps.csv").read_bytes() for run in ("killed", "whole")]
    assert steps[0] == steps[1]
    assert_same_weights(tmp_path / "killed", tmp_path / "whole")


def test_a_finished_run_is_left_alone(learnable: Path, tmp_path: Path) -> None:
    wanted = job(learnable, tmp_path / "run", "run.steps=2")
    train(wanted, QUIET)
    before = (tmp_path / "run" / "model.pt").stat().st_mtime_ns
    report = train(wanted, QUIET)

    assert (report.steps, report.steps_found) == (2, 2)
    assert (tmp_path / "run" / "model.pt").stat().st_mtime_ns == before


def test_another_run_in_the_folder_is_refused_and_overwritten_on_request(
    learnable: Path, tmp_path: Path
) -> None:
    train(job(learnable, tmp_path / "run", "run.steps=2"), QUIET)
    other = job(learnable, tmp_path / "run", "run.steps=3", seed=5)
    with pytest.raises(
        TrainingError, match=r"another run lies here: run\.steps 2 -> 3, seed 0 -> 5"
    ):
        train(other, QUIET)
    train(other, replace(QUIET, overwrite=True))

    assert len(read_steps(tmp_path / "run")) == 3
    (tmp_path / "run" / "steps.csv").unlink()
    with pytest.raises(TrainingError, match=r"a model and no steps\.csv"):
        train(other, QUIET)
    report = train(other, replace(QUIET, overwrite=True))
    assert report.steps_found == 0  # the same run, anew


def test_a_run_that_never_began_leaves_its_folder_to_the_next(
    learnable: Path, tmp_path: Path
) -> None:
    wrong = job(learnable, tmp_path / "run", "run.steps=1", "model_options.encoder=none")
    with pytest.raises(UsageError, match="no encoder 'none'"):
        train(wrong, QUIET)
    (tmp_path / "cut.pt").write_bytes(b"PK")
    cut = {"weights": tmp_path / "cut.pt"}
    with (
        pytest.warns(UserWarning, match="nobody wrote down"),
        pytest.raises(FormatError, match="cannot be read as tensors"),
    ):
        train(job(learnable, tmp_path / "run", "run.steps=1", **cut), QUIET)
    assert list((tmp_path / "run").iterdir()) == []

    assert train(job(learnable, tmp_path / "run", "run.steps=1"), QUIET).steps == 1


def test_a_run_that_began_keeps_its_folder(learnable: Path, tmp_path: Path) -> None:
    def stop(_record: StepRecord, _steps: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train(job(learnable, tmp_path / "run", "run.steps=3"), replace(QUIET, on_step=stop))
    with pytest.raises(TrainingError, match=r"another run lies here: run\.steps 3 -> 2"):
        train(job(learnable, tmp_path / "run", "run.steps=2"), QUIET)
    assert len(read_steps(tmp_path / "run")) == 1


def test_a_run_of_other_data_or_other_first_weights_is_another_run(
    tmp_path: Path, learnable: Path
) -> None:
    import shutil

    shutil.copytree(learnable, tmp_path / "data")
    train(job(tmp_path / "data", tmp_path / "run", "run.steps=1"), QUIET)
    assert train(job(learnable, tmp_path / "run", "run.steps=1"), QUIET).steps_found == 1
    shutil.rmtree(tmp_path / "data" / "bridges" / "B1")
    other = [learnable_frame(7, number) for number in range(6)]
    write_bridge(tmp_path / "data" / "bridges" / "B1", other)
    with pytest.raises(TrainingError, match=r"another run lies here: data .{12}\.\.\. -> "):
        train(job(tmp_path / "data", tmp_path / "run", "run.steps=1"), QUIET)

    again = {"weights": tmp_path / "run"}
    train(job(learnable, tmp_path / "second", "run.steps=1", **again), QUIET)
    (tmp_path / "moved").mkdir()
    for name in ("model.pt", "split.json", "run.json"):
        (tmp_path / "run" / name).rename(tmp_path / "moved" / name)
    moved = {"weights": tmp_path / "moved"}
    assert train(job(learnable, tmp_path / "second", "run.steps=1", **moved), QUIET).steps == 1
    (tmp_path / "second" / "model.pt").replace(tmp_path / "moved" / "model.pt")
    with pytest.raises(TrainingError, match="another run lies here: weights"):
        train(job(learnable, tmp_path / "second", "run.steps=1", **moved), QUIET)


UNNAMED = """
from civil_rgbd.baselines.bts_model import bts_small

def nameless():
    model = bts_small(features=16)
    model.name = "nameless"
    return model

"""


def test_a_model_that_nobody_could_load_is_refused_before_it_is_trained(
    learnable: Path, tmp_path: Path
) -> None:
    (tmp_path / "own.py").write_text(UNNAMED)
    plain = tiny_recipe("run.steps=1", "input.width_px=0")
    named = replace(plain, model=f"{tmp_path / 'own.py'}:nameless", model_options={})
    with pytest.raises(UsageError, match="no installed model has that name") as caught:
        train(TrainingJob(learnable, SPLIT, named, tmp_path / "run"), QUIET)
    assert "entry point 'nameless'" in caught.value.fix

    resized = replace(named, input=replace(named.input, width_px=96))
    with pytest.raises(UsageError, match="takes no height_px and width_px") as caught:
        train(TrainingJob(learnable, SPLIT, resized, tmp_path / "other"), QUIET)
    assert "input.model_resizes = false" in caught.value.fix


def test_the_average_of_the_weights_is_what_is_saved(learnable: Path, tmp_path: Path) -> None:
    settings = ("run.steps=3", "run.norm_batches=0")
    train(job(learnable, tmp_path / "plain", *settings), QUIET)
    train(job(learnable, tmp_path / "mean", *settings, "run.ema_decay=0.5"), QUIET)

    assert read_steps(tmp_path / "plain") == read_steps(tmp_path / "mean")
    plain, mean = weights(tmp_path / "plain"), weights(tmp_path / "mean")
    assert any(not torch.equal(plain[name], mean[name]) for name in plain)


def test_norms_are_estimated_once_more_on_request(learnable: Path, tmp_path: Path) -> None:
    train(job(learnable, tmp_path / "lag", "run.steps=3", "run.norm_batches=0"), QUIET)
    train(job(learnable, tmp_path / "new", "run.steps=3", "run.norm_batches=2"), QUIET)
    lag, new = weights(tmp_path / "lag"), weights(tmp_path / "new")

    differing = {name.rpartition(".")[2] for name in lag if not torch.equal(lag[name], new[name])}
    assert differing <= {"running_mean", "running_var", "num_batches_tracked"}
    assert "running_mean" in differing


def test_mixed_precision_and_clipping_train(learnable: Path, tmp_path: Path) -> None:
    settings = ("run.steps=2", "run.amp=bfloat16", "optimiser.clip_norm=0.01")
    report = train(job(learnable, tmp_path / "run", *settings), QUIET)

    assert np.isfinite(report.last_loss)
    assert read_steps(tmp_path / "run")[0].gradient_norm > 0.01  # before clipping


def test_training_can_start_from_another_run(learnable: Path, tmp_path: Path) -> None:
    train(job(learnable, tmp_path / "first", "run.steps=2"), QUIET)
    settings = ("run.steps=1", "optimiser.learning_rate=1e-12", "run.norm_batches=0")
    wanted = job(learnable, tmp_path / "second", *settings, weights=tmp_path / "first")
    train(wanted, QUIET)
    first, second = weights(tmp_path / "first"), weights(tmp_path / "second")

    for name in first:
        if "running" not in name and "tracked" not in name:
            torch.testing.assert_close(first[name], second[name], rtol=1e-5, atol=1e-6)


def test_weights_that_have_seen_what_is_scored_are_warned_of(
    learnable: Path, tmp_path: Path
) -> None:
    train(job(learnable, tmp_path / "first", "run.steps=1"), QUIET)
    turned = Split(train={"B3": ids(0, 1, 2, 3)}, tests={"all": {"B1": ids(1, 2)}})
    wanted = job(learnable, tmp_path / "second", "run.steps=1", split=turned)
    with pytest.warns(UserWarning, match="was trained with 2 frames that are scored of this run"):
        train(replace(wanted, weights=tmp_path / "first"), QUIET)

    again = job(learnable, tmp_path / "third", "run.steps=1", split=turned)
    with pytest.warns(UserWarning, match="second was trained with 2 frames that are scored"):
        train(replace(again, weights=tmp_path / "second" / "model.pt"), QUIET)
    lineage = lineage_of(tmp_path / "third" / "model.pt")
    assert lineage is not None
    assert lineage.trained_with == {**SPLIT.train, "B3": ids(0, 1, 2, 3)}
    assert seen_of(lineage, turned.scored()) == Seen(trained=6, scored=2)


def test_weights_that_are_no_runs_are_warned_of_and_written_down(
    learnable: Path, tmp_path: Path
) -> None:
    train(job(learnable, tmp_path / "first", "run.steps=1"), QUIET)
    shutil.copy(tmp_path / "first" / "model.pt", tmp_path / "theirs.pt")
    wanted = job(learnable, tmp_path / "second", "run.steps=1")
    with pytest.warns(UserWarning, match=r"nobody wrote down which frames theirs\.pt was trained"):
        train(replace(wanted, weights=tmp_path / "theirs.pt"), QUIET)

    document = json.loads((tmp_path / "second" / "run.json").read_text("utf-8"))
    assert document["first_weights"] == {
        "name": "theirs.pt",
        "trained_with": {},
        "unknown": ["theirs.pt"],
    }
    assert seen_of(lineage_of(tmp_path / "second"), {"B3": ()}).unknown == ("theirs.pt",)


def test_a_loss_that_is_not_finite_names_the_frames(learnable: Path, tmp_path: Path) -> None:
    wanted = job(learnable, tmp_path / "run", "run.steps=20", "optimiser.learning_rate=1e30")
    with pytest.raises(TrainingError, match="the training diverged") as caught:
        train(wanted, QUIET)

    assert "frames B" in caught.value.where
    assert not (tmp_path / "run" / "model.pt").exists()


def test_a_damaged_checkpoint_is_refused(learnable: Path, tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "checkpoint.pt").write_bytes(b"PK\x03\x04 cut off")
    with pytest.raises(FormatError, match="the checkpoint cannot be read"):
        train(job(learnable, tmp_path / "run", "run.steps=2"), QUIET)
    assert (tmp_path / "run" / "checkpoint.pt").exists()  # whose it is, nobody here knows


def test_a_set_without_a_measured_pixel_is_refused(tmp_path: Path) -> None:
    empty = [replace(learnable_frame(1, i), depth_m=np.zeros((64, 96), np.float32)) for i in (0, 1)]
    write_bridge(tmp_path / "data" / "bridges" / "B1", empty)
    split = Split(train={"B1": ids(0, 1)}, tests={})
    with pytest.raises(UsageError, match="nothing to learn: none of 2 training frames"):
        train(job(tmp_path / "data", tmp_path / "run", "run.steps=2", split=split), QUIET)


def test_an_epoch_without_a_pixel_in_range_is_refused(tmp_path: Path) -> None:
    for bridge in (1, 2, 3):
        frame = learnable_frame(bridge, 0)
        # The index says 2 to 50 m; nothing lies between 20 and 40.
        around = np.where(frame.depth_m > 10, np.float32(50), frame.depth_m.clip(0, 2))
        frames = [
            replace(frame, depth_m=around),
            replace(learnable_frame(bridge, 1), depth_m=around),
        ]
        write_bridge(tmp_path / "data" / "bridges" / f"B{bridge}", frames)
    split = Split(train={"B1": ids(0, 1), "B2": ids(0, 1)}, tests={"all": {"B3": ids(0, 1)}})
    settings = ("run.steps=50", "input.min_depth_m=20", "input.max_depth_m=40")
    with pytest.raises(TrainingError, match="no pixel was measured between 20 and 40 m"):
        train(job(tmp_path / "data", tmp_path / "run", *settings, split=split), QUIET)

    assert not (tmp_path / "run" / "model.pt").exists()
    assert len(read_steps(tmp_path / "run")) == 1  # an epoch, a batch


def test_what_is_not_there_is_refused(learnable: Path, tmp_path: Path) -> None:
    wanted = job(learnable, tmp_path / "run", "run.steps=2")
    with pytest.raises(UsageError, match="there is no such model: 'bts-smal'"):
        train(replace(wanted, recipe=replace(wanted.recipe, model="bts-smal")), QUIET)
    more = Split({"B1": ids(0, 99)}, {})
    with pytest.raises(UsageError, match="there is no frame '000099'"):
        train(job(learnable, tmp_path / "b", "run.steps=2", split=more), QUIET)
    with pytest.raises(UsageError, match="there is no device 'nonsense'"):
        train(job(learnable, tmp_path / "c", "run.steps=2"), replace(QUIET, device="nonsense"))


def test_images_too_small_for_the_model_are_refused(learnable: Path, tmp_path: Path) -> None:
    wanted = job(learnable, tmp_path / "run", "run.steps=2", "input.width_px=30")
    with pytest.raises(UsageError, match="30 x 20 px, and the model takes multiples of 32 px"):
        train(wanted, QUIET)


def test_crops_follow_recipe_image_and_model(learnable: Path) -> None:
    frames = TrainingFrames(
        learnable,
        SPLIT.train,
        tiny_recipe("input.crop_width_px=70", "input.crop_height_px=40"),
        seed=0,
    )

    assert frames.crop_to_multiples(16) == (32, 64)
    sample = frames[0, 3]
    assert sample["image"].shape == (3, 32, 64)
    assert torch.equal(frames[0, 3]["image"], sample["image"])
    assert not torch.equal(frames[1, 3]["image"], sample["image"])


def test_a_common_camera_makes_bridges_alike(learnable: Path) -> None:
    camera = "input.camera=[64.0, 32.0, 50.0, 50.0, 31.5, 15.5]"
    frames = TrainingFrames(learnable, SPLIT.train, tiny_recipe(camera), seed=0)

    assert frames.prepared_px == (32, 64)
    assert frames.crop_to_multiples(32) == (32, 64)
    K = frames[0, 0]["intrinsics"]
    assert (float(K[0, 0]), float(K[1, 1])) == (50.0, 50.0)


def two_processes(rank: int, data: str, out: str, port: int) -> None:
    torch.set_num_threads(1)
    names = {"RANK": rank, "LOCAL_RANK": rank, "WORLD_SIZE": 2, "MASTER_PORT": port}
    os.environ |= {name: str(value) for name, value in names.items()} | {"MASTER_ADDR": "127.0.0.1"}
    wanted = job(Path(data), Path(out), *DIVIDED)
    if rank == 0:
        with pytest.warns(UserWarning, match="norms' statistics of its own"):
            train(wanted, QUIET)
    else:
        train(wanted, QUIET)


DIVIDED = ("run.steps=3", "run.norm_batches=0", "run.checkpoint_every=2")


def free_port() -> int:
    import socket

    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@pytest.mark.slow
@pytest.mark.usefixtures("spawned_tests")
def test_two_processes_train_together(learnable: Path, tmp_path: Path) -> None:
    multiprocessing.spawn(
        two_processes, (str(learnable), str(tmp_path / "two"), free_port()), nprocs=2
    )
    train(job(learnable, tmp_path / "one", *DIVIDED), QUIET)
    two, one = read_steps(tmp_path / "two"), read_steps(tmp_path / "one")

    assert [record.valid_pixels for record in two] == [record.valid_pixels for record in one]
    # Norms see half a batch each, so losses are near and not equal.
    assert two[0].loss == pytest.approx(one[0].loss, rel=0.2)
    assert read_split(tmp_path / "two" / "split.json") == SPLIT


def test_a_batch_that_does_not_divide_among_processes_is_refused(
    learnable: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, value in {"RANK": "0", "WORLD_SIZE": "1"}.items():
        monkeypatch.setenv(name, value)
    from civil_rgbd.training.processes import Processes
    from civil_rgbd.training.run import _refuse_uneven

    with pytest.raises(UsageError, match="a batch of 4 does not divide among 3 processes"):
        _refuse_uneven(tiny_recipe(), Processes(0, 3, torch.device("cpu")))
    assert train(job(learnable, tmp_path / "run", "run.steps=1"), QUIET).steps == 1
