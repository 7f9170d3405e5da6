"""A build is whole or absent, the same whoever makes it, and goes on after a kill."""

from __future__ import annotations

import dataclasses
import errno
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from civil_rgbd.builder.chunks import BRIDGE, DONE
from civil_rgbd.builder.recipes import load_recipe
from civil_rgbd.builder.run import BuildOptions, build_bridge
from civil_rgbd.domain.recipe import Recipe
from civil_rgbd.domain.recording import RecordingNotes
from civil_rgbd.errors import BuildError, OutputError, RecordingError, UsageError
from civil_rgbd.format.layout import BRIDGES, PARTIAL
from civil_rgbd.format.reader import read_bridge
from civil_rgbd.geometry.transforms import inverse
from civil_rgbd.simulator.recording import SimulatedRecording
from civil_rgbd.simulator.spec import ScanSpec
from civil_rgbd.validation import validate

from .conftest import INFO, contents

QUIET = BuildOptions()


@pytest.fixture(scope="module")
def built(
    recording: SimulatedRecording, recipe: Recipe, tmp_path_factory: pytest.TempPathFactory
) -> Path:
    """The reference: one process, from beginning to end."""
    dataset = tmp_path_factory.mktemp("built")
    build_bridge(recording, recipe, dataset, INFO, QUIET)
    return dataset


def test_a_build_validates_clean(built: Path) -> None:
    assert validate(built).findings == ()


def test_every_image_is_kept_or_counted(built: Path, recording: SimulatedRecording) -> None:
    counts = read_bridge(built / BRIDGES / "B9").manifest.counts

    assert counts.images_seen == len(recording.image_stamps_ns)
    assert counts.frames_kept + sum(counts.dropped.values()) == counts.images_seen
    assert counts.dropped["too-few-points"] > 0
    assert counts.dropped["image-too-near-previous"] > 0


def test_two_processes_and_small_chunks_give_the_same_bytes(
    built: Path,
    recording: SimulatedRecording,
    recipe: Recipe,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("civil_rgbd.builder.plan.CHUNK_FRAMES", 3)

    build_bridge(recording, recipe, tmp_path, INFO, BuildOptions(workers=2))

    assert contents(tmp_path) == contents(built)


def test_nothing_but_the_dataset_is_left(built: Path) -> None:
    assert {path.name for path in built.iterdir()} == {BRIDGES, "dataset.json"}


class _StopAfter:
    def __init__(self, frames: int) -> None:
        self.left = frames

    def __call__(self, done: int, _total: int) -> None:
        self.left -= done
        if self.left < 0:
            raise KeyboardInterrupt


def test_an_interrupted_build_is_invisible_and_goes_on_to_the_same_bytes(
    built: Path,
    recording: SimulatedRecording,
    recipe: Recipe,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("civil_rgbd.builder.plan.CHUNK_FRAMES", 4)
    with pytest.raises(KeyboardInterrupt):
        build_bridge(recording, recipe, tmp_path, INFO, BuildOptions(on_progress=_StopAfter(9)))
    assert not (tmp_path / BRIDGES / "B9").exists()

    report = build_bridge(recording, recipe, tmp_path, INFO, QUIET)

    assert report.frames_found == 8
    assert contents(tmp_path) == contents(built)


def test_a_finished_chunk_with_a_damaged_file_is_made_again(
    built: Path,
    recording: SimulatedRecording,
    recipe: Recipe,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("civil_rgbd.builder.plan.CHUNK_FRAMES", 4)
    with pytest.raises(KeyboardInterrupt):
        build_bridge(recording, recipe, tmp_path, INFO, BuildOptions(on_progress=_StopAfter(9)))
    partial = tmp_path / PARTIAL / "B9"
    emptied, other = sorted((partial / DONE).glob("*.json"))
    emptied.write_text("")  # as a power cut leaves it
    depth_path = next(
        f["row"]["depth_path"] for f in json.loads(other.read_text())["frames"] if f["row"]
    )
    depth = partial / BRIDGE / depth_path
    depth.write_bytes(depth.read_bytes()[:-7] + b"garbage")

    report = build_bridge(recording, recipe, tmp_path, INFO, QUIET)

    assert report.frames_found == 0
    assert contents(tmp_path) == contents(built)


BUILD_AND_HANG = """
import sys, time
from pathlib import Path
from civil_rgbd.builder.run import BuildOptions, build_bridge
from civil_rgbd.builder import plan
from civil_rgbd.builder.recipes import load_recipe
from civil_rgbd.domain.bridge import BridgeInfo
from civil_rgbd.simulator.recording import SimulatedRecording
from civil_rgbd.simulator.spec import ScanSpec
plan.CHUNK_FRAMES = 3
seen = 0
def progress(done, total):
    global seen
    seen += done
    if seen >= 6:
        print("half", flush=True)
        time.sleep(60)
if __name__ == "__main__":
    spec = ScanSpec(seconds=3.0, image_scale=0.1, point_rate_hz=12_000, image_rate_hz=15.0)
    build_bridge(
        SimulatedRecording(spec), load_recipe("250k", ["accumulate.points=8000"]),
        Path(sys.argv[1]), BridgeInfo("B9", licence="CC0-1.0"),
        BuildOptions(workers=int(sys.argv[2]), on_progress=progress),
    )
"""


@pytest.mark.slow
@pytest.mark.parametrize("workers", [1, 2])
def test_a_killed_build_goes_on_to_the_same_bytes(
    built: Path, recording: SimulatedRecording, recipe: Recipe, tmp_path: Path, workers: int
) -> None:
    script = tmp_path / "build_and_hang.py"
    script.write_text(BUILD_AND_HANG)
    out = tmp_path / "out"
    with subprocess.Popen(
        [sys.executable, str(script), str(out), str(workers)], stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "half\n"
        process.kill()
    assert not (out / BRIDGES / "B9").exists()

    report = build_bridge(recording, recipe, out, INFO, QUIET)

    assert report.frames_found >= 3
    assert contents(out) == contents(built)


def test_the_same_command_again_does_nothing(
    recording: SimulatedRecording, recipe: Recipe, tmp_path: Path
) -> None:
    build_bridge(recording, recipe, tmp_path, INFO, QUIET)
    before = {path: path.stat().st_mtime_ns for path in (tmp_path / BRIDGES).rglob("*")}

    report = build_bridge(recording, recipe, tmp_path, INFO, QUIET)

    assert report.already_whole
    assert {path: path.stat().st_mtime_ns for path in (tmp_path / BRIDGES).rglob("*")} == before


def test_another_recipe_is_refused_until_overwrite(
    recording: SimulatedRecording, recipe: Recipe, tmp_path: Path
) -> None:
    build_bridge(recording, recipe, tmp_path, INFO, QUIET)
    other = load_recipe("250k", ["accumulate.points=4000"])

    with pytest.raises(BuildError, match=r"built otherwise \(different: recipe\)") as caught:
        build_bridge(recording, other, tmp_path, INFO, QUIET)
    assert "--overwrite" in caught.value.fix

    build_bridge(recording, other, tmp_path, INFO, BuildOptions(overwrite=True))
    recipe_now = read_bridge(tmp_path / BRIDGES / "B9").manifest.recipe
    assert recipe_now is not None
    assert recipe_now.parameters["accumulate"]["points"] == 4000  # type: ignore[index]  # JSON


def test_measured_defects_are_not_overwritten(
    recording: SimulatedRecording, recipe: Recipe, tmp_path: Path
) -> None:
    build_bridge(recording, recipe, tmp_path, INFO, QUIET)
    defects = tmp_path / BRIDGES / "B9" / "defects.json"
    defects.write_text("{}")
    other = load_recipe("250k", ["accumulate.points=4000"])

    with pytest.raises(BuildError, match="measured defects"):
        build_bridge(recording, other, tmp_path, INFO, BuildOptions(overwrite=True))

    assert defects.read_text() == "{}"


def test_an_unfinished_build_of_another_recipe_is_refused_until_overwrite(
    recording: SimulatedRecording, recipe: Recipe, tmp_path: Path
) -> None:
    with pytest.raises(KeyboardInterrupt):
        build_bridge(recording, recipe, tmp_path, INFO, BuildOptions(on_progress=_StopAfter(2)))
    other = load_recipe("250k", ["accumulate.points=4000"])

    with pytest.raises(BuildError, match=r"begun otherwise \(different: recipe\)"):
        build_bridge(recording, other, tmp_path, INFO, QUIET)

    build_bridge(recording, other, tmp_path, INFO, BuildOptions(overwrite=True))
    assert validate(tmp_path).findings == ()


def test_ids_are_unique_ignoring_case(
    recording: SimulatedRecording, recipe: Recipe, tmp_path: Path
) -> None:
    (tmp_path / BRIDGES / "b9").mkdir(parents=True)

    with pytest.raises(UsageError, match="differs only in case"):
        build_bridge(recording, recipe, tmp_path, INFO, QUIET)


@pytest.mark.parametrize("bridge_id", ["", "-B3", "a b", "../B3", "x" * 65])
def test_a_bad_id_is_refused_before_anything_is_made(
    recording: SimulatedRecording, recipe: Recipe, tmp_path: Path, bridge_id: str
) -> None:
    info = dataclasses.replace(INFO)
    object.__setattr__(info, "bridge_id", bridge_id)

    with pytest.raises(UsageError, match="is no bridge id"):
        build_bridge(recording, recipe, tmp_path / "new", info, QUIET)
    assert not (tmp_path / "new").exists()


def test_a_ring_that_never_fills_says_how_many_points_there_were(
    recording: SimulatedRecording, tmp_path: Path
) -> None:
    greedy = load_recipe("250k")

    with pytest.raises(
        BuildError, match=r"250000 are needed, the fullest of \d+ windows held"
    ) as e:
        build_bridge(recording, greedy, tmp_path, INFO, QUIET)

    assert "accumulate.min_fill" in e.value.fix
    assert not (tmp_path / BRIDGES).exists()
    assert not list((tmp_path / PARTIAL).glob("*"))


class _OtherTopic(SimulatedRecording):
    """The same stamps, rig and poses, but another topic was chosen."""

    @property
    def notes(self) -> RecordingNotes:
        return dataclasses.replace(super().notes, reading={"lidar_topic": "/rear/lidar"})


def test_a_bridge_of_another_topic_is_not_taken_for_this_one(
    recording: SimulatedRecording, recipe: Recipe, tmp_path: Path
) -> None:
    build_bridge(recording, recipe, tmp_path, INFO, QUIET)

    with pytest.raises(BuildError, match=r"built otherwise \(different: reading\)"):
        build_bridge(_OtherTopic(recording.spec), recipe, tmp_path, INFO, QUIET)


def test_a_stopped_build_of_another_topic_is_not_gone_on_with(
    recording: SimulatedRecording, recipe: Recipe, tmp_path: Path
) -> None:
    with pytest.raises(KeyboardInterrupt):
        build_bridge(recording, recipe, tmp_path, INFO, BuildOptions(on_progress=_StopAfter(2)))

    with pytest.raises(BuildError, match=r"begun otherwise \(different: reading\)"):
        build_bridge(_OtherTopic(recording.spec), recipe, tmp_path, INFO, QUIET)


def test_a_record_that_was_found_damaged_does_not_come_back(
    built: Path,
    recording: SimulatedRecording,
    recipe: Recipe,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("civil_rgbd.builder.plan.CHUNK_FRAMES", 4)
    with pytest.raises(KeyboardInterrupt):
        build_bridge(recording, recipe, tmp_path, INFO, BuildOptions(on_progress=_StopAfter(9)))
    partial = tmp_path / PARTIAL / "B9"
    depth = min(partial.rglob("*.exr"))
    whole = depth.read_bytes()
    depth.write_bytes(b"")
    monkeypatch.setattr("civil_rgbd.builder.plan.CHUNK_FRAMES", 6)
    with pytest.raises(KeyboardInterrupt):
        build_bridge(recording, recipe, tmp_path, INFO, BuildOptions(on_progress=_StopAfter(12)))
    depth.write_bytes(whole)

    build_bridge(recording, recipe, tmp_path, INFO, QUIET)

    assert contents(tmp_path) == contents(built)


class _TurnedRound(SimulatedRecording):
    """Somebody wrote the extrinsics down the wrong way round."""

    @property
    def rig(self):  # type: ignore[no-untyped-def,override]  # noqa: ANN202  # a fixture
        rig = super().rig
        return dataclasses.replace(rig, T_body_camera=inverse(rig.T_body_camera))


def test_extrinsics_that_look_away_are_said_in_words(recipe: Recipe, tmp_path: Path) -> None:
    spec = ScanSpec(seconds=2.0, image_scale=0.1, point_rate_hz=12_000)

    with pytest.raises(RecordingError, match="fall into the image: the camera sits at x") as caught:
        build_bridge(_TurnedRound(spec), recipe, tmp_path, INFO, QUIET)

    assert "T_lidar_camera takes camera points to the LiDAR frame" in caught.value.fix


def test_a_distorted_camera_is_not_stored_as_it_is(
    recording: SimulatedRecording, tmp_path: Path
) -> None:
    raw = load_recipe("250k", ["accumulate.points=8000", "image.undistort=false"])

    with pytest.raises(BuildError, match="distortion"):
        build_bridge(recording, raw, tmp_path, INFO, QUIET)


def test_a_full_disk_is_said_and_leaves_no_bridge(
    recording: SimulatedRecording, recipe: Recipe, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # The one thing that cannot be made for real without mounting a file system.
    replace, calls = os.replace, 0

    def full(source: object, target: object) -> None:
        nonlocal calls
        calls += 1
        if calls > 5:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        replace(source, target)  # type: ignore[arg-type]  # handed through

    monkeypatch.setattr("os.replace", full)
    monkeypatch.setattr("os.rename", full)
    with pytest.raises(OutputError, match="No space left"):
        build_bridge(recording, recipe, tmp_path, INFO, QUIET)
    assert not (tmp_path / BRIDGES / "B9").exists()


def test_a_folder_that_is_a_file_is_said(
    recording: SimulatedRecording, recipe: Recipe, tmp_path: Path
) -> None:
    (tmp_path / "taken").write_text("not a folder")

    with pytest.raises(OutputError, match="cannot write"):
        build_bridge(recording, recipe, tmp_path / "taken", INFO, QUIET)


def test_two_builds_into_one_bridge_do_not_mix(
    recording: SimulatedRecording, recipe: Recipe, tmp_path: Path
) -> None:
    seen: list[str] = []

    def build_again(_done: int, _total: int) -> None:
        if not seen:
            with pytest.raises(OutputError, match="is writing here") as caught:
                build_bridge(recording, recipe, tmp_path, INFO, QUIET)
            seen.append(caught.value.fix)

    build_bridge(recording, recipe, tmp_path, INFO, BuildOptions(on_progress=build_again))

    assert "wait for it" in seen[0]


def test_frames_far_from_the_origin_are_the_same(recipe: Recipe, tmp_path: Path) -> None:
    near = ScanSpec(seconds=2.0, image_scale=0.1, point_rate_hz=12_000)
    far = dataclasses.replace(near, map_offset_m=(540_000.0, 4_810_000.0, 330.0))
    depths = []
    for name, spec in (("near", near), ("far", far)):
        build_bridge(SimulatedRecording(spec), recipe, tmp_path / name, INFO, QUIET)
        bridge = read_bridge(tmp_path / name / BRIDGES / "B9")
        depths.append(np.stack([bridge.read_depth(row) for row in bridge.rows]))

    assert depths[0].shape == depths[1].shape
    assert np.abs(depths[0] - depths[1]).max() <= 0.001


def test_a_worker_that_dies_costs_its_chunk_only(
    built: Path, recording: SimulatedRecording, recipe: Recipe, tmp_path: Path
) -> None:
    killed: list[int] = []

    def kill_a_worker(_done: int, _total: int) -> None:
        import psutil

        children = psutil.Process().children()
        workers = [child for child in children if "spawn_main" in " ".join(child.cmdline())]
        if workers and not killed:
            killed.append(workers[0].pid)
            os.kill(workers[0].pid, signal.SIGKILL)
            time.sleep(0.1)

    options = BuildOptions(workers=2, on_progress=kill_a_worker)
    build_bridge(recording, recipe, tmp_path, INFO, options)

    assert killed
    assert contents(tmp_path) == contents(built)
