"""``dataset.json`` and ``defects.json``."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from civil_rgbd.errors import FormatError, OutputError
from civil_rgbd.format.atomic import folder_lock
from civil_rgbd.format.datasets import DatasetRecord, read_dataset, refresh_dataset, write_dataset
from civil_rgbd.format.defects import read_defects, write_defects

from ..data.format_v1 import make


def test_splits_come_back_as_they_were(tmp_path: Path) -> None:
    record = DatasetRecord(
        "kitchener", ("B1",), {"train": {"B1": "all"}, "few": {"B1": ("000003",)}}, "2.1"
    )

    write_dataset(tmp_path / "dataset.json", record)

    assert read_dataset(tmp_path / "dataset.json") == record


def test_refreshing_finds_bridges_and_keeps_the_splits(golden_copy: Path) -> None:
    before = read_dataset(golden_copy / "dataset.json")
    shutil.copytree(golden_copy / "bridges" / "B1", golden_copy / "bridges" / "A-2")
    (golden_copy / "bridges" / "unfinished").mkdir()

    after = refresh_dataset(golden_copy)

    assert after.bridges == ("A-2", "B1")
    assert (after.splits, after.name) == (before.splits, "golden")
    assert read_dataset(golden_copy / "dataset.json") == after


def test_refreshing_twice_writes_once(golden_copy: Path) -> None:
    path = golden_copy / "dataset.json"
    before = path.stat().st_mtime_ns

    refresh_dataset(golden_copy)

    assert path.stat().st_mtime_ns == before
    assert sorted(entry.name for entry in golden_copy.iterdir()) == ["bridges", "dataset.json"]


def test_a_dataset_is_made_where_there_is_none(golden_copy: Path) -> None:
    (golden_copy / "dataset.json").unlink()

    assert refresh_dataset(golden_copy, name="mine").name == "mine"
    assert read_dataset(golden_copy / "dataset.json").bridges == ("B1",)


def test_a_refresh_waits_for_the_lock(golden_copy: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("civil_rgbd.format.datasets._LOCK_WAIT_S", 0.0)

    with (
        folder_lock(golden_copy / ".partial"),
        pytest.raises(OutputError, match="is writing here"),
    ):
        refresh_dataset(golden_copy)


def test_ids_that_differ_in_case_only_are_refused(golden_copy: Path) -> None:
    bridges = golden_copy / "bridges"
    shutil.copytree(bridges / "B1", bridges / "b1", dirs_exist_ok=True)
    if len(list(bridges.iterdir())) == 1:
        pytest.skip("this file system takes B1 and b1 for one folder")

    with pytest.raises(FormatError, match="'B1' and 'b1' differ in the case"):
        refresh_dataset(golden_copy)


def test_a_newer_dataset_is_not_written_over(golden_copy: Path) -> None:
    path = golden_copy / "dataset.json"
    document = {**json.loads(path.read_text()), "format_version": "1.1", "colour": "red"}
    path.write_text(json.dumps(document))

    with pytest.raises(FormatError, match="writing it would lose keys"):
        refresh_dataset(golden_copy)
    assert json.loads(path.read_text()) == document


def test_a_damaged_dataset_is_not_written_over(golden_copy: Path) -> None:
    (golden_copy / "dataset.json").write_text("{")

    with pytest.raises(FormatError, match="not a whole JSON document"):
        refresh_dataset(golden_copy)
    assert (golden_copy / "dataset.json").read_text() == "{"


def test_defects_come_back_as_they_were(tmp_path: Path) -> None:
    write_defects(tmp_path / "defects.json", [make.defect()])

    assert read_defects(tmp_path / "defects.json") == (make.defect(),)
    assert read_defects(tmp_path / "nothing.json") == ()


def test_a_damaged_defect_is_refused(golden_copy: Path) -> None:
    path = golden_copy / "bridges" / "B1" / "defects.json"
    path.write_text(path.read_text().replace('"polyline"', '"circle"'))

    with pytest.raises(FormatError, match=r"\$\.defects\[0\]\.outline: 'circle'"):
        read_defects(path)
