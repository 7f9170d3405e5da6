"""Folders of numbered files."""

from __future__ import annotations

import hashlib
from pathlib import Path

import pytest

from civil_rgbd.domain.folders import files_in_order, folder_source
from civil_rgbd.errors import RecordingError


def test_files_come_in_numeric_order_without_hidden_ones(tmp_path: Path) -> None:
    for name in ("10.pcd", "9.PCD", "1.pcd", "._1.pcd", "notes.txt"):
        (tmp_path / name).write_bytes(b"")
    (tmp_path / "11.pcd").mkdir()
    found = [path.name for path in files_in_order(tmp_path, (".pcd",))]
    assert found == ["1.pcd", "9.PCD", "10.pcd"]


def test_names_that_differ_in_kind_can_be_ordered(tmp_path: Path) -> None:
    for name in ("a1.png", "1.png", "b.png", "01.png"):
        (tmp_path / name).write_bytes(b"")
    found = [path.name for path in files_in_order(tmp_path, (".png",))]
    assert found == ["01.png", "1.png", "a1.png", "b.png"]


def test_a_folder_that_is_none_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="the folder cannot be read"):
        files_in_order(tmp_path / "nothing", (".pcd",))


def test_a_folders_hash_is_that_of_sha256sums_lines(tmp_path: Path) -> None:
    files = [tmp_path / "1.pcd", tmp_path / "2.pcd"]
    for path in files:
        path.write_bytes(path.name.encode())
    source = folder_source(tmp_path, files, "scans")
    lines = "".join(f"{hashlib.sha256(p.read_bytes()).hexdigest()}  {p.name}\n" for p in files)
    assert source.sha256 == hashlib.sha256(lines.encode()).hexdigest()
    assert (source.name, source.size_bytes, source.converter) == (tmp_path.name, 10, "scans")
