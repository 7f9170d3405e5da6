"""The hash of what frames hold."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from civil_rgbd.format.content import frames_sha256
from civil_rgbd.format.depth_exr import write_depth
from civil_rgbd.format.reader import read_bridge

from ..dataset.conftest import b3_frames, write_bridge


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_bridge(tmp_path / "B3", b3_frames())
    return tmp_path / "B3"


def hash_of(folder: Path, *frames: str, opened: bool = False) -> str:
    bridge = read_bridge(folder)
    ids = frames or tuple(row.frame_id for row in bridge.rows)
    return frames_sha256({"B3": bridge}, {"B3": ids}, opened=opened)


def test_whole_data_give_the_same_hash_opened_or_not(folder: Path, tmp_path: Path) -> None:
    shutil.copytree(folder, tmp_path / "elsewhere" / "B3")

    assert hash_of(folder) == hash_of(folder, opened=True)
    assert hash_of(tmp_path / "elsewhere" / "B3") == hash_of(folder)
    assert hash_of(folder, "000012") != hash_of(folder)


def test_a_changed_file_is_noticed_when_opened(folder: Path) -> None:
    bridge = read_bridge(folder)
    before = hash_of(folder, opened=True)
    row = bridge.rows[0]
    write_depth(folder / row.depth_path, bridge.read_depth(row) * 2)

    assert hash_of(folder, opened=True) != before
    assert hash_of(folder) == before


def test_a_missing_image_is_taken_as_the_index_says(folder: Path) -> None:
    before = hash_of(folder)
    (folder / read_bridge(folder).rows[0].rgb_path).unlink()

    assert hash_of(folder, opened=True) == before
