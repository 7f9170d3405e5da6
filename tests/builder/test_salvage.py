"""Single damaged messages inside a whole file: counted under salvage, the same for all workers."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from civil_rgbd.builder.run import BuildOptions, build_bridge
from civil_rgbd.builder.verify import rebuild_frames
from civil_rgbd.conversion.mcap import open_recording
from civil_rgbd.domain.recipe import Recipe
from civil_rgbd.domain.recording import RecordingOptions
from civil_rgbd.errors import BuildError, RecordingError
from civil_rgbd.format.layout import BRIDGES
from civil_rgbd.format.reader import read_bridge
from civil_rgbd.simulator.recorder import write_recording
from civil_rgbd.simulator.recording import SimulatedRecording
from civil_rgbd.validation import validate

from ..conversion import scene
from ..conversion.containers import messages_of
from .conftest import INFO, contents


@pytest.fixture(scope="module")
def damaged(recording: SimulatedRecording, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The simulated scan, with one cloud and three images cut inside."""
    folder = tmp_path_factory.mktemp("damaged")
    write_recording(folder / "whole.mcap", recording.spec)
    found = messages_of(folder / "whole.mcap")
    for kind, count in (("CustomMsg", 1), ("CompressedImage", 3)):
        places = [at for at, message in enumerate(found) if message.type_name.endswith(kind)]
        middle = len(places) // 2
        for at in places[middle : middle + count]:
            found[at] = found[at]._replace(payload=found[at].payload[:-40])
    return scene.write(folder / "scan.mcap", found)


def test_without_salvage_the_first_damaged_message_is_named(
    damaged: Path, recipe: Recipe, tmp_path: Path
) -> None:
    with pytest.raises(RecordingError, match="breaks its own layout") as caught:
        build_bridge(open_recording(damaged), recipe, tmp_path, INFO, BuildOptions())

    assert "--salvage" in caught.value.fix
    assert not (tmp_path / BRIDGES).exists()


def test_under_salvage_they_are_counted_the_same_by_all_workers(
    damaged: Path, recipe: Recipe, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recording = open_recording(damaged, RecordingOptions(salvage=True))
    report = build_bridge(recording, recipe, tmp_path / "one", INFO, BuildOptions())
    monkeypatch.setattr("civil_rgbd.builder.plan.CHUNK_FRAMES", 3)
    build_bridge(recording, recipe, tmp_path / "two", INFO, BuildOptions(workers=2))

    manifest = read_bridge(tmp_path / "one" / BRIDGES / INFO.bridge_id).manifest
    counts = manifest.counts
    assert counts.skipped == {"scan-undecodable": 1}
    assert report.notes.salvage == manifest.salvage
    assert "  salvaged      1 scan of the " in report.to_text()
    assert manifest.salvage is not None
    assert manifest.salvage.endswith("that were read are damaged inside and left out")
    assert 1 <= counts.dropped["image-undecodable"] <= 3  # some are too near the previous one
    assert "messages_unreadable" not in counts.points_dropped
    assert validate(tmp_path / "one").findings == ()
    assert contents(tmp_path / "one") == contents(tmp_path / "two")


def test_what_a_build_found_damaged_does_not_make_it_another_build(
    damaged: Path, recipe: Recipe, tmp_path: Path
) -> None:
    recording = open_recording(damaged, RecordingOptions(salvage=True))
    first = build_bridge(recording, recipe, tmp_path, INFO, BuildOptions())
    again = build_bridge(recording, recipe, tmp_path, INFO, BuildOptions())
    assert again.already_whole
    assert again.notes.salvage == first.notes.salvage is not None


def test_what_a_build_found_damaged_does_not_keep_it_from_being_proved(
    damaged: Path, recipe: Recipe, tmp_path: Path
) -> None:
    recording = open_recording(damaged, RecordingOptions(salvage=True))
    report = build_bridge(recording, recipe, tmp_path, INFO, BuildOptions())
    bridge = read_bridge(report.folder)

    rebuilt = rebuild_frames(bridge, recording, bridge.rows)

    assert "left out" in (bridge.manifest.salvage or "")
    assert (rebuilt.frames, rebuilt.differences) == (len(bridge.rows), ())


def test_a_recording_that_lost_something_else_proves_nothing(
    damaged: Path, recipe: Recipe, tmp_path: Path
) -> None:
    recording = open_recording(damaged, RecordingOptions(salvage=True))
    report = build_bridge(recording, recipe, tmp_path, INFO, BuildOptions())
    bridge = read_bridge(report.folder)
    said = f"the file is cut; {bridge.manifest.salvage}"
    other = replace(bridge, manifest=replace(bridge.manifest, salvage=said))

    with pytest.raises(BuildError, match="salvage was 'the file is cut', is None"):
        rebuild_frames(other, recording, bridge.rows)
