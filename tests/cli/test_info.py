"""``civil-rgbd info`` says what is there, without the weight of what it does not need."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from civil_rgbd.cli import main

GOLDEN = Path(__file__).resolve().parents[1] / "data" / "format_v1"


def test_a_dataset_is_described(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["info", str(GOLDEN)]) == 0

    out = capsys.readouterr().out
    for words in (
        "(golden): 1 bridge, 3 frames",
        "B1 (Golden Bridge): 3 frames of 14 images",
        "32 x 24, depth in 33.3% of the pixels",
        "golden, image.scale=0.5 (rendered)",
        "licence   CC-BY-4.0",
        "splits: everything, train",
    ):
        assert words in out


def test_json_has_it_all(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["info", "--json", str(GOLDEN)]) == 0

    document = json.loads(capsys.readouterr().out)
    assert (document["dataset"], document["frames"]) == ("golden", 3)
    assert document["bridges"][0]["licence"] == "CC-BY-4.0"


def test_no_such_folder_gives_2(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["info", str(tmp_path / "nothing")]) == 2
    assert "there is no such folder" in capsys.readouterr().err


def test_nothing_heavy_is_imported() -> None:
    script = (
        "import sys; from civil_rgbd.cli import main; main(['info', sys.argv[1]]); "
        "heavy = {'numba', 'cv2', 'torch', 'pyarrow', 'OpenEXR', 'trimesh', 'mcap'}; "
        "print('HEAVY', sorted(heavy & set(sys.modules)))"
    )

    run = subprocess.run(
        [sys.executable, "-c", script, str(GOLDEN)], capture_output=True, text=True, check=True
    )

    assert run.stdout.splitlines()[-1] == "HEAVY []"
