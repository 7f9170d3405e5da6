"""Built with visibility and quality planes: counted, said, valid, gone on with, and proved."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from civil_rgbd.builder.chunks import BRIDGE, DONE, Job, finished_chunks, run_chunk
from civil_rgbd.builder.plan import Chunk, plan_frames
from civil_rgbd.builder.recipes import load_recipe
from civil_rgbd.builder.report import BuildReport
from civil_rgbd.builder.run import BuildOptions, build_bridge
from civil_rgbd.builder.verify import rebuild_frames
from civil_rgbd.domain.frame import EMPTY, QUALITY_PLANES
from civil_rgbd.domain.recipe import Recipe
from civil_rgbd.format.layout import BRIDGES
from civil_rgbd.format.reader import Bridge, read_bridge
from civil_rgbd.pipeline.frames import FrameMaker
from civil_rgbd.simulator.recording import SimulatedRecording
from civil_rgbd.validation import validate

from .conftest import INFO, contents


@pytest.fixture(scope="module")
def asking() -> Recipe:
    settings = ["accumulate.points=8000", "visibility.points=16000", "quality.pose_noise_m=0.01"]
    return load_recipe("250k-clean", settings)


@pytest.fixture(scope="module")
def built(
    recording: SimulatedRecording, asking: Recipe, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, BuildReport]:
    dataset = tmp_path_factory.mktemp("planes")
    return dataset, build_bridge(recording, asking, dataset, INFO, BuildOptions())


@pytest.fixture(scope="module")
def bridge(built: tuple[Path, BuildReport]) -> Bridge:
    return read_bridge(built[0] / BRIDGES / "B9")


def test_what_was_hidden_is_counted_and_said(
    built: tuple[Path, BuildReport], bridge: Bridge
) -> None:
    counted = bridge.manifest.counts.pixels_removed_by_visibility

    hidden = 0
    for row in bridge.rows:
        planes = bridge.read_quality(row)
        assert planes is not None
        hidden += int((planes["empty"] == EMPTY["hidden"]).sum())
    assert counted == hidden > 0
    assert "pixels of a frame removed by visibility" in built[1].to_text()


def test_the_folder_is_valid_and_its_manifest_says_what_the_planes_are(
    built: tuple[Path, BuildReport], bridge: Bridge
) -> None:
    assert validate(built[0]).findings == ()
    assert bridge.manifest.quality is not None
    planes = bridge.manifest.quality["planes"]
    assert isinstance(planes, list)
    assert [plane["channel"] for plane in planes] == list(QUALITY_PLANES)
    assert bridge.manifest.recipe is not None
    stage = bridge.manifest.recipe.parameters["quality"]
    assert isinstance(stage, dict)
    assert stage["planes"] == list(QUALITY_PLANES)


def test_a_frame_alone_comes_out_as_it_did_in_its_chunk(
    bridge: Bridge, recording: SimulatedRecording
) -> None:
    rebuilt = rebuild_frames(bridge, recording, bridge.rows[-2:])

    assert rebuilt.differences == ()


def test_other_planes_are_measured(bridge: Bridge, recording: SimulatedRecording) -> None:
    row = replace(bridge.rows[-1], quality_pixel_sha256="0" * 64)

    (difference,) = rebuild_frames(bridge, recording, [row]).differences

    assert difference.of == "quality"


def test_two_builds_are_equal_byte_by_byte(
    built: tuple[Path, BuildReport], recording: SimulatedRecording, asking: Recipe, tmp_path: Path
) -> None:
    build_bridge(recording, asking, tmp_path, INFO, BuildOptions())

    assert contents(tmp_path) == contents(built[0])


def test_a_chunk_with_a_damaged_quality_file_counts_as_not_done(
    recording: SimulatedRecording, asking: Recipe, tmp_path: Path
) -> None:
    for folder in (BRIDGE, DONE):
        (tmp_path / folder).mkdir()
    frames = plan_frames(recording, asking).frames[-2:]
    maker = FrameMaker(recording, asking)
    run_chunk(Job(recording, asking, frames, tmp_path), Chunk(0, 0, 2), maker, on_frame=bool)
    (record,) = finished_chunks(tmp_path)
    row = record.frames[0].row
    assert row is not None
    assert row.quality_path is not None

    (tmp_path / BRIDGE / row.quality_path).write_bytes(b"")

    assert finished_chunks(tmp_path) == []


def test_a_build_that_asks_for_nothing_has_nothing(
    recording: SimulatedRecording, recipe: Recipe, tmp_path: Path
) -> None:
    build_bridge(recording, recipe, tmp_path, INFO, BuildOptions())

    plain = read_bridge(tmp_path / BRIDGES / "B9")
    assert plain.manifest.quality is None
    assert plain.manifest.counts.pixels_removed_by_visibility is None
    assert plain.read_quality(plain.rows[0]) is None
    assert not (plain.folder / "quality").exists()
    text = (plain.folder / "manifest.json").read_text("utf-8")
    assert "visibility" not in text
