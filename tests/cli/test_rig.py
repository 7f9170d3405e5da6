"""``civil-rgbd rig import``: what it prints, writes and refuses."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from civil_rgbd.cli import main
from civil_rgbd.trajectories.rig import read_rig

from ..trajectories import calibrations as files

pytest.importorskip("yaml", reason="YAML calibrations need the extra [rig]")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name, text in (
        ("r3live.yaml", files.R3LIVE),
        ("extrinsic.txt", files.LIVOX_EXTRINSIC),
        ("camera.yaml", files.LIVOX_CAMERA),
        ("calib.json", files.DIRECT_VISUAL),
        ("info.yaml", files.ROS_CAMERA_INFO),
    ):
        (tmp_path / name).write_text(text, encoding="utf-8")
    return tmp_path


def run(folder: Path, *words: str) -> int:
    paths = [str(folder / word) if "." in word and "/" not in word else word for word in words]
    return main(["rig", "import", *paths])


def test_it_prints_a_rig_file_with_its_directions_in_words(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(folder, "r3live.yaml", "--from", "r3live") == 0
    out = capsys.readouterr().out
    assert out.startswith("# from r3live.yaml (r3live)\n# camera_ext_R and camera_ext_t are the")
    (folder / "rig.toml").write_text(out, encoding="utf-8")
    rig = read_rig(folder / "rig.toml")
    assert set(rig.extrinsics) == {("imu", "camera"), ("imu", "lidar")}


def test_it_writes_a_rig_file_and_says_the_directions(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(folder, "extrinsic.txt", "camera.yaml", "--out", "rig.toml") == 0
    out = capsys.readouterr().out
    assert "rig.toml: from extrinsic.txt, camera.yaml (livox-camera-calib)" in out
    assert "the matrix takes LiDAR points to the camera; turned round: the camera sits at" in out
    camera = read_rig(folder / "rig.toml").camera
    assert camera is not None
    assert camera.pinhole.width_px == 1920
    assert [path.name for path in folder.glob("*partial*")] == []


def test_a_rig_file_that_is_there_stays(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "rig.toml").write_text("map_up = [0, 0, 1]\n")

    assert run(folder, "r3live.yaml", "--out", "rig.toml") == 2
    assert "add --overwrite" in capsys.readouterr().err
    assert (folder / "rig.toml").read_text() == "map_up = [0, 0, 1]\n"
    assert run(folder, "r3live.yaml", "--out", "rig.toml", "--overwrite") == 0
    assert read_rig(folder / "rig.toml").map_up is None


def test_a_camera_goes_onto_extrinsics(folder: Path) -> None:
    assert run(folder, "extrinsic.txt", "--out", "one.toml") == 0
    assert run(folder, "info.yaml", "--onto", "one.toml", "--out", "two.toml") == 0

    one, two = read_rig(folder / "one.toml"), read_rig(folder / "two.toml")
    assert two.camera is not None
    assert one.camera is None
    assert np.array_equal(one.extrinsics["lidar", "camera"], two.extrinsics["lidar", "camera"])


def test_the_image_size_is_added_where_it_is_missing(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(folder, "calib.json") == 2
    assert "--image-size 1646x1245" in capsys.readouterr().err
    assert run(folder, "calib.json", "--image-size", "1600x1200", "--out", "rig.toml") == 0
    assert run(folder, "calib.json", "--image-size", "1600") == 2
    assert "for example 1280x720" in capsys.readouterr().err


def test_a_folder_that_is_not_there_is_an_error(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = str(folder / "nowhere" / "rig.toml")
    assert main(["rig", "import", str(folder / "r3live.yaml"), "--out", out]) == 2
    assert "cannot write" in capsys.readouterr().err
