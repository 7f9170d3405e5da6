"""A small dataset of two bridges with cameras of different sizes, written by the real writer."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from civil_rgbd.domain.bridge import BridgeInfo, Counts, Manifest, Software
from civil_rgbd.domain.frame import RgbdFrame
from civil_rgbd.domain.recipe import ImageStage
from civil_rgbd.format.datasets import DatasetRecord, write_dataset
from civil_rgbd.format.writer import finish_bridge, write_frame
from civil_rgbd.geometry.camera import PinholeCamera
from civil_rgbd.geometry.transforms import matrix_from_quaternion, transform_from, unit_quaternion

START_NS = 1_700_000_000_000_000_000
B1_INDICES = (3, 5, 6, 9, 12, 20)
B3_INDICES = (12, 47, 48, 50)
B3_PAUSE_NS = 60_000_000_000  # before the last frame of B3
B1_CAMERA = PinholeCamera(64, 36, 40.0, 41.0, 31.25, 17.75)
B3_CAMERA = PinholeCamera(48, 28, 30.0, 30.0, 23.5, 13.5)


def make_frame(source_index: int, camera: PinholeCamera, *, stamp_ns: int) -> RgbdFrame:
    """A frame whose pixels, depth and pose follow from its index: no two are alike."""
    rng = np.random.default_rng(source_index)
    size = (camera.height_px, camera.width_px)
    depth_m = rng.integers(1024, 30 * 1024, size).astype(np.float32) / 1024
    depth_m[rng.random(size) > 0.4] = 0.0
    rotation = matrix_from_quaternion(unit_quaternion(rng.normal(size=4)))
    return RgbdFrame(
        source_index=source_index,
        stamp_ns=stamp_ns,
        source_stamp_ns=stamp_ns - 5_000_000,
        rgb=rng.integers(0, 256, (*size, 3), dtype=np.uint8),
        depth_m=depth_m,
        camera=camera,
        T_map_camera=transform_from(rotation, rng.normal(size=3) * 1e5),
    )


def write_bridge(folder: Path, frames: Sequence[RgbdFrame]) -> None:
    """Write a whole bridge folder with lossless images."""
    partial = folder.with_name(f"{folder.name}.partial")
    partial.mkdir(parents=True)
    stage = ImageStage(codec="png")
    rows = [write_frame(partial, frame, stage=stage) for frame in frames]
    manifest = Manifest(
        info=BridgeInfo(bridge_id=folder.name),
        origin="imported",
        sources=(),
        software=Software(civil_rgbd="0.1.0", python="3.11", packages={}),
        counts=Counts(images_seen=len(rows), frames_kept=len(rows)),
    )
    finish_bridge(
        partial, folder, manifest=manifest, camera=frames[0].camera, rows=rows, replace=False
    )


def b1_frames() -> list[RgbdFrame]:
    return [make_frame(i, B1_CAMERA, stamp_ns=START_NS + i * 33_333_333) for i in B1_INDICES]


def b3_frames() -> list[RgbdFrame]:
    stamps = [START_NS + i * 33_333_333 for i in B3_INDICES]
    stamps[-1] += B3_PAUSE_NS
    return [
        make_frame(i, B3_CAMERA, stamp_ns=stamp)
        for i, stamp in zip(B3_INDICES, stamps, strict=True)
    ]


@pytest.fixture(scope="session")
def dataset_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Bridges B1 (six frames) and B3 (four), and three splits; read only."""
    folder = tmp_path_factory.mktemp("loading") / "kitchener"
    write_bridge(folder / "bridges" / "B1", b1_frames())
    write_bridge(folder / "bridges" / "B3", b3_frames())
    splits = {
        "train": {"B1": "all", "B3": ("000012", "000047")},
        "test": {"B3": ("000048", "000050")},
        "empty": {},
    }
    write_dataset(
        folder / "dataset.json",
        DatasetRecord(name="kitchener", bridges=("B1", "B3"), splits=splits),
    )
    return folder
