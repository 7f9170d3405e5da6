"""Quality planes from the loader: on request, and moved along with the depth."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch.utils.data import DataLoader

from civil_rgbd.dataset import BridgeDataset, BridgeSequenceDataset
from civil_rgbd.dataset.transforms import crop, flip_horizontally, resize
from civil_rgbd.dataset.warps import roll, zoom
from civil_rgbd.domain.frame import RgbdFrame
from civil_rgbd.errors import UsageError
from civil_rgbd.format.manifest import read_manifest, write_manifest

from .conftest import B1_CAMERA, B3_CAMERA, START_NS, make_frame, write_bridge


def with_planes(frame: RgbdFrame, *names: str) -> RgbdFrame:
    """Give a frame planes that follow from its depth: so one can see whether they move alike."""
    depth = frame.depth_m.astype(np.float16)
    planes = {name: depth / np.float16(2**number) for number, name in enumerate(names)}
    return dataclasses.replace(frame, quality=planes)


def written(folder: Path, *names: str, camera: Any = B1_CAMERA) -> Path:
    frames = [make_frame(i, camera, stamp_ns=START_NS + i * 10**8) for i in (3, 5, 6)]
    write_bridge(folder, [with_planes(frame, *names) if names else frame for frame in frames])
    path = folder / "manifest.json"
    said = [{"channel": name, "unit": "m", "description": "of a test"} for name in names]
    quality = {"planes": said} if names else None
    write_manifest(path, dataclasses.replace(read_manifest(path), quality=quality))
    return folder


def test_planes_come_on_request_only(tmp_path: Path) -> None:
    folder = written(tmp_path / "B1", "returns", "sigma_m")

    plain, asked = BridgeDataset(folder), BridgeDataset(folder, quality=True)

    assert "quality" not in plain[0]
    assert asked.quality_planes == ("returns", "sigma_m")
    sample = asked[0]
    assert list(sample["quality"]) == ["returns", "sigma_m"]
    for number, plane in enumerate(sample["quality"].values()):
        assert plane.dtype == torch.float32
        expected = sample["depth"].half() / 2**number
        torch.testing.assert_close(plane, expected.float(), rtol=0, atol=0)
    batch = next(iter(DataLoader(asked, batch_size=3)))
    assert batch["quality"]["sigma_m"].shape == (3, 1, 36, 64)


def test_windows_have_them_too(tmp_path: Path) -> None:
    folder = written(tmp_path / "B1", "age_s")

    window = BridgeSequenceDataset(folder, length=2, quality=True)[1]

    assert window["quality"]["age_s"].shape == (2, 1, 36, 64)
    torch.testing.assert_close(window["quality"]["age_s"], window["depth"].half().float())


def test_only_the_planes_that_all_bridges_have_are_given(tmp_path: Path) -> None:
    written(tmp_path / "set" / "bridges" / "B1", "age_s", "sigma_m")
    written(tmp_path / "set" / "bridges" / "B3", "sigma_m", "returns", camera=B3_CAMERA)

    dataset = BridgeDataset(tmp_path / "set", quality=True)

    assert dataset.quality_planes == ("sigma_m",)
    assert {tuple(dataset[place]["quality"]) for place in range(6)} == {("sigma_m",)}


def test_asking_bridges_that_have_none_is_an_error_that_says_how_to_get_some(
    tmp_path: Path,
) -> None:
    folder = written(tmp_path / "B1")

    assert BridgeDataset(folder).quality_planes == ()
    with pytest.raises(UsageError, match="no quality plane in common") as refused:
        BridgeDataset(folder, quality=True)
    assert "[quality]" in refused.value.fix


@pytest.mark.parametrize(
    "transform",
    [
        lambda sample: crop(sample, left_px=3, top_px=2, width_px=20, height_px=11),
        lambda sample: resize(sample, width_px=31, height_px=50),
        flip_horizontally,
        lambda sample: roll(sample, angle_deg=7.0),
        lambda sample: zoom(sample, factor=1.5, left_share=0.3, top_share=0.6, keep_camera=True),
    ],
    ids=["crop", "resize", "flip", "roll", "zoom"],
)
def test_planes_move_with_the_depth(tmp_path: Path, transform: Any) -> None:
    folder = written(tmp_path / "B1", "sigma_m")
    sample = BridgeDataset(folder, quality=True)[0]
    sample["quality"]["sigma_m"] = sample["depth"].clone()  # exactly

    moved = transform(sample)

    torch.testing.assert_close(moved["quality"]["sigma_m"], moved["depth"], rtol=0, atol=0)
    assert moved["depth"].shape != sample["depth"].shape or not torch.equal(
        moved["depth"], sample["depth"]
    )


def test_ages_and_counts_do_not_shrink_when_the_camera_is_kept_while_zooming(
    tmp_path: Path,
) -> None:
    folder = written(tmp_path / "B1", "age_s")
    sample = BridgeDataset(folder, quality=True)[0]
    sample["quality"]["age_s"] = sample["depth"].clone()

    moved = zoom(sample, factor=2.0, left_share=0.5, top_share=0.5, keep_camera=True)

    torch.testing.assert_close(moved["quality"]["age_s"], moved["depth"] * 2)
