"""Building from a LiDAR alone on the command line: poses, images and camera from files."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from civil_rgbd.cli import main
from civil_rgbd.conversion.frame_tree import FrameTree
from civil_rgbd.geometry.transforms import inverse
from civil_rgbd.simulator.recording import SimulatedRecording
from civil_rgbd.simulator.spec import ScanSpec
from civil_rgbd.trajectories.rig import read_rig
from civil_rgbd.trajectories.rig_text import rig_to_text

from ..conversion.walk_beside import seconds, write_beside, write_scans

SPEC = ScanSpec(seconds=1.2, image_scale=0.25, image_rate_hz=5)


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("walk")
    recording = SimulatedRecording(SPEC)
    write_beside(folder, recording)
    write_scans(folder / "lvx", recording, "lvx")
    return folder


def build(walk: Path, out: Path, *more: str, trajectory: str = "poses.tum") -> int:
    given = "build --recipe demo --set select.min_displacement_m=0.2 --workers 1 --licence CC0-1.0"
    paths = {"--out": out, "--trajectory": walk / trajectory, "--images": walk / "images"}
    options = [word for pair in paths.items() for word in map(str, pair)]
    rig = ["--bridge", "B1", "--rig", str(walk / "rig.toml")]
    return main([*given.split(), *options, *rig, *more, str(walk / "lvx/walk.lvx")])


def test_a_bridge_comes_out_and_says_where_everything_came_from(walk: Path, tmp_path: Path) -> None:
    assert build(walk, tmp_path, "--pose-of", "imu") == 0

    manifest = json.loads((tmp_path / "bridges/B1/manifest.json").read_text())
    assert [(s["name"], s["converter"]) for s in manifest["sources"]] == [
        ("walk.lvx", "lvx"),
        ("poses.tum", "trajectory-tum"),
        ("images", "images"),
        ("timestamps.txt", "times"),
    ]
    assert "poses are taken from poses.tum (tum): poses of the imu" in manifest["warnings"][0]
    assert manifest["deskew"] == "per_point"
    assert manifest["counts"]["frames_kept"] == 2
    assert main(["validate", str(tmp_path)]) == 0


def test_other_poses_are_another_build(
    walk: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert build(walk, tmp_path, "--pose-of", "imu") == 0
    moved = (walk / "poses.tum").read_text().replace("1700000000.005000000 ", "1700000000.0051 ")
    (walk / "moved.tum").write_text(moved)
    assert build(walk, tmp_path, "--pose-of", "imu", trajectory="moved.tum") == 2
    assert "built otherwise (different: sources" in capsys.readouterr().err


def test_poses_that_count_from_a_start_of_their_own_are_moved(walk: Path, tmp_path: Path) -> None:
    """As R3LIVE's: the offset is exact to the nanosecond, so that the same bytes come out."""
    start = 1_699_999_990_123_456_789
    lines = (walk / "poses.tum").read_text().splitlines()
    rows = [line.split(" ", 1) for line in lines]
    relative = [f"{seconds(int(stamp.replace('.', '')) - start)} {pose}\n" for stamp, pose in rows]
    (walk / "relative.tum").write_text("".join(relative))
    given = ["--pose-of", "imu"]
    assert build(walk, tmp_path / "a", *given) == 0
    offset = ["--trajectory-offset", seconds(start)]
    assert build(walk, tmp_path / "b", *given, *offset, trajectory="relative.tum") == 0
    made = [
        {path.name: path.read_bytes() for path in (tmp_path / side).rglob("*.*") if path.is_file()}
        for side in "ab"
    ]
    assert len(made[0]) >= 8
    assert [name for name in made[0] if made[0][name] != made[1][name]] == ["manifest.json"]
    manifest = json.loads((tmp_path / "b/bridges/B1/manifest.json").read_text())
    assert "its stamps moved by +1699999990.123456789 s" in manifest["warnings"][0]


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ([], "does not say what its poses are poses of"),
        (["--pose-of", "imu", "--trajectory-format", "tmu"], "no trajectory format goes by 'tmu'"),
        (["--pose-of", "imu", "--trajectory-offset", "soon"], "--trajectory-offset is no time"),
        (["--pose-of", "imu", "--metric-scale", "-1"], "--metric-scale is -1.0"),
        (["--pose-of", "imu", "--trajectory-offset", "86400"], "clocks do not overlap"),
    ],
)
def test_what_does_not_fit_is_said(
    walk: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], more: list[str], words: str
) -> None:
    assert build(walk, tmp_path, *more) == 2
    assert words in capsys.readouterr().err


def test_options_of_a_trajectory_need_one(
    walk: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = str(walk / "lvx/walk.lvx")
    assert main(["build", "--out", str(tmp_path), "--metric-scale", "2", source]) == 2
    err = capsys.readouterr().err
    assert "--metric-scale speaks of a trajectory file, but none is given" in err
    assert "where: --metric-scale\n" in err


def test_the_body_that_a_format_knows_is_not_contradicted(
    walk: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = [f"{at + 1},0,0,0,0,0,0,1\n" for at in range(6)]
    (walk / "poses.csv").write_text("".join(rows))
    times = ["--image-times", str(walk / "images/timestamps.txt")]
    assert build(walk, tmp_path, "--pose-of", "imu", *times, trajectory="poses.csv") == 2
    assert "--pose-of says imu, but poses.csv (lab) says of its poses" in capsys.readouterr().err


def test_a_broken_scan_stops_a_build_unless_it_is_to_be_left_out(
    walk: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scans = write_scans(tmp_path / "pcd", SimulatedRecording(SPEC), "pcd")
    # Its points are in a window; those of some others are not read at all.
    (scans / "7.pcd").write_bytes((scans / "7.pcd").read_bytes()[:-40])
    words = (
        f"build --recipe demo --workers 1 --licence CC0-1.0 --bridge B1 --out {tmp_path / 'out'}"
    )
    beside = {"--trajectory": "poses.tum", "--images": "images", "--rig": "rig.toml"}
    given = [word for name, path in beside.items() for word in (name, str(walk / path))]
    given += ["--pose-of", "imu", "--scans-in", "lidar", str(scans)]

    assert main([*words.split(), *given]) == 2
    err = capsys.readouterr().err
    assert "7.pcd" in err
    assert "--salvage" in err
    assert main([*words.split(), "--salvage", *given]) == 0
    manifest = json.loads((tmp_path / "out/bridges/B1/manifest.json").read_text())
    assert manifest["counts"]["skipped"] == {"scan-undecodable": 1}
    assert "scan-undecodable 1" in capsys.readouterr().out


def test_a_second_source_beside_one_that_is_never_split_is_refused(
    walk: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert build(walk, tmp_path, "--pose-of", "imu", str(walk / "lvx/walk.lvx")) == 2
    err = capsys.readouterr().err
    assert "2 sources are given, but this one is no recording that is split into files" in err


def headed(walk: Path, body: str) -> str:
    """Write the poses with a heading that says whose they are, as `civil-rgbd poses` does."""
    said = f"# some engine: poses in its map (T_map_{body})\n# seconds tx ty tz qx qy qz qw\n"
    (walk / "headed.tum").write_text(said + (walk / "poses.tum").read_text())
    return "headed.tum"


def test_poses_whose_heading_says_whose_they_are_need_no_option(walk: Path, tmp_path: Path) -> None:
    assert build(walk, tmp_path, trajectory=headed(walk, "imu")) == 0
    manifest = json.loads((tmp_path / "bridges/B1/manifest.json").read_text())
    assert "poses are taken from headed.tum (tum): poses of the imu" in manifest["warnings"][0]


def test_the_body_that_a_heading_names_is_not_contradicted(
    walk: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert build(walk, tmp_path, "--pose-of", "imu", trajectory=headed(walk, "lidar")) == 2
    said = "--pose-of says imu, but headed.tum (tum) says of its poses that they are those of the"
    assert f"{said} lidar" in capsys.readouterr().err


def turned_round(walk: Path) -> None:
    """Write the rig with the camera's mounting inverted, as a wrong import would."""
    rig = read_rig(walk / "rig.toml")
    links = FrameTree()
    for (a, b), T_a_b in rig.extrinsics.items():
        links.link(a, b, T_a_b)
    T_lidar_camera = links.find("lidar", "camera")
    T_imu_lidar = links.find("imu", "lidar")
    assert T_lidar_camera is not None
    assert T_imu_lidar is not None
    wrong = {("lidar", "camera"): inverse(T_lidar_camera), ("imu", "lidar"): T_imu_lidar}
    text = rig_to_text(replace(rig, extrinsics=wrong))
    (walk / "inverted.toml").write_text(text)


def test_a_build_says_how_the_camera_sits(
    walk: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert build(walk, tmp_path, "--pose-of", "imu") == 0
    err = capsys.readouterr().err
    assert "rig: the camera sits at x 0.021, y 0.034, z 0.093 m of the LiDAR, looks along" in err
    assert "rig-inverted" not in err


def test_a_mounting_the_wrong_way_round_is_said_before_the_build(
    walk: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    turned_round(walk)
    status = build(walk, tmp_path, "--pose-of", "imu", "--rig", str(walk / "inverted.toml"))
    err = capsys.readouterr().err
    assert status == 2  # hardly a point is in view
    said, _, refused = err.partition("error: ")
    assert "warning: rig-inverted: 4 images say that the camera's mounting is the wrong way" in said
    assert "`civil-rgbd rig check`" in said
    assert "points of the first 2 frames fall into the image" in refused
    line = next(line for line in said.splitlines() if line.strip().startswith("T_lidar_camera ="))
    stated = np.array(json.loads(line.partition("=")[2]))
    np.testing.assert_allclose(
        stated, SimulatedRecording(SPEC).rig.T_lidar_camera, atol=1e-8
    )  # to be pasted
