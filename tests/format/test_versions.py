"""Files of other versions. Versions 0.x, 1.7 and 2.0 live only here."""

from __future__ import annotations

import json
import warnings
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from civil_rgbd.errors import FormatError
from civil_rgbd.format import versions
from civil_rgbd.format.index import read_index
from civil_rgbd.format.intrinsics import read_intrinsics
from civil_rgbd.format.manifest import read_manifest
from civil_rgbd.format.poses import read_poses
from civil_rgbd.format.reader import read_bridge
from civil_rgbd.format.versions import FormatVersionWarning


def change(path: Path, **changes: Any) -> None:
    path.write_text(json.dumps({**json.loads(path.read_text()), **changes}))


def test_a_newer_minor_is_read_and_one_warning_names_what_was_ignored(golden_copy: Path) -> None:
    path = golden_copy / "bridges" / "B1" / "manifest.json"
    before = read_manifest(path)
    document = json.loads(path.read_text())
    document["weather"] = {"rain": True}
    document["counts"]["birds_seen"] = 3
    document["sources"][0]["colour"] = "red"
    path.write_text(json.dumps({**document, "format_version": "1.7"}))

    with pytest.warns(FormatVersionWarning) as caught:
        after = read_manifest(path)

    assert len(caught) == 1
    words = str(caught[0].message)
    assert "format 1.7, newer than 1.0" in words
    for name in ("weather", "counts.birds_seen", "sources[].colour"):
        assert name in words
    assert after.counts == before.counts
    assert after.sources == before.sources


def test_free_names_of_a_newer_minor_are_kept(golden_copy: Path) -> None:
    path = golden_copy / "bridges" / "B1" / "manifest.json"
    document = json.loads(path.read_text())
    document["counts"]["dropped"] = {"image-too-near-previous": 10, "by-a-new-rule": 1}
    path.write_text(json.dumps({**document, "format_version": "1.1"}))

    assert read_manifest(path).counts.dropped["by-a-new-rule"] == 1


def test_a_newer_minor_in_every_frame_is_one_warning(golden_copy: Path) -> None:
    path = golden_copy / "bridges" / "B1" / "poses.json"
    document = json.loads(path.read_text())
    for frame in document["frames"]:
        frame["speed_m_per_s"] = 1.0
    path.write_text(json.dumps({**document, "format_version": "1.1"}))

    with pytest.warns(FormatVersionWarning, match=r"ignored frames\[\]\.speed_m_per_s$") as caught:
        poses = read_poses(path)

    assert len(caught) == 1
    assert len(poses.frame_ids) == 3


def test_a_newer_minor_without_new_keys_says_nothing(golden_copy: Path) -> None:
    path = golden_copy / "bridges" / "B1" / "intrinsics.json"
    change(path, format_version="1.3")

    assert read_intrinsics(path).width_px == 32


def test_an_unknown_key_of_our_own_version_is_an_error(golden_copy: Path) -> None:
    path = golden_copy / "bridges" / "B1" / "intrinsics.json"
    change(path, skew_px=0.0)

    with pytest.raises(FormatError, match="'skew_px' was unexpected"):
        read_intrinsics(path)


@pytest.mark.parametrize("name", ["manifest.json", "intrinsics.json", "poses.json"])
def test_a_newer_major_is_refused_by_name(golden_copy: Path, name: str) -> None:
    bridge = golden_copy / "bridges" / "B1"
    change(bridge / name, format_version="2.0")

    with pytest.raises(FormatError, match=r"format version 2\.0 is newer than 1\.0") as caught:
        read_bridge(bridge)

    assert caught.value.where == str(bridge / name)
    assert "pip install --upgrade" in caught.value.fix


@pytest.mark.parametrize("version", ["1", "one", None, 1.0, "1.0.0", "-1.0", "1." + "9" * 5000])
def test_what_is_no_version_is_refused(golden_copy: Path, version: Any) -> None:
    path = golden_copy / "bridges" / "B1" / "intrinsics.json"
    change(path, format_version=version)

    with pytest.raises(FormatError, match=r"not major\.minor"):
        read_intrinsics(path)


def test_an_older_major_is_migrated(golden_copy: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = golden_copy / "bridges" / "B1" / "intrinsics.json"
    expected = read_intrinsics(path)
    document = json.loads(path.read_text())
    old = {key.removesuffix("_px"): value for key, value in document.items()}
    path.write_text(json.dumps({**old, "format_version": "0.4"}))

    def from_0(document: dict[str, Any]) -> dict[str, Any]:
        names = ("width", "height", "fx", "fy", "cx", "cy")
        sizes = {f"{name}_px": document[name] for name in names}
        return {"format_version": "1.0", "model": document["model"], **sizes}

    with pytest.raises(FormatError, match=r"nothing leads from format version 0\.4 to 1\.0"):
        read_intrinsics(path)
    monkeypatch.setitem(versions.MIGRATIONS, ("intrinsics", 0), from_0)
    assert read_intrinsics(path) == expected


def rewrite(path: Path, version: str, *extra: str) -> None:
    table = pq.ParquetFile(path).read()
    for name in extra:
        table = table.append_column(name, pa.array([1.0] * len(table)))
    pq.write_table(table.replace_schema_metadata({"format_version": version}), path)


def test_the_index_follows_the_same_rules(golden_copy: Path) -> None:
    path = golden_copy / "bridges" / "B1" / "frames.parquet"
    rows = read_index(path)

    rewrite(path, "1.2", "speed_m_per_s")
    with pytest.warns(FormatVersionWarning, match="format 1.2.*ignored speed_m_per_s"):
        assert read_index(path) == rows

    rewrite(path, "1.0")
    with pytest.raises(FormatError, match="column 'speed_m_per_s' is unknown"):
        read_index(path)

    rewrite(path, "2.0")
    with pytest.raises(FormatError, match=r"format version 2\.0 is newer"):
        read_index(path)


def test_our_own_files_give_no_warning(golden: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert read_bridge(golden / "bridges" / "B1").manifest.format_version == "1.0"
