"""Which folders are bridges."""

from __future__ import annotations

from pathlib import Path

import pytest

from civil_rgbd.errors import FormatError
from civil_rgbd.format.layout import bridge_folders


def test_a_dataset_and_a_bridge_are_both_taken(golden: Path) -> None:
    bridge = golden / "bridges" / "B1"

    assert bridge_folders(golden) == {"B1": bridge}
    assert bridge_folders(bridge) == {"B1": bridge}


def test_a_folder_without_manifest_is_no_bridge(golden_copy: Path) -> None:
    (golden_copy / "bridges" / "B1" / "manifest.json").unlink()

    assert bridge_folders(golden_copy) == {}
    with pytest.raises(FormatError, match=r"it has no manifest\.json"):
        bridge_folders(golden_copy / "bridges" / "B1")


def test_folders_of_an_unfinished_build_are_passed_over(golden_copy: Path) -> None:
    bridge = golden_copy / "bridges" / "B1"
    bridge.rename(bridge.with_name(".B1.replaced"))

    assert bridge_folders(golden_copy) == {}


def test_a_missing_folder_names_the_nearest_one(golden_copy: Path) -> None:
    with pytest.raises(FormatError, match="no such folder") as caught:
        bridge_folders(golden_copy.with_name("goldn"))

    assert "did you mean 'golden'?" in caught.value.fix


def test_the_folder_above_a_dataset_points_at_it(golden_copy: Path) -> None:
    with pytest.raises(FormatError, match="neither a dataset") as caught:
        bridge_folders(golden_copy.parent)

    assert caught.value.fix == f"did you mean {golden_copy}?"


def test_a_file_is_neither(golden: Path) -> None:
    with pytest.raises(FormatError, match="this is a file"):
        bridge_folders(golden / "dataset.json")
