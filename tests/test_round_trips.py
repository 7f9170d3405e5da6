"""Out and in again: what a layout keeps comes back, what it rounds comes back that near."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from civil_rgbd.cli import main
from civil_rgbd.exporters.poses import transform_of
from civil_rgbd.format.reader import Bridge, read_bridge

from .importers import sets

LAYOUTS = {"tum": ("tum", 5000.0, 13.1), "kitti": ("kitti-depth", 256.0, 255.9)}


@pytest.fixture(scope="module")
def first(tmp_path_factory: pytest.TempPathFactory) -> Bridge:
    """A bridge taken over from the lab's layout: ids from 1, depth in millimetres."""
    folder = tmp_path_factory.mktemp("first")
    source = sets.lab(folder / "B3")
    command = ["convert", str(source), "--from", "lab", "--out", str(folder / "data")]
    assert main([*command, "--licence", "CC0-1.0"]) == 0
    return read_bridge(folder / "data/bridges/B3")


@pytest.mark.parametrize("layout", LAYOUTS)
def test_a_bridge_comes_back(layout: str, first: Bridge, tmp_path: Path) -> None:
    importer, scale, furthest_m = LAYOUTS[layout]
    out, data = tmp_path / layout, tmp_path / "data"

    assert main(["export", str(first.folder), "--to", layout, "--out", str(out)]) == 0
    command = ["convert", str(out), "--from", importer, "--bridge", "B3", "--out", str(data)]
    assert main([*command, "--licence", "CC0-1.0"]) == 0
    assert main(["validate", str(data)]) == 0

    again = read_bridge(data / "bridges/B3")
    assert again.camera == first.camera
    assert again.manifest.warnings == ()
    assert [row.frame_id for row in again.rows] == [row.frame_id for row in first.rows]
    assert [row.stamp_ns for row in again.rows] == [row.stamp_ns for row in first.rows]
    for old, new in zip(first.rows, again.rows, strict=True):
        assert new.rgb_pixel_sha256 == old.rgb_pixel_sha256
        assert transform_of(new) == pytest.approx(transform_of(old), abs=1e-12)
        before, after = first.read_depth(old), again.read_depth(new)
        within = before < furthest_m
        assert np.array_equal(after[within] == 0, before[within] == 0)
        assert np.abs(after - before)[within].max() <= 0.5 / scale + 1e-6
        assert not after[before > furthest_m + 0.1].any()


def test_what_went_out_and_in_once_does_not_change_again(first: Bridge, tmp_path: Path) -> None:
    source, hashes = first.folder, []
    for turn in ("1", "2"):
        out, data = tmp_path / f"out{turn}", tmp_path / f"data{turn}"
        assert main(["export", str(source), "--to", "kitti", "--out", str(out)]) == 0
        command = ["convert", str(out), "--from", "kitti-depth", "--bridge", "B3"]
        assert main([*command, "--out", str(data)]) == 0
        source = data / "bridges/B3"
        hashes.append([row.depth_pixel_sha256 for row in read_bridge(source).rows])

    assert hashes[0] == hashes[1]
