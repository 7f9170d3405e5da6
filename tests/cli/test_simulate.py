"""``civil-rgbd simulate`` from outside."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from civil_rgbd.cli import main
from civil_rgbd.converters import open_recording
from civil_rgbd.domain.recording import RecordingOptions
from civil_rgbd.trajectories.files import read_trajectory_file
from civil_rgbd.trajectories.rig import read_rig

QUICK = ["--seconds", "0.3", "--image-scale", "0.05", "--point-rate-hz", "600"]


def test_it_writes_a_recording_and_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code = main(["simulate", str(tmp_path / "raw.mcap"), *QUICK])

    assert code == 0
    assert "0.3 s of bridge 'demo'" in capsys.readouterr().out
    assert [entry.name for entry in tmp_path.iterdir()] == ["raw.mcap"]


def test_the_truth_is_written_beside_it_on_request(tmp_path: Path) -> None:
    code = main(["simulate", str(tmp_path / "raw.mcap"), *QUICK, "--truth-depth-scale", "0.5"])

    assert code == 0
    assert sorted(entry.name for entry in (tmp_path / "raw.truth").iterdir()) == [
        "defects.json",
        "depth",
        "images.csv",
        "poses.csv",
        "scene.json",
        "scene.ply",
    ]


def test_overwriting_without_truth_removes_the_old_truth_and_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = str(tmp_path / "raw.mcap")
    assert main(["simulate", out, *QUICK, "--truth"]) == 0
    assert (tmp_path / "raw.truth").exists()

    assert main(["simulate", out, *QUICK, "--seed", "1", "--overwrite"]) == 0

    assert not (tmp_path / "raw.truth").exists()
    assert "raw.truth: removed" in capsys.readouterr().out


@pytest.mark.parametrize("options", [[], ["--overwrite"], ["--truth"], ["--truth", "--overwrite"]])
def test_the_truth_of_another_recording_of_that_name_is_kept(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str]
) -> None:
    assert main(["simulate", str(tmp_path / "st.bag"), *QUICK, "--seed", "7", "--truth"]) == 0
    capsys.readouterr()

    code = main(["simulate", str(tmp_path / "st.mcap"), *QUICK, *options])

    assert code == 2
    said = capsys.readouterr().err
    assert "st.truth is there already, the truth of st.bag" in said
    assert "choose another name" in said
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["st.bag", "st.truth"]
    assert json.loads((tmp_path / "st.truth/scene.json").read_text())["spec"]["seed"] == 7


def test_a_truth_whose_recording_is_gone_is_replaced_on_request_only(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["simulate", str(tmp_path / "raw.bag"), *QUICK, "--truth"]) == 0
    (tmp_path / "raw.bag").unlink()
    command = ["simulate", str(tmp_path / "raw.mcap"), *QUICK]

    assert main(command) == 2
    assert "the truth of raw.bag, which is gone" in capsys.readouterr().err
    assert main([*command, "--truth", "--overwrite"]) == 0
    assert json.loads((tmp_path / "raw.truth/scene.json").read_text())["recording"] == "raw.mcap"


def test_a_folder_that_is_no_truth_is_kept(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "raw.truth").mkdir()
    (tmp_path / "raw.truth/precious.txt").write_text("by hand")

    assert main(["simulate", str(tmp_path / "raw.mcap"), *QUICK, "--overwrite"]) == 2

    assert "says of no recording" in capsys.readouterr().err
    assert [entry.name for entry in tmp_path.rglob("*")] == ["raw.truth", "precious.txt"]


def test_a_truth_that_was_renamed_with_its_recording_stays_its_own(tmp_path: Path) -> None:
    out = tmp_path / "new.mcap"
    assert main(["simulate", str(tmp_path / "raw.mcap"), *QUICK, "--truth"]) == 0
    (tmp_path / "raw.mcap").rename(out)
    (tmp_path / "raw.truth").rename(tmp_path / "new.truth")
    assert main(["simulate", str(tmp_path / "raw.mcap"), *QUICK]) == 0

    assert main(["simulate", str(out), *QUICK, "--overwrite"]) == 0
    assert not (tmp_path / "new.truth").exists()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--seconds", "-1"], "seconds is -1.0, not between 0.2 and 3600"),
        (["--seconds", "long"], "seconds is 'long', not a number"),
        (["--noise-m", "nan"], "range_noise_m is nan"),
        (["--seed", "1.5"], "not a whole number"),
        (["--bridge", "dem"], "did you mean 'demo'"),
        (["--camera-time-offset-s", "inf"], "camera_time_offset_s is inf"),
        (["--truth-depth-scale", "0"], "0"),
    ],
)
def test_a_value_that_does_not_fit_is_a_clear_error(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str], message: str
) -> None:
    code = main(["simulate", str(tmp_path / "raw.mcap"), *options])

    assert code == 2
    assert message in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_a_file_that_is_there_is_kept(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "raw.mcap").write_bytes(b"precious")

    code = main(["simulate", str(tmp_path / "raw.mcap"), *QUICK])

    assert code == 2
    assert "there already" in capsys.readouterr().err
    assert (tmp_path / "raw.mcap").read_bytes() == b"precious"


def test_a_name_of_no_recording_is_refused_with_a_right_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code = main(["simulate", str(tmp_path / "raw.db3"), *QUICK])

    assert code == 2
    assert "write to 'raw.mcap'" in capsys.readouterr().err


def test_what_a_bag_lacks_lies_beside_it_and_makes_the_same_recording(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lacking = ["--without", "poses", "--without", "extrinsics"]
    assert main(["simulate", str(tmp_path / "raw.bag"), *QUICK, *lacking]) == 0

    said = capsys.readouterr().out
    assert "raw.poses.tum: the poses, which the recording lacks" in said
    assert "raw.rig.toml: the extrinsics, which the recording lacks" in said
    assert main(["inspect-recording", str(tmp_path / "raw.bag")]) == 1
    missing = capsys.readouterr().out
    assert "no-poses" in missing
    assert "no-camera-link" in missing
    trajectory = read_trajectory_file(tmp_path / "raw.poses.tum").trajectory
    rig = read_rig(tmp_path / "raw.rig.toml")
    options = RecordingOptions(rig=rig, trajectory=trajectory, pose_of="imu")
    opened = open_recording(tmp_path / "raw.bag", options)
    expected = open_recording("simulated:demo?seconds=0.3&image_scale=0.05&point_rate_hz=600")
    np.testing.assert_allclose(opened.rig.T_body_camera, expected.rig.T_body_camera, atol=1e-12)
    np.testing.assert_array_equal(opened.rig.T_body_lidar, expected.rig.T_body_lidar)
    for name in ("stamps_ns", "translations_m", "quaternions_xyzw"):
        np.testing.assert_array_equal(
            getattr(opened.trajectory, name), getattr(expected.trajectory, name)
        )


def test_a_rig_file_that_is_there_is_not_replaced_unasked(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "raw.rig.toml").write_text("precious")
    command = ["simulate", str(tmp_path / "raw.bag"), *QUICK, "--without", "extrinsics"]

    assert main(command) == 2
    assert "raw.rig.toml is there already" in capsys.readouterr().err
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["raw.rig.toml"]
    assert (tmp_path / "raw.rig.toml").read_text() == "precious"

    assert main([*command, "--overwrite"]) == 0
    assert "T_lidar_camera" in (tmp_path / "raw.rig.toml").read_text()


def test_the_file_may_be_named_by_an_option_and_any_setting_set(tmp_path: Path) -> None:
    out = str(tmp_path / "b3.mcap")
    options = ["--image-rate-hz", "0.5", "--set", "stands_s=0", "--truth"]  # no image: quick
    options += ["--extrinsic-error-deg", "0", "1.5", "0"]

    assert main(["simulate", "--bridge", "B3", *QUICK, *options, "--out", out]) == 0

    spec = json.loads((tmp_path / "b3.truth" / "scene.json").read_text())["spec"]
    assert (spec["bridge"], spec["pattern"]) == ("B3", "avia")
    assert spec.get("stands_s", 0.0) == 0.0
    assert spec["extrinsic_error_deg"] == [0.0, 1.5, 0.0]


@pytest.mark.parametrize(
    ("arguments", "what"),
    [
        ([], "no file to write to"),
        (["one.mcap", "--out", "two.mcap"], "two files to write to: two.mcap, one.mcap"),
        (["one.mcap", "--set", "sway"], "--set 'sway' is not of the form NAME=VALUE"),
        (["one.mcap", "--set", "seed=1", "--seed", "2"], "--set 'seed=1' is given twice"),
        (["one.mcap", "--set", "swya=1"], "did you mean 'sway'"),
        (["one.mcap", "--extrinsic-error-m", "0", "nan", "0"], "not finite"),
    ],
)
def test_orders_that_do_not_fit_are_refused(
    arguments: list[str], what: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["simulate", *arguments]) == 2
    assert what in capsys.readouterr().err
