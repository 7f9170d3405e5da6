"""``civil-rgbd convert``: options reach the importer, the report says what was decided."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from civil_rgbd.cli import main
from civil_rgbd.cli.convert import command
from civil_rgbd.importers.registry import IMPORTERS

from ..importers import sets


def test_the_help_names_every_importer() -> None:
    (option,) = [parameter for parameter in command.params if parameter.name == "importer"]

    assert all(name in str(option.to_info_dict()["help"]) for name in IMPORTERS)


def test_the_report_gives_scale_evidence_and_what_was_left_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = sets.bridge_rgbd(tmp_path / "B3", scale=1000.0)
    (source / "depth" / "000002.png").unlink()
    arguments = ["convert", str(source), "--from", "bridge-rgbd", "--out", str(tmp_path / "data")]

    assert main(arguments) == 0
    out = capsys.readouterr().out
    assert "B3: 11 frames of 12 images" in out
    assert "stored as x 1000" in out
    assert "they prove x 1000" in out
    assert "left out  1 no_depth_image" in out
    assert "1000 instead of 256, which the layout bridge-rgbd says" in out
    assert "licence   unstated: give --licence SPDX" in out


def test_json_is_for_machines(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source = sets.lab(tmp_path / "lab")
    arguments = ["convert", str(source), "--from", "lab", "--out", str(tmp_path / "data")]

    assert main([*arguments, "--bridge", "B9", "--licence", "CC0-1.0", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["bridge_id"] == "B9"
    assert document["frames_kept"] == sets.FRAMES
    assert document["depth_scale"] == 1000.0
    assert document["licence"] == "CC0-1.0"


def test_every_option_reaches_the_importer(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = sets.bridge_rgbd(tmp_path / "set")
    for name in ("poses.csv", "timestamps.txt", "intrinsics.json"):
        (source / name).rename(tmp_path / name)
    numbers = f"{sets.FX},{sets.FY},{sets.CX},{sets.CY},0.01,0,0,0"
    arguments = ["convert", str(source), "--from", "bridge-rgbd", "--out", str(tmp_path / "data")]
    arguments += ["--poses", str(tmp_path / "poses.csv"), "--intrinsics", numbers]
    arguments += ["--stamps", str(tmp_path / "timestamps.txt"), "--lens", "ignore"]
    arguments += ["--depth-scale", "250", "--depth-along", "z", "--codec", "jpeg"]

    assert main([*arguments, "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["depth_scale"] == 250.0
    assert (tmp_path / "data/bridges/set/rgb/000000.jpg").is_file()
    assert main([*arguments, "--direction", "map-to-camera", "--bridge", "other"]) == 2
    assert "give --direction camera-to-map" in capsys.readouterr().err
