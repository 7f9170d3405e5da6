"""``civil-rgbd predict`` and ``export-onnx``: what they print, write and refuse."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from civil_rgbd.baselines.bts_model import bts_small
from civil_rgbd.baselines.checkpoints import save_model
from civil_rgbd.cli import main
from civil_rgbd.format.depth_exr import read_depth
from civil_rgbd.format.intrinsics import read_intrinsics, write_intrinsics
from civil_rgbd.geometry.camera import PinholeCamera

RIG = """
[camera]
width_px = 64
height_px = 48
fx_px = 50.0
fy_px = 50.0
cx_px = 31.5
cy_px = 23.5
lens = "plumb_bob"
coefficients = [-0.1, 0.0, 0.0, 0.0, 0.0]
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a run and two photos; the working folder."""
    (tmp_path / "run").mkdir()
    save_model(bts_small(features=16), tmp_path / "run" / "model.pt")
    (tmp_path / "photos").mkdir()
    pixels = np.random.default_rng(0).integers(0, 255, (48, 64, 3), dtype=np.uint8)
    for name in ("a.jpg", "b.png"):
        cv2.imwrite(str(tmp_path / "photos" / name), pixels)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(words: str) -> int:
    return main(words.split())


def test_photos_are_predicted_by_focal_length(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("predict photos --model run --focal-px 55 --out depths") == 0

    assert capsys.readouterr().out == "2 photos predicted\n"
    assert read_depth(folder / "depths/depth/a.exr").shape == (48, 64)
    assert read_intrinsics(folder / "depths/intrinsics/b.json").fx_px == 55


def test_the_camera_comes_from_intrinsics_or_a_rig(folder: Path) -> None:
    write_intrinsics(folder / "k.json", PinholeCamera(128, 96, 100.0, 100.0, 63.5, 47.5))
    (folder / "rig.toml").write_text(RIG)

    assert run("predict photos --model run --intrinsics k.json --out k") == 0
    assert run("predict photos --model run --rig rig.toml --out r") == 0

    assert read_intrinsics(folder / "k/intrinsics/a.json").fx_px == 50
    assert not (folder / "k/rgb").exists()
    assert (folder / "r/rgb/a.png").is_file()


def test_a_photo_that_fails_is_a_finding(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "photos/c.jpg").write_bytes(b"")

    assert run("predict photos --model run --focal-px 55 --out d --json") == 1

    report = json.loads(capsys.readouterr().out)
    assert list(report["failed"]) == ["c.jpg"]
    assert report["predicted"] == ["a.jpg", "b.png"]


def test_random_weights_are_warned_of(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = "predict photos --model bts-small --option features=16 --focal-px 55 --out d"

    assert run(words) == 0

    assert "bts-small has random weights" in capsys.readouterr().err
    assert (folder / "d/depth/a.exr").is_file()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("--model run", "nothing is said of the camera"),
        ("--model run --focal-px 5 --rig rig.toml", "given twice"),
        ("--model runs --focal-px 5", "there is no such model: 'runs'"),
        ("--model predictions:photos --focal-px 5", "not photos"),
        ("--model run --focal-px 5 --option features", "'features' is no KEY=VALUE"),
        ("--model run --focal-px 5 --option a=1 --option a=2", "'a=2' is given twice"),
        ("--model run --focal-px 5 --option features=32", "of another shape"),
    ],
)
def test_what_does_not_fit_is_told(
    folder: Path, capsys: pytest.CaptureFixture[str], words: str, said: str
) -> None:
    assert main(["predict", "photos", "--out", "d", *words.split()]) == 2

    assert said in capsys.readouterr().err
    assert not (folder / "d").exists()


@pytest.mark.slow
def test_a_run_becomes_one_onnx_file(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("onnxruntime", reason="comes with the extra onnx")

    assert run("export-onnx run model.onnx --size 64 48") == 0

    assert "model.onnx: " in capsys.readouterr().out
    assert (folder / "model.onnx").stat().st_size > 1e5


def test_only_networks_of_torch_become_onnx(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("export-onnx predictions:photos model.onnx") == 2

    assert "a StoredPredictions is not made of torch" in capsys.readouterr().err
    assert not (folder / "model.onnx").exists()


NO_TORCH = """
import sys
sys.modules["torch"] = None  # any import of it fails
from civil_rgbd.cli import main
sys.exit(main(["export-onnx", "predictions:photos", "model.onnx"]))
"""


def test_export_without_torch_says_what_to_install(folder: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", NO_TORCH], cwd=folder, capture_output=True, text=True, check=False
    )

    assert done.returncode == 2
    assert 'pip install "civil-rgbd[onnx]"' in done.stderr
    assert "Traceback" not in done.stderr
