"""``civil-rgbd validate`` and its exit codes."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from civil_rgbd.cli import main

GOLDEN = Path(__file__).resolve().parents[1] / "data" / "format_v1"


@pytest.fixture
def dataset(tmp_path: Path) -> Path:
    copy = tmp_path / "golden"
    shutil.copytree(GOLDEN, copy, ignore=shutil.ignore_patterns("make.py", "__pycache__"))
    return copy


def test_a_clean_dataset_gives_0(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["validate", str(GOLDEN)]) == 0
    assert "1 bridge, 3 frames checked\nnothing to complain of" in capsys.readouterr().out


def test_an_error_gives_1_and_says_what_to_do(
    dataset: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (dataset / "bridges" / "B1" / "rgb" / "000007.jpg").unlink()

    assert main(["validate", str(dataset)]) == 1
    out = capsys.readouterr().out
    assert "error: file-missing, 1 time\n  B1/rgb/000007.jpg: frames.parquet names it" in out
    assert "fix: build the bridge again" in out


def test_a_warning_alone_gives_0(dataset: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (dataset / "bridges" / "B1" / ".DS_Store").touch()

    assert main(["validate", str(dataset)]) == 0
    assert capsys.readouterr().out.endswith("0 errors, 1 warning\n")


def test_no_such_folder_gives_2(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["validate", str(tmp_path / "nothing")]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert "there is no such folder" in captured.err


def test_json_stays_json_when_openexr_complains(dataset: Path) -> None:
    # A flipped byte inside a packed chunk passes every check of ours, and OpenEXR prints about it.
    path = dataset / "bridges" / "B1" / "depth" / "000007.exr"
    data = bytearray(path.read_bytes())
    data[-40] ^= 0xFF
    path.write_bytes(data)

    run = subprocess.run(
        [sys.executable, "-m", "civil_rgbd", "validate", "--json", str(dataset)],
        capture_output=True,
        text=True,
        check=False,
    )

    document = json.loads(run.stdout)
    assert run.returncode == 1
    assert {finding["code"] for finding in document["findings"]} == {
        "file-hash",
        "depth-unreadable",
    }
    assert document["errors"] == 2
    assert document["findings"][0].keys() == {
        *("code", "level", "bridge", "file", "message", "fix"),
    }
