"""``manifest.json`` and ``bridge.toml``."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from civil_rgbd.domain.bridge import BridgeInfo, Counts, Location, Manifest, Software
from civil_rgbd.errors import FormatError, UsageError
from civil_rgbd.format.bridge_info import bridge_info_from_toml
from civil_rgbd.format.documents import document_text
from civil_rgbd.format.manifest import (
    manifest_from_document,
    manifest_to_document,
    read_manifest,
    write_manifest,
)
from civil_rgbd.resources import load_schema

from ..data.format_v1 import make


@pytest.fixture
def document(golden: Path) -> dict[str, Any]:
    parsed: dict[str, Any] = json.loads((golden / "bridges" / "B1" / "manifest.json").read_text())
    return parsed


def test_a_manifest_comes_back_as_it_was(tmp_path: Path) -> None:
    manifest = make.manifest(0.25)

    write_manifest(tmp_path / "manifest.json", manifest)

    back = read_manifest(tmp_path / "manifest.json")
    assert manifest_to_document(back) == manifest_to_document(manifest)
    assert back.info == manifest.info
    assert back.counts == manifest.counts
    assert back.sources == manifest.sources
    assert back.recipe == manifest.recipe
    assert back.rig is not None
    assert manifest.rig is not None
    assert back.rig.camera == manifest.rig.camera
    assert np.array_equal(back.rig.T_lidar_camera, manifest.rig.T_lidar_camera)
    assert back.map_origin_m == (540000.0, 4810000.0, 331.0)


def test_the_least_manifest_comes_back(tmp_path: Path) -> None:
    least = Manifest(
        info=BridgeInfo("B1"),
        origin="imported",
        sources=(),
        software=Software("0.1.0", "3.11", {}),
        counts=Counts(1, 1),
    )

    write_manifest(tmp_path / "manifest.json", least)

    back = read_manifest(tmp_path / "manifest.json")
    assert (back.rig, back.recipe, back.deskew, back.map_up) == (None, None, None, None)
    assert back.info.licence == "LicenseRef-Unstated"


def test_the_order_of_counting_does_not_reach_the_file() -> None:
    def text(**dropped: int) -> str:
        manifest = Manifest(
            info=BridgeInfo("B1"),
            origin="imported",
            sources=(),
            software=Software("0.1.0", "3.11", {}),
            counts=Counts(4, 1, dropped=dropped),
        )
        return document_text(manifest_to_document(manifest))

    assert text(a=1, b=2) == text(b=2, a=1)


def test_numbers_of_numpy_are_numbers(tmp_path: Path) -> None:
    manifest = Manifest(
        info=BridgeInfo("B1"),
        origin="imported",
        sources=(),
        software=Software("0.1.0", "3.11", {}),
        counts=Counts(np.int64(3), np.int64(3), mean_valid_share=np.float32(0.25)),  # type: ignore[arg-type]  # on purpose
    )

    write_manifest(tmp_path / "manifest.json", manifest)

    assert read_manifest(tmp_path / "manifest.json").counts.mean_valid_share == 0.25


@pytest.mark.parametrize(
    ("path", "value", "words"),
    [
        (["origin"], "found", "$.origin: 'found' is not one of"),
        (["bridge", "licence"], "", "$.bridge.licence"),
        (["bridge", "bridge_id"], "a/b", "$.bridge.bridge_id"),
        (["sources", 0, "name"], "../raw.mcap", "$.sources[0].name"),
        (["sources", 0, "sha256"], "ABC", "$.sources[0].sha256"),
        (["status"], "partial", "$.status: 'complete' was expected"),
        (["map_up"], [0, 0, 2], "map_up has norm 2.0"),
        (["recipe"], None, "origin 'rendered' with recipe None"),
        (["rig", "T_lidar_camera", 0, 0], 0.5, "T_lidar_camera is no rigid transform"),
        (["rig", "camera", "coefficients"], [1.0], "takes (4, 5) coefficients"),
        (["rig", "camera", "pinhole", "width_px"], 0, "width_px: 0 is less than"),
        (["counts", "dropped", "x"], -1, "$.counts.dropped.x: -1 is less than"),
        (["built_at"], "2024-01-01", "'built_at' was unexpected"),
        (["host"], "ws-7", "'host' was unexpected"),
    ],
)
def test_what_cannot_be_is_refused(
    document: dict[str, Any], path: list[Any], value: object, words: str
) -> None:
    inner: Any = document
    for key in path[:-1]:
        inner = inner[key]
    inner[path[-1]] = value

    with pytest.raises(FormatError) as caught:
        manifest_from_document(document, where="manifest.json")

    assert words in caught.value.what
    assert caught.value.where == "manifest.json"


def test_bridge_toml_is_read_with_dates_and_places(tmp_path: Path) -> None:
    path = tmp_path / "bridge.toml"
    path.write_text(
        """
        name = "Park Street"
        licence = "CC-BY-4.0"
        survey_dates = [2024-06-01, "2024-06"]
        [location]
        latitude_deg = 43.45
        longitude_deg = -80.49
        [structure]
        type = "girder"
        year_built = 1968
        """
    )

    info = bridge_info_from_toml(path, "B3")

    assert (info.bridge_id, info.name, info.licence) == ("B3", "Park Street", "CC-BY-4.0")
    assert info.survey_dates == ("2024-06-01", "2024-06")
    assert info.location == Location(43.45, -80.49)
    assert info.structure is not None
    assert (info.structure.type, info.structure.year_built) == ("girder", 1968)


def test_an_empty_bridge_toml_states_no_licence(tmp_path: Path) -> None:
    (tmp_path / "bridge.toml").touch()

    assert bridge_info_from_toml(tmp_path / "bridge.toml", "B3") == BridgeInfo("B3")


@pytest.mark.parametrize(
    ("text", "words", "fix"),
    [
        ('nam = "x"', "no key 'nam'", "did you mean 'name'"),
        ('bridge_id = "B9"', "no key 'bridge_id'", "Known:"),
        ("[structure]\nyear = 1968", "no key 'year'", "did you mean 'year_built'"),
        ("name = 7", "$.name: 7 is not of type 'string'", "docs/format.md"),
        ("[location]\nlatitude_deg = 95.0\nlongitude_deg = 0", "latitude_deg: 95.0", "format.md"),
        ("name = ", "this is no TOML", "name ="),
    ],
)
def test_a_faulty_bridge_toml_is_refused(tmp_path: Path, text: str, words: str, fix: str) -> None:
    path = tmp_path / "bridge.toml"
    path.write_text(text)

    with pytest.raises(UsageError) as caught:
        bridge_info_from_toml(path, "B3")

    assert words in caught.value.what
    assert fix in caught.value.fix


def test_a_missing_bridge_toml_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="cannot be read: No such file"):
        bridge_info_from_toml(tmp_path / "bridge.toml", "B3")


def test_a_statement_of_a_contributor_stands_beside_the_description(golden: Path) -> None:
    manifest = read_manifest(golden / "bridges" / "B1" / "manifest.json")
    document = manifest_to_document(manifest)

    assert manifest.info.contribution is not None
    assert manifest.info.contribution.place_precision == "town"
    assert document["contribution"]["faces"] == "none visible"
    assert "contribution" not in document["bridge"]


@pytest.mark.parametrize("key", ["type", "material"])
def test_bridge_toml_and_manifest_know_the_same_words(key: str) -> None:
    theirs = load_schema("manifest")["properties"]["bridge"]["properties"]["structure"]
    ours = load_schema("bridge_info")["properties"]["structure"]["properties"]

    assert theirs["properties"][key]["enum"] == [*ours[key]["enum"], None]


def test_bridge_toml_and_manifest_know_the_same_statements() -> None:
    theirs = load_schema("manifest")["properties"]["contribution"]["properties"]
    ours = load_schema("bridge_info")["properties"]["contribution"]["properties"]

    assert list(theirs) == list(ours)
    for key, statement in ours.items():
        assert theirs[key].get("enum", [None])[:-1] == statement.get("enum", [])
