"""A dataset whose frames are known, written by hand: not rendered, not imported."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from civil_rgbd.domain.bridge import BridgeInfo, Counts, Manifest, Software
from civil_rgbd.domain.frame import RgbdFrame
from civil_rgbd.domain.recipe import ImageStage
from civil_rgbd.format.datasets import ALL_FRAMES, DatasetRecord, refresh_dataset, write_dataset
from civil_rgbd.format.writer import finish_bridge, write_frame
from civil_rgbd.geometry.camera import PinholeCamera

CAMERA = PinholeCamera(40, 30, 33.25, 34.5, 19.1, 14.7)
INDICES = (3, 7, 8, 21)
STAMPS = tuple(1_700_000_000_123_456_789 + 333_333_333 * index for index in INDICES)


def pose(place: int) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3] = Rotation.from_euler("zyx", [0.7 * place, -0.2, 0.4 + place]).as_matrix()
    T[:3, 3] = [1000.25 + place, -3.5, 0.1 * place]
    return T


def depth_m(place: int) -> np.ndarray:
    """1/1024 m steps from 0.6 to 60 m; the left columns empty, one pixel at 300 m."""
    rng = np.random.default_rng(place)
    depth = np.floor(rng.uniform(0.6, 60, size=(30, 40)) * 1024) / 1024
    depth[:, :5] = 0.0
    depth[2, 9] = 300.0
    return depth.astype(np.float32)


def rgb(place: int) -> np.ndarray:
    return np.random.default_rng(100 + place).integers(0, 256, (30, 40, 3)).astype(np.uint8)


def write_bridge(dataset: Path, bridge_id: str) -> None:
    partial = dataset / ".partial" / bridge_id
    rows = [
        write_frame(
            partial,
            RgbdFrame(index, stamp, stamp, rgb(place), depth_m(place), CAMERA, pose(place)),
            stage=ImageStage(codec="png"),
        )
        for place, (index, stamp) in enumerate(zip(INDICES, STAMPS, strict=True))
    ]
    share = sum(row.valid_share for row in rows) / len(rows)
    manifest = Manifest(
        info=BridgeInfo(bridge_id, licence="CC-BY-4.0", citation="Somebody 2026"),
        origin="imported",
        sources=(),
        software=Software("0", "3", {}),
        counts=Counts(images_seen=4, frames_kept=4, mean_valid_share=share),
    )
    finish_bridge(
        *(partial, dataset / "bridges" / bridge_id),
        manifest=manifest,
        camera=CAMERA,
        rows=rows,
        replace=False,
    )


@pytest.fixture(scope="session")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Bridges B1 and B3, splits train (B1 all, B3 two frames) and test (B3 one frame)."""
    folder = tmp_path_factory.mktemp("dataset")
    for bridge_id in ("B1", "B3"):
        write_bridge(folder, bridge_id)
    record = refresh_dataset(folder)
    splits = {
        "train": {"B1": ALL_FRAMES, "B3": ("000003", "000008")},
        "test": {"B3": ("000021",)},
    }
    write_dataset(folder / "dataset.json", DatasetRecord(record.name, record.bridges, splits))
    return folder
