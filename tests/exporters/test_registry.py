"""An export is whole or absent, replaces exports only, and says what it is."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from civil_rgbd.errors import FormatError, OutputError, UsageError
from civil_rgbd.exporters.registry import EXPORTERS, export, require_exporter
from civil_rgbd.exporters.report import ExportOptions
from civil_rgbd.exporters.selection import Chosen, choose


@pytest.fixture
def chosen(dataset: Path) -> list[Chosen]:
    return choose(dataset, bridges=("B3",), split=None)[0]


@pytest.mark.parametrize("name", EXPORTERS)
def test_every_exporter_writes_and_says_what_is_lost(
    name: str, chosen: list[Chosen], tmp_path: Path
) -> None:
    report = export(chosen, name, tmp_path / "out", ExportOptions())

    said = json.loads((tmp_path / "out/export.json").read_text())
    assert said["exporter"] == name
    assert said["losses"] == report.losses
    assert said["bridges"][0]["licence"] == "CC-BY-4.0"
    assert said["bridges"][0]["citation"] == "Somebody 2026"
    assert any("no place" in loss for loss in report.losses)
    assert {path.name for path in tmp_path.iterdir()} == {"out"}


def test_what_is_there_is_replaced_only_when_asked_and_only_an_export(
    chosen: list[Chosen], tmp_path: Path
) -> None:
    out = tmp_path / "out"
    export(chosen, "tum", out, ExportOptions())
    with pytest.raises(OutputError, match="something lies here already"):
        export(chosen, "ply", out, ExportOptions())
    assert (out / "rgb.txt").is_file()

    export(chosen, "ply", out, ExportOptions(), overwrite=True)
    assert sorted(path.name for path in out.iterdir()) == ["export.json", "points.ply"]

    (out / "export.json").unlink()
    with pytest.raises(OutputError, match="this is no export"):
        export(chosen, "tum", out, ExportOptions(), overwrite=True)
    assert (out / "points.ply").is_file()


def test_a_damaged_frame_leaves_the_older_export_as_it_was(dataset: Path, tmp_path: Path) -> None:
    copy = tmp_path / "copy"
    shutil.copytree(dataset, copy)
    out = tmp_path / "out"
    whole, _ = choose(copy, bridges=("B3",), split=None)
    export(whole, "tum", out, ExportOptions())
    before = {path: path.read_bytes() for path in out.rglob("*") if path.is_file()}
    broken = copy / "bridges/B3/depth/000008.exr"
    broken.write_bytes(broken.read_bytes()[:-40])

    with pytest.raises(FormatError, match="not a whole depth image"):
        export(whole, "tum", out, ExportOptions(), overwrite=True)

    assert {path: path.read_bytes() for path in out.rglob("*") if path.is_file()} == before
    assert {path.name for path in tmp_path.iterdir()} == {"copy", "out"}


def test_a_near_miss_names_the_exporter() -> None:
    with pytest.raises(UsageError) as caught:
        require_exporter("kiti")

    assert caught.value.fix.startswith("did you mean 'kitti'?")


@pytest.mark.parametrize(
    ("bridges", "split", "said"),
    [
        (("B2",), None, "no bridge 'B2'"),
        ((), "val", "no split 'val'"),
        (("B1",), "test", "no frame"),
    ],
)
def test_a_choice_that_is_not_there_is_refused(
    bridges: tuple[str, ...], split: str | None, said: str, dataset: Path
) -> None:
    with pytest.raises(UsageError, match=said) as caught:
        choose(dataset, bridges=bridges, split=split)

    assert caught.value.where == str(dataset)


@pytest.mark.parametrize(("scale", "kept"), [(1e9, False), (1e-9, False), (1000.0, True)])
def test_a_scale_that_loses_the_depth_is_refused(
    chosen: list[Chosen], tmp_path: Path, scale: float, *, kept: bool
) -> None:
    options = ExportOptions(depth_scale=scale)
    if kept:
        assert export(chosen, "tum", tmp_path / "out", options).losses
        return
    with pytest.raises(UsageError, match="do not fit into 16 bits and would be lost") as caught:
        export(chosen, "tum", tmp_path / "out", options)
    assert "--depth-scale" in caught.value.fix
    assert list(tmp_path.iterdir()) == []
