"""A run's folder is begun once, refuses other runs, and is emptied of nothing but the run."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from civil_rgbd.errors import OutputError, TrainingError
from civil_rgbd.format.split_files import read_split
from civil_rgbd.lineage import Lineage
from civil_rgbd.training.job import TrainingJob
from civil_rgbd.training.run_folder import delete_run, is_begun, prepare_folder

from .conftest import SPLIT, ids, tiny_recipe

IDENTITY: dict[str, Any] = {"seed": 0, "recipe": "ab"}


def job(folder: Path, *settings: str) -> TrainingJob:
    return TrainingJob(folder / "bridges", SPLIT, tiny_recipe(*settings), folder / "deep" / "run")


def test_a_new_folder_says_what_the_run_is(tmp_path: Path) -> None:
    wanted = job(tmp_path)
    first = Lineage("theirs.pt", {"B1": ids(4)}, ("theirs.pt",))

    assert prepare_folder(wanted, IDENTITY, first, overwrite=False) is True

    document = json.loads((wanted.out / "run.json").read_text("utf-8"))
    assert document["identity"] == IDENTITY
    assert document["data"] == "bridges"
    assert document["recipe"] == wanted.recipe.to_document()
    assert document["first_weights"] == first.to_document()
    assert set(document["software"]) == {"civil_rgbd", "torch"}
    assert read_split(wanted.out / "split.json") == SPLIT


def test_the_same_run_finds_its_folder_as_it_left_it(tmp_path: Path) -> None:
    wanted = job(tmp_path)
    prepare_folder(wanted, IDENTITY, None, overwrite=False)
    before = (wanted.out / "run.json").stat().st_mtime_ns

    assert prepare_folder(wanted, IDENTITY, None, overwrite=False) is False
    assert (wanted.out / "run.json").stat().st_mtime_ns == before


def test_another_run_is_refused_with_what_differs_and_may_be_overwritten(tmp_path: Path) -> None:
    prepare_folder(job(tmp_path, "run.steps=2"), IDENTITY, None, overwrite=False)
    other, identity = job(tmp_path, "run.steps=3"), {"seed": 5, "recipe": "cd"}
    with pytest.raises(TrainingError, match=r"lies here: run\.steps 2 -> 3, seed 0 -> 5") as caught:
        prepare_folder(other, identity, None, overwrite=False)
    assert caught.value.where == str(other.out)

    assert prepare_folder(other, identity, None, overwrite=True) is True
    assert json.loads((other.out / "run.json").read_text("utf-8"))["identity"] == identity


def test_a_file_in_the_folders_place_is_a_clear_error(tmp_path: Path) -> None:
    (tmp_path / "deep").write_text("in the way")

    with pytest.raises(OutputError, match="cannot write"):
        prepare_folder(job(tmp_path), IDENTITY, None, overwrite=False)


def test_a_run_is_begun_with_a_step_a_checkpoint_or_a_model(tmp_path: Path) -> None:
    prepare_folder(wanted := job(tmp_path), IDENTITY, None, overwrite=False)
    assert not is_begun(wanted.out)
    head = "step,epoch,loss,learning_rate,gradient_norm,valid_pixels\n"
    (wanted.out / "steps.csv").write_text(head)
    assert not is_begun(wanted.out)

    (wanted.out / "steps.csv").write_text(f"{head}1,1,0.5,0.1,2.0,9\n")
    assert is_begun(wanted.out)
    (wanted.out / "steps.csv").unlink()
    for name in ("checkpoint.pt", "model.pt"):
        (wanted.out / name).touch()
        assert is_begun(wanted.out)
        (wanted.out / name).unlink()


def test_what_is_not_the_runs_stays_when_it_is_deleted(tmp_path: Path) -> None:
    prepare_folder(wanted := job(tmp_path), IDENTITY, None, overwrite=False)
    for name in ("model.pt", "checkpoint.pt", "steps.csv", "notes.txt"):
        (wanted.out / name).touch()
    (wanted.out / "tensorboard").mkdir()
    (wanted.out / "tensorboard" / "events").touch()
    (wanted.out / "results").mkdir()

    delete_run(wanted.out)

    assert sorted(entry.name for entry in wanted.out.iterdir()) == ["notes.txt", "results"]
