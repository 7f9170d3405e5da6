"""``train``, ``evaluate`` and ``benchmark`` from the command line."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from civil_rgbd.cli import main
from civil_rgbd.evaluation.frames import open_bridges
from civil_rgbd.format.depth_exr import write_depth

from ..training.conftest import TINY, write_learnable

NUMBERS = [word for one in (*TINY, "run.steps=2") for word in ("--set", one)]


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Bridges B1, B2 and B3 of five frames each."""
    return write_learnable(tmp_path_factory.mktemp("commands") / "data", frames=5)


@pytest.fixture(scope="module")
def run(data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run without shots, trained by the command."""
    out = tmp_path_factory.mktemp("runs") / "bts-0"
    arguments = ["train", "bts-small", "--data", str(data), "--test-bridge", "B3", "--draw", "2"]
    assert main([*arguments, "--out", str(out), "--threads", "1", *NUMBERS]) == 0
    return out


def test_a_trained_run_is_scored_on_the_bridge_that_it_has_not_seen(
    data: Path, run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    status = main(["evaluate", str(run), "--data", str(data), "--flip", "--max-depth", "60"])
    document = json.loads((run / "results" / "results.json").read_text("utf-8"))

    assert status == 0
    assert "| mean of images |" in capsys.readouterr().out
    assert list(document["tests"]) == ["same", "remainder", "apart"]
    assert document["tests"]["remainder"]["counts"]["images"] == 5
    assert document["rules"] == {
        "min_depth_m": 0.001,
        "max_depth_m": 60.0,
        "min_valid_px": 10,
        "median_scaling": False,
        "flip_averaged": True,
    }
    assert document["split"]["origin"]["test_bridge"] == "B3"


def test_the_file_of_a_run_stands_for_the_run(data: Path, run: Path) -> None:
    assert main(["evaluate", str(run / "model.pt"), "--data", str(data), "--device", "cpu"]) == 0
    document = json.loads((run / "results" / "results.json").read_text("utf-8"))

    assert document["split"]["origin"]["test_bridge"] == "B3"
    assert document["model"] == "bts-0"
    assert len(document["model_sha256"]) == len(document["data_sha256"]) == 64


def test_scoring_takes_place_on_the_device_that_is_asked_for(
    data: Path, run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = ["--data", str(data), "--device", "nonsense"]
    one_photo = ["--focal-px", "50", "--device", "nonsense"]
    table = ["--test-bridge", "B3", "--shots", "0", "--seeds", "1", "--draw", "1"]
    for arguments in (
        ["evaluate", str(run), *asked],
        ["benchmark", "--models", str(run), *table, "--out", str(tmp_path / "t"), *asked],
        ["predict", str(tmp_path), "--model", str(run), "--out", str(tmp_path / "p"), *one_photo],
    ):
        assert main(arguments) == 2
        assert "there is no device 'nonsense'" in capsys.readouterr().err


def test_random_weights_are_scored_with_a_warning(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["--data", str(data), "--bridge", "B3", "--out", str(tmp_path / "results")]

    assert main(["evaluate", "bts-small", *words]) == 0

    assert "bts-small has random weights: its scores say nothing" in capsys.readouterr().err


def test_the_same_command_again_finds_the_run_done(
    data: Path, run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["train", "bts-small", "--data", str(data), "--split", str(run / "split.json")]
    status = main([*arguments, "--out", str(run), *NUMBERS])

    assert status == 0
    assert "2 steps, of which 2 were found done" in capsys.readouterr().out


def test_a_folder_of_predictions_is_scored(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bridge = open_bridges(data)["B3"]
    (tmp_path / "mine" / "B3").mkdir(parents=True)
    for row in bridge.rows:
        near = np.where(bridge.read_depth(row) > 0, bridge.read_depth(row) * 1.1, 5.0)
        write_depth(tmp_path / "mine" / "B3" / f"{row.frame_id}.exr", near.astype(np.float32))
    arguments = ["--data", str(data), "--bridge", "B3", "--out", str(tmp_path / "out")]
    status = main(["evaluate", str(tmp_path / "mine"), *arguments, "--median-scaling"])
    document = json.loads((tmp_path / "out" / "results.json").read_text("utf-8"))

    assert status == 0
    assert "AbsRel (median-scaled)" in capsys.readouterr().out
    scores = document["tests"]["all"]["per_image"]
    assert scores["abs_rel_median_scaled"] == pytest.approx(0, abs=1e-6)


def test_the_table_comes_out_of_one_command(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["--data", str(data), "--test-bridge", "B3", "--models", "bts-small"]
    arguments += ["--shots", "0,1", "--seeds", "1", "--draw", "1", "--out", str(tmp_path / "t")]
    status = main(["benchmark", *arguments, "--no-tensorboard", *NUMBERS])

    assert status == 0
    assert "| bts-small | 1 |" in capsys.readouterr().out
    assert (tmp_path / "t" / "index.html").is_file()


def test_a_failed_cell_is_in_the_table_and_in_the_exit_code(
    data: Path, run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "none").mkdir()
    models = f"{run},predictions:{tmp_path / 'none'}"
    arguments = ["--data", str(data), "--test-bridge", "B3", "--models", models, "--draw", "1"]
    arguments += ["--shots", "0", "--seeds", "1", "--out", str(tmp_path / "t")]
    status = main(["benchmark", *arguments])

    assert status == 1
    said = capsys.readouterr().out
    assert "(FAILED: 1 of 1 seeds) | 0 |" in said
    assert "is not in the table: there is no prediction of frame" in said


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["train", "bts-smal", "--test-bridge", "B3"], "there is no training recipe 'bts-smal'"),
        (["train", "bts-small"], "nothing says which frames train"),
        (["train", "bts-small", "--test-bridge", "B9"], "there is no bridge 'B9'"),
        (["train", "bts-small", "--test-bridge", "B3", "--shots", "5"], "drawing 30 of them"),
        (["benchmark", "--test-bridge", "B3", "--models", "bts", "--shots", "a"], "is not numbers"),
        (["benchmark", "--test-bridge", "B3", "--models", "btx", "--draw", "2", "--shots", "0"],
         "there is no such model: 'btx'"),
        (["train", "bts-small", "--split", "s.json", "--shots", "0"], "a split is given"),
        (["train", "bts-small", "--split", "s.json", "--draw", "9"], "a split is given"),
        (["evaluate", "nowhere"], "there is no such model: 'nowhere'"),
        (["evaluate", "x", "--min-depth", "5", "--max-depth", "4"], "are not 0 < min < max"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_said_in_words(
    data: Path,
    tmp_path: Path,
    arguments: list[str],
    words: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    out = ["--data", str(data), "--out", str(tmp_path / "out")]
    status = main([*arguments, *out])
    said = capsys.readouterr().err

    assert status == 2
    assert words in said
    assert "  fix:   " in said
    assert not (tmp_path / "out").exists()
