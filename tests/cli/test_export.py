"""``civil-rgbd export``: what is written, and what is said to be lost."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from civil_rgbd.cli import main
from civil_rgbd.cli.export import command
from civil_rgbd.exporters.registry import EXPORTERS

from ..exporters.conftest import write_bridge


@pytest.fixture
def dataset(tmp_path: Path) -> Path:
    write_bridge(tmp_path / "data", "B1")
    return tmp_path / "data"


def test_the_help_names_every_exporter() -> None:
    (option,) = [parameter for parameter in command.params if parameter.name == "exporter"]

    assert all(name in str(option.to_info_dict()["help"]) for name in EXPORTERS)


def test_losses_are_printed(
    dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["export", str(dataset), "--to", "kitti", "--out", str(tmp_path / "kitti")]) == 0

    out = capsys.readouterr().out
    assert "B1 (4 frames) as kitti" in out
    assert "lost      4 depths lie beyond the range" in out
    assert "lost      quality planes, defects" in out


def test_options_reach_the_exporter(
    dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bridge = dataset / "bridges" / "B1"
    out = ["--out", str(tmp_path / "out"), "--overwrite", "--json"]

    assert main(["export", str(bridge), "--to", "tum", "--depth-scale", "256", *out]) == 0
    assert any("x 256" in loss for loss in json.loads(capsys.readouterr().out)["losses"])
    assert main(["export", str(bridge), "--to", "ply", "--voxel-m", "0.5", *out]) == 0
    assert any("cube of 0.5 m" in loss for loss in json.loads(capsys.readouterr().out)["losses"])


def test_a_missing_extra_names_the_command(
    dataset: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    import sys

    monkeypatch.setitem(sys.modules, "laspy", None)

    assert main(["export", str(dataset), "--to", "las", "--out", str(tmp_path / "las")]) == 2
    assert 'pip install "civil-rgbd[las]"' in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["data"]
