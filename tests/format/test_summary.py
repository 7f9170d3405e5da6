"""What a place holds, said quickly."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from civil_rgbd.errors import FormatError
from civil_rgbd.format.summary import summarise


def test_a_dataset_is_summed_up(golden_copy: Path) -> None:
    (golden_copy / ".partial" / "B7").mkdir(parents=True)
    (golden_copy / ".partial" / ".B7.lock").touch()

    summary = summarise(golden_copy)

    (bridge,) = summary.bridges
    size_bytes = sum(p.stat().st_size for p in (golden_copy / "bridges").rglob("*") if p.is_file())
    assert (summary.dataset, summary.splits) == ("golden", ("everything", "train"))
    assert summary.unfinished == ("B7",)
    assert (bridge.frames, bridge.images_seen) == (3, 14)
    assert (bridge.width_px, bridge.height_px) == (32, 24)
    assert (bridge.recipe, bridge.changed) == ("golden", ("image.scale=0.5",))
    assert bridge.size_bytes == size_bytes
    assert bridge.coverage == pytest.approx(1 / 3)
    assert summary.to_document()["frames"] == 3


def test_one_bridge_is_summed_up(golden: Path) -> None:
    summary = summarise(golden / "bridges" / "B1")

    assert (summary.dataset, summary.splits, len(summary.bridges)) == (None, (), 1)
    assert "B1 (Golden Bridge): 3 frames of 14 images" in summary.to_text()
    assert "licence   CC-BY-4.0" in summary.to_text()


def test_a_share_of_depth_that_is_not_stated_is_said_in_words(golden_copy: Path) -> None:
    assert "32 x 24, depth in 33.3% of the pixels" in summarise(golden_copy).to_text()

    path = golden_copy / "bridges" / "B1" / "manifest.json"
    document = json.loads(path.read_text("utf-8"))
    document["counts"]["mean_valid_share"] = None
    path.write_text(json.dumps(document))

    assert (
        "32 x 24, depth on a share of pixels that the manifest does not state"
        in summarise(golden_copy).to_text()
    )


def test_a_damaged_manifest_is_named(golden_copy: Path) -> None:
    path = golden_copy / "bridges" / "B1" / "manifest.json"
    path.write_text("{")

    with pytest.raises(FormatError, match="not a whole JSON document") as caught:
        summarise(golden_copy)
    assert caught.value.where == str(path)
