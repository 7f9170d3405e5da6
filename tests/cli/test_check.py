"""``civil-rgbd check``: a walk that is fit, one without poses, and faults planted into messages."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from civil_rgbd.builder.recipes import load_recipe
from civil_rgbd.cli import main
from civil_rgbd.cli.check import gather
from civil_rgbd.domain.recording import RecordingOptions
from civil_rgbd.health.check import check_recording
from civil_rgbd.health.checks import CHECKS, Figure
from civil_rgbd.simulator.recorder import write_recording
from civil_rgbd.simulator.spec import ScanSpec

from ..planted import FAULTS, clean
from ..recording_faults import ODOMETRY, TRANSFORMS, drop, extent_of, restamp, rewrite

FAR_M = (540_000.0, 4_810_000.0, 330.0)
WALKS = {
    "past": ScanSpec(seconds=14.0, sway=2.0, speed_m_s=1.0),
    "slow": ScanSpec(seconds=14.0, sway=3.0, speed_m_s=0.6, seed=3),
    "far": ScanSpec(seconds=14.0, sway=2.5, speed_m_s=0.8, map_offset_m=FAR_M),
}


def _checked(path: Path, capsys: pytest.CaptureFixture[str], *options: str) -> tuple[int, dict]:
    capsys.readouterr()
    code = main(["check", str(path), "--json", *options])
    return code, json.loads(capsys.readouterr().out)


@pytest.fixture(scope="module")
def short_walk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four seconds, small: for what no length is needed for."""
    path = tmp_path_factory.mktemp("short") / "short.mcap"
    spec = ScanSpec(seconds=4.0, image_scale=0.2, image_rate_hz=8, point_rate_hz=120_000, sway=3.0)
    write_recording(path, spec)
    return path


def test_a_fit_recording_gives_every_figure_and_exit_code_0(
    short_walk: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, document = _checked(short_walk, capsys)

    assert code == 0
    assert document["fit"] is True
    assert document["findings"] == []
    assert [figure["code"] for figure in document["figures"]] == list(CHECKS)


def test_what_is_not_observable_has_a_reason_and_no_number(
    short_walk: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    _, document = _checked(short_walk, capsys)
    unknown = [figure for figure in document["figures"] if figure["state"] == "not observable"]

    assert "clock-drift" in {figure["code"] for figure in unknown}
    assert all(figure["value"] is None and figure["detail"] for figure in unknown)


def test_a_finding_gives_exit_code_1_a_figure_a_limit_and_a_remedy(
    short_walk: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    variant = FAULTS["pose-jump"](extent_of(short_walk), np.random.default_rng(1))
    jumping = rewrite(short_walk, tmp_path / "jumping.mcap", variant.edit)
    capsys.readouterr()

    code = main(["check", str(jumping)])

    text = capsys.readouterr().out
    assert code == 1
    assert "finding: pose-jump: largest jump of the poses: 0." in text
    assert "m (at most 0.1)" in text
    assert "fix: compute the poses again, or cut the recording there" in text


def test_a_recording_without_poses_is_checked_for_the_rest(
    short_walk: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bare = rewrite(short_walk, tmp_path / "bare.mcap", drop((ODOMETRY,), lambda _: True))

    code, document = _checked(bare, capsys)
    states = {figure["code"]: figure["state"] for figure in document["figures"]}

    assert code == 0  # poses are computed later
    assert [finding["code"] for finding in document["lacks"]] == ["no-poses"]
    assert states["scans-dropped"] == "fit"
    assert states["blurred"] == "fit"
    assert states["pose-drift"] == "not observable"
    assert states["coverage"] == "not observable"


def test_poses_that_cannot_be_used_are_not_said_to_be_absent(
    short_walk: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    halved = restamp((ODOMETRY,), lambda ns: ns - ns % 10_000_000)  # two poses to a stamp
    twice = rewrite(short_walk, tmp_path / "twice.mcap", halved)

    _, document = _checked(twice, capsys)
    jump = next(figure for figure in document["figures"] if figure["code"] == "pose-jump")

    assert jump["state"] == "not observable"
    assert "stamp" in jump["detail"]
    assert "no poses yet" not in jump["detail"]


def test_a_recording_that_no_build_can_open_is_an_error(
    short_walk: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bare = rewrite(short_walk, tmp_path / "bare.mcap", drop((TRANSFORMS,), lambda _: True))
    capsys.readouterr()

    assert main(["check", str(bare)]) == 2
    assert "nothing links" in capsys.readouterr().err


def test_a_recording_that_is_no_file_is_checked_as_well(
    capsys: pytest.CaptureFixture[str],
) -> None:
    where = "simulated:demo?seconds=2&image_scale=0.1&point_rate_hz=6000"
    capsys.readouterr()

    assert main(["check", where, "--json"]) == 1
    document = json.loads(capsys.readouterr().out)

    assert document["findings"] == ["frames"]  # two seconds have too few points
    drift = next(figure for figure in document["figures"] if figure["code"] == "clock-drift")
    assert drift["detail"] == "too few log times to compare stamps with"


def test_every_fault_that_is_planted_is_a_check_and_most_checks_are_planted() -> None:
    assert set(FAULTS) <= set(CHECKS)
    assert set(CHECKS) - set(FAULTS) == {"frames"}


def test_a_limit_is_the_last_fit_value() -> None:
    assert not Figure("blurred", CHECKS["blurred"].limit).found
    assert not Figure("coverage", CHECKS["coverage"].limit).found
    assert Figure("blurred", CHECKS["blurred"].limit + 0.1).found
    assert Figure("coverage", CHECKS["coverage"].limit - 0.1).found
    assert not Figure("blurred", None).found


def test_the_real_drive_under_a_bridge_is_fit(
    shared_data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    drive = shared_data / "kitti_bridge_drive" / "kitti_20frames.mcap"

    code, document = _checked(drive, capsys)
    figures = {figure["code"]: figure for figure in document["figures"]}

    assert code == 0
    assert figures["time-offset"]["state"] == "not observable"
    assert figures["extrinsics"]["state"] == "not observable"
    assert figures["rig-inverted"]["value"] == 0.0
    assert 10 < figures["coverage"]["value"] < 25
    assert figures["frames"]["value"] == 20


@pytest.fixture(scope="module", params=list(WALKS))
def walk(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A walk to plant faults in."""
    from dataclasses import replace

    path = tmp_path_factory.mktemp("walks") / f"{request.param}.mcap"
    spec = replace(WALKS[request.param], image_scale=0.5, image_rate_hz=12.0, range_noise_m=0.02)
    write_recording(path, spec)
    return path


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
def test_a_clean_part_of_a_walk_is_fit(
    walk: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], seed: int
) -> None:
    variant = clean(extent_of(walk), np.random.default_rng(seed))

    _, document = _checked(rewrite(walk, tmp_path / "clean.mcap", variant.edit), capsys)

    assert document["findings"] == []


@pytest.mark.slow
@pytest.mark.parametrize("fault", list(FAULTS))
def test_a_planted_fault_is_found(walk: Path, tmp_path: Path, fault: str) -> None:
    variant = FAULTS[fault](extent_of(walk), np.random.default_rng(len(fault)))
    faulty = rewrite(walk, tmp_path / "faulty.mcap", variant.edit)
    given, _ = gather((str(faulty),), RecordingOptions(source_hash=False))

    (figure,) = check_recording(given, load_recipe("250k"), (fault,))

    assert figure.found
