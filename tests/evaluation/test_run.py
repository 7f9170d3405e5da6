"""Scoring a model on a dataset: which frames, which results, which refusals."""

from __future__ import annotations

import csv
import json
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from civil_rgbd.domain.split import Split, split_from_document
from civil_rgbd.errors import FormatError, UsageError
from civil_rgbd.evaluation.choice import choose_model, choose_split
from civil_rgbd.evaluation.frames import open_bridges
from civil_rgbd.evaluation.metrics import METRICS, MetricRules
from civil_rgbd.evaluation.results import Scored, results_document, write_results
from civil_rgbd.evaluation.run import EvaluationOptions, evaluate, mirrored_camera
from civil_rgbd.format.depth_exr import write_depth
from civil_rgbd.format.split_files import read_split, write_split
from civil_rgbd.geometry.camera import PinholeCamera

SPLIT = Split(
    train={"B1": ("000003",)},
    tests={"both": {"B1": ("000005", "000006"), "B3": ("000012",)}, "one": {"B3": ("000012",)}},
    origin={"seed": 7},
)


@dataclass
class Reader:
    """Reads the depth that is coded in the image, times a factor."""

    factor: float = 1.0

    def predict(self, rgb: NDArray[np.uint8], camera: PinholeCamera) -> NDArray[np.float32]:
        assert rgb.shape[:2] == (camera.height_px, camera.width_px)
        return (rgb[..., 0] / 4 * self.factor).astype(np.float32)


class LeftIsNear:
    """Answers 1 m in the left half and 3 m in the right; 2 m everywhere when flips are averaged."""

    def predict(self, rgb: NDArray[np.uint8], camera: PinholeCamera) -> NDArray[np.float32]:
        answer = np.full(rgb.shape[:2], 1.0, dtype=np.float32)
        answer[:, camera.width_px // 2 :] = 3.0
        return answer


class Stored:
    """Predictions by frame; never sees an image."""

    def depth_of(self, bridge: str, frame: str, camera: PinholeCamera) -> NDArray[np.float32]:
        assert (bridge, frame) in {("B1", "000005"), ("B1", "000006"), ("B3", "000012")}
        return np.full((camera.height_px, camera.width_px), 5.0, dtype=np.float32)


def test_a_model_that_reads_the_truth_has_no_error(coded_data: Path) -> None:
    scores = evaluate(Reader(), coded_data, SPLIT).scores("both")

    assert list(scores.per_image.values()) == [0, 0, 0, 0, 0, 0, 1, 1, 1]
    assert scores.counts.images == 3


def test_every_test_and_bridge_is_scored_from_one_pass(coded_data: Path) -> None:
    seen: list[tuple[int, int]] = []
    options = EvaluationOptions(on_progress=lambda done, total: seen.append((done, total)))
    evaluation = evaluate(Reader(1.1), coded_data, SPLIT, options)

    assert seen == [(1, 3)] * 3
    for test, bridge, images in (("both", None, 3), ("both", "B1", 2), ("one", None, 1)):
        scores = evaluation.scores(test, bridge)
        assert scores.counts.images == images
        assert scores.pooled["abs_rel"] == pytest.approx(0.1)


def test_stored_predictions_are_scored_without_an_image(coded_data: Path) -> None:
    scores = evaluate(Stored(), coded_data, SPLIT).scores("both")

    assert 0 < scores.per_image["abs_rel"] < 10


def test_flips_are_averaged_after_mirroring_back(coded_data: Path) -> None:
    split = Split(train={}, tests={"one": {"B3": ("000012",)}})
    rules = MetricRules()
    flipped = evaluate(LeftIsNear(), coded_data, split, EvaluationOptions(rules, flip=True))
    constant = evaluate(Constant(2.0), coded_data, split)

    assert flipped.scores("one") == constant.scores("one")
    assert flipped.scores("one") != evaluate(LeftIsNear(), coded_data, split).scores("one")


@dataclass
class Constant:
    depth_m: float

    def predict(self, rgb: NDArray[np.uint8], camera: PinholeCamera) -> NDArray[np.float32]:
        del camera
        return np.full(rgb.shape[:2], self.depth_m, dtype=np.float32)


def test_a_mirrored_camera_sees_the_mirrored_pixel_in_the_mirrored_direction() -> None:
    camera = PinholeCamera(64, 36, 40.0, 41.0, 31.25, 17.75)
    mirrored = mirrored_camera(camera)

    for u in (0, 17, 63):
        assert (u - camera.cx_px) == pytest.approx(-((63 - u) - mirrored.cx_px))


def test_results_hold_split_rules_and_every_score(coded_data: Path, tmp_path: Path) -> None:
    evaluation = evaluate(Reader(1.1), coded_data, SPLIT)
    document = write_results(tmp_path / "out", evaluation, Scored("reader", "kitchener"))

    on_disk = json.loads((tmp_path / "out" / "results.json").read_text("utf-8"))
    assert on_disk == document
    assert document["split"] == {"sha256": SPLIT.sha256(), "origin": {"seed": 7}}
    assert document["rules"]["max_depth_m"] == 80.0
    assert list(document["tests"]) == ["both", "one"]
    assert list(document["tests"]["both"]["bridges"]) == ["B1", "B3"]
    assert "AbsRel" in (tmp_path / "out" / "results.md").read_text("utf-8")
    with (tmp_path / "out" / "frames.csv").open(encoding="utf-8") as lines:
        rows = list(csv.DictReader(lines))
    assert [row["frame"] for row in rows] == ["000005", "000006", "000012"]
    assert all(float(row["abs_rel"]) == pytest.approx(0.1) for row in rows)
    with (tmp_path / "out" / "results.csv").open(encoding="utf-8") as lines:
        values = list(csv.DictReader(lines))
    assert len(values) == (3 + 2) * 5 * 2 * len(METRICS)  # scopes, ranges, averagings


def test_scores_of_nothing_are_null(coded_data: Path) -> None:
    split = Split(train={}, tests={"some": SPLIT.tests["one"], "none": {"B3": ()}})

    document = results_document(evaluate(Reader(), coded_data, split), Scored("m", "d"))

    assert document["tests"]["none"]["per_image"]["abs_rel"] is None


def test_median_scaling_is_in_the_names_of_the_results(coded_data: Path) -> None:
    options = EvaluationOptions(MetricRules(median_scaling=True))
    document = results_document(evaluate(Reader(3.0), coded_data, SPLIT, options), Scored("m", "d"))

    scores = document["tests"]["both"]["per_image"]
    assert scores["abs_rel_median_scaled"] == pytest.approx(0, abs=1e-6)
    assert "abs_rel" not in scores


def test_flipping_stored_predictions_is_refused(coded_data: Path) -> None:
    with pytest.raises(UsageError, match="cannot be averaged over flips"):
        evaluate(Stored(), coded_data, SPLIT, EvaluationOptions(flip=True))


def test_a_set_without_any_valid_pixel_is_refused(coded_data: Path) -> None:
    options = EvaluationOptions(MetricRules(min_depth_m=70, max_depth_m=79))
    with pytest.raises(UsageError, match="none of 3 has 10 valid pixels; the most is 0, between"):
        evaluate(Reader(), coded_data, SPLIT, options)


def test_a_frame_that_is_not_there_is_refused(coded_data: Path) -> None:
    split = Split(train={}, tests={"one": {"B3": ("000012", "000013", "000014")}})
    with pytest.raises(UsageError, match="has no frame '000013', nor 1 others") as caught:
        evaluate(Reader(), coded_data, split)

    assert "the split is of other data" in caught.value.fix


def test_a_bridge_that_is_not_there_is_refused(coded_data: Path) -> None:
    with pytest.raises(UsageError, match="there is no bridge 'B2'"):
        evaluate(Reader(), coded_data, Split(train={}, tests={"one": {"B2": ("000012",)}}))


def test_a_split_comes_back_from_its_file_and_keeps_its_hash(tmp_path: Path) -> None:
    write_split(tmp_path / "split.json", SPLIT)
    read = read_split(tmp_path / "split.json")

    assert read == SPLIT
    assert read.sha256() == SPLIT.sha256()


def test_the_hash_is_of_the_frames_and_not_of_how_they_were_drawn() -> None:
    other = Split(SPLIT.train, SPLIT.tests, {"seed": 8})
    fewer = Split(SPLIT.train, {"both": SPLIT.tests["both"]}, SPLIT.origin)

    assert other.sha256() == SPLIT.sha256()
    assert fewer.sha256() != SPLIT.sha256()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"civil_rgbd_split": 2}, "version is 2"),
        ({"train": {"B1": "all"}}, "'train' is not lists"),
        ({"tests": {"x": {"B1": ["1", "1"]}}}, "'x' is not lists"),
        ({"tests": []}, "'tests' is no object"),
        ({"train": {"B3": ["000012"]}}, "1 frames of bridge 'B3' are trained with and scored"),
    ],
)
def test_a_file_that_is_no_split_is_refused(change: dict[str, object], words: str) -> None:
    with pytest.raises(FormatError, match=words):
        split_from_document({**SPLIT.to_document(), **change}, where="split.json")


def test_a_run_is_scored_on_its_own_split_and_leakage_is_said(
    coded_data: Path, tmp_path: Path
) -> None:
    write_split(tmp_path / "split.json", SPLIT)

    assert choose_split(str(tmp_path), coded_data) == SPLIT
    with pytest.warns(UserWarning, match="scored here: 1 of bridge B1"):
        every = choose_split(str(tmp_path), coded_data, bridges=["B1"])
    assert len(every.tests["all"]["B1"]) == 6
    with pytest.raises(UsageError, match="the run is not finished"):
        choose_model(str(tmp_path))
    (tmp_path / "model.pt").touch()  # the file names the run as its folder does
    assert choose_split(str(tmp_path / "model.pt"), coded_data) == SPLIT
    with pytest.warns(UserWarning, match="scored here: 1 of bridge B1"):
        choose_split(str(tmp_path / "model.pt"), coded_data, bridges=["B1"])


def test_a_split_and_bridges_together_are_refused(coded_data: Path, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="a split and bridges are given"):
        choose_split("m", coded_data, split_file=tmp_path / "s.json", bridges=["B1"])


WITHOUT_TORCH = """
import sys
sys.modules["torch"] = None  # any import of it fails
from civil_rgbd.cli import main
sys.exit(main(["evaluate", *sys.argv[1:]]))
"""


def test_predictions_on_disk_are_scored_without_torch(coded_data: Path, tmp_path: Path) -> None:
    (tmp_path / "mine" / "B3").mkdir(parents=True)
    bridge = open_bridges(coded_data)["B3"]
    for row in bridge.rows:
        depth_m = np.maximum(bridge.read_depth(row), 1.0)
        write_depth(tmp_path / "mine" / "B3" / f"{row.frame_id}.exr", depth_m)
    arguments = [tmp_path / "mine", "--data", coded_data, "--bridge", "B3", "--out", tmp_path / "o"]
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT_TORCH, *map(str, arguments)],
        capture_output=True,
        text=True,
        check=False,
    )

    assert done.returncode == 0, done.stderr
    document = json.loads((tmp_path / "o" / "results.json").read_text("utf-8"))
    assert document["tests"]["all"]["per_image"]["abs_rel"] < 0.01
