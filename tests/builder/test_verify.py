"""A folder is proved from its recording, or the difference is measured."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from civil_rgbd.builder.run import BuildOptions, build_bridge
from civil_rgbd.builder.verify import choose_frames, rebuild_frames, refuse_imported
from civil_rgbd.converters import open_recording
from civil_rgbd.domain.bridge import BridgeInfo, Counts, Manifest, Software
from civil_rgbd.domain.recipe import Recipe
from civil_rgbd.domain.recording import Recording, RecordingOptions
from civil_rgbd.errors import BuildError
from civil_rgbd.format.hashes import pixel_sha256
from civil_rgbd.format.layout import BRIDGES
from civil_rgbd.format.reader import Bridge, read_bridge
from civil_rgbd.simulator.recorder import write_recording
from civil_rgbd.simulator.recording import SimulatedRecording
from civil_rgbd.trajectories.rig import rig_from_document

from .conftest import INFO


@pytest.fixture(scope="module")
def source(recording: SimulatedRecording, tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("raw") / "scan.mcap"
    write_recording(file, recording.spec)
    return file


@pytest.fixture(scope="module")
def raw(source: Path) -> Recording:
    return open_recording(source)


@pytest.fixture(scope="module")
def bridge(raw: Recording, recipe: Recipe, tmp_path_factory: pytest.TempPathFactory) -> Bridge:
    dataset = tmp_path_factory.mktemp("built")
    build_bridge(raw, recipe, dataset, INFO, BuildOptions())
    return read_bridge(dataset / BRIDGES / "B9")


def test_every_frame_alone_comes_out_as_it_did_in_its_chunk(bridge: Bridge, raw: Recording) -> None:
    rebuilt = rebuild_frames(bridge, raw, bridge.rows)

    assert rebuilt.differences == ()
    assert rebuilt.frames == len(bridge.rows)
    assert rebuilt.versions == ()
    assert rebuilt.proved


def test_other_pixels_are_measured(bridge: Bridge, raw: Recording) -> None:
    class Altered(Bridge):
        """What is stored has another hash, and differs in one corner."""

        def read_depth(self, row):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202  # a fixture
            depth_m = super().read_depth(row).copy()
            depth_m[0, :2] += np.float32(0.25)
            return depth_m

        def read_rgb(self, row):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202  # a fixture
            rgb = super().read_rgb(row).copy()
            rgb[-1, -1, 0] ^= 8
            return rgb

    changed = Altered(bridge.folder, bridge.manifest, bridge.camera, bridge.rows)
    row = bridge.rows[3]
    other = dataclasses.replace(
        row,
        depth_pixel_sha256=pixel_sha256(changed.read_depth(row)),
        rgb_pixel_sha256=pixel_sha256(changed.read_rgb(row)),
        tx=row.tx + 1e-9,
    )

    pose, rgb, depth = rebuild_frames(changed, raw, [other]).differences

    pixels = bridge.camera.width_px * bridge.camera.height_px
    assert (pose.of, pose.what) == ("frame", "its pose is another one")
    assert (rgb.of, rgb.share, rgb.largest) == ("rgb", 1 / pixels, 8.0)
    assert (depth.of, depth.share) == ("depth", 2 / pixels)
    assert depth.largest == pytest.approx(0.25, abs=1e-6)
    assert "of the pixels differ, by at most 0.25 m" in depth.what


def test_a_frame_that_the_recipe_does_not_choose_is_said(bridge: Bridge, raw: Recording) -> None:
    stranger = dataclasses.replace(bridge.rows[0], source_index=bridge.rows[0].source_index + 1)
    late = dataclasses.replace(bridge.rows[1], stamp_ns=bridge.rows[1].stamp_ns + 1)

    first, second = rebuild_frames(bridge, raw, [stranger, late]).differences

    assert first.what == "the recipe does not choose this image"
    assert second.what.startswith("its stamp is ")


def test_other_versions_are_named(bridge: Bridge, raw: Recording) -> None:
    then = dataclasses.replace(
        bridge.manifest.software, packages={**bridge.manifest.software.packages, "numpy": "1.0"}
    )
    older = dataclasses.replace(
        bridge, manifest=dataclasses.replace(bridge.manifest, software=then)
    )

    (difference,) = rebuild_frames(older, raw, bridge.rows[:1]).versions

    assert difference.startswith("numpy: 1.0 then, ")


def test_another_recording_is_refused(
    bridge: Bridge, recording: SimulatedRecording, tmp_path: Path
) -> None:
    write_recording(tmp_path / "scan.mcap", dataclasses.replace(recording.spec, seed=5))

    with pytest.raises(BuildError, match="not the bridge's sources: the manifest names") as caught:
        rebuild_frames(bridge, open_recording(tmp_path / "scan.mcap"), bridge.rows[:1])

    assert bridge.manifest.sources[0].sha256 in caught.value.what
    assert "--source FILE" in caught.value.fix


def test_a_recording_that_is_read_otherwise_is_refused(bridge: Bridge, source: Path) -> None:
    rig = rig_from_document({"camera_time_offset_s": 0.25}, where="rig.toml")
    other = open_recording(source, RecordingOptions(rig=rig))

    with pytest.raises(BuildError, match=r"rig.camera_time_offset_s was 0.0, is 0.25") as caught:
        rebuild_frames(bridge, other, bridge.rows[:1])

    assert "--rig" in caught.value.fix


def test_a_renamed_recording_is_the_same(bridge: Bridge, source: Path, tmp_path: Path) -> None:
    (tmp_path / "other_name.mcap").write_bytes(source.read_bytes())

    rebuilt = rebuild_frames(bridge, open_recording(tmp_path / "other_name.mcap"), bridge.rows[:1])

    assert rebuilt.differences == ()


def test_an_imported_bridge_cannot_be_rendered_again() -> None:
    manifest = Manifest(
        info=BridgeInfo("B1"),
        origin="imported",
        sources=(),
        software=Software("0.1.0", "3.11", {}),
        counts=Counts(images_seen=1, frames_kept=1),
    )

    with pytest.raises(BuildError, match="imported") as caught:
        refuse_imported(manifest)

    assert "leave --rebuild out" in caught.value.fix


def test_the_same_seed_draws_the_same_frames_of_all_bridges(bridge: Bridge) -> None:
    rows = {"a": bridge.rows, "b": bridge.rows[:5]}

    first, again = (choose_frames(rows, 9, seed=3) for _ in range(2))
    other = choose_frames(rows, 9, seed=4)

    assert first == again != other
    assert sum(map(len, first.values())) == 9
    assert sum(map(len, choose_frames(rows, 999, seed=0).values())) == len(bridge.rows) + 5
    assert choose_frames(rows, 0, seed=0) == {}
