"""One walk, built from a ROS 1 bag and from LiDAR files with images and poses beside them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from civil_rgbd.cli import main
from civil_rgbd.format.reader import Bridge, read_bridge
from civil_rgbd.simulator.recorder import write_recording
from civil_rgbd.simulator.recording import SimulatedRecording
from civil_rgbd.simulator.spec import ScanSpec

from .conversion.walk_beside import write_beside, write_scans

pytestmark = pytest.mark.slow

SPEC = ScanSpec(seconds=1.2, image_scale=0.25, image_rate_hz=5)
RECIPE = ["--recipe", "demo", "--set", "select.min_displacement_m=0.2", "--workers", "1"]
STORED_STEP_M = 1 / 1024
MORE = {
    "bag": [],
    "pcd": ["--scans-in", "lidar"],
    "ply": ["--scans-in", "lidar"],
    "las": ["--scans-in", "lidar", "--point-time", "gps_time:s:epoch"],
    "lvx": [],
}


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("walk")
    write_beside(folder, SimulatedRecording(SPEC))
    return folder


def built(walk: Path, kind: str) -> Path:
    """The bridge folder, built by the command line."""
    out = walk / f"{kind}_out"
    if kind == "bag":
        write_recording(walk / "walk.bag", SPEC, without=("poses", "extrinsics"))
        source, images = walk / "walk.bag", []
    else:
        source = write_scans(walk / kind, SimulatedRecording(SPEC), kind)
        times = ["--image-times", str(walk / "images/timestamps.txt")]
        images = ["--images", str(walk / "images"), *times]
    beside = ["--rig", str(walk / "rig.toml"), "--trajectory", str(walk / "poses.tum")]
    named = ["--bridge", "B1", "--licence", "CC0-1.0", "--out", str(out), "--pose-of", "imu"]
    command = ["build", *RECIPE, *named, *beside, *images, *MORE[kind], str(source)]
    assert main(command) == 0
    assert main(["validate", str(out)]) == 0
    return out / "bridges/B1"


@pytest.fixture(scope="module")
def expected(walk: Path) -> Path:
    return built(walk, "bag")


def contents(folder: Path) -> dict[str, bytes]:
    """Every file but the manifest, which names sources and what they lack."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file() and path.name != "manifest.json"
    }


@pytest.mark.parametrize("kind", ["pcd", "ply"])
def test_files_that_keep_every_bit_give_the_same_bytes(
    walk: Path, expected: Path, kind: str
) -> None:
    found = contents(built(walk, kind))

    assert sum(name.endswith(".exr") for name in found) == 2
    assert found == contents(expected)


@pytest.mark.parametrize(("kind", "step_m", "share"), [("las", 1e-4, 0.99), ("lvx", 1e-3, 0.96)])
def test_files_that_round_agree_to_their_own_step(
    walk: Path, expected: Path, kind: str, step_m: float, share: float
) -> None:
    one, two = read_bridge(expected), read_bridge(built(walk, kind))

    assert len(one.rows) == len(two.rows) == 2
    for a, b in zip(one.rows, two.rows, strict=True):
        assert (a.frame_id, a.stamp_ns, a.rgb_file_sha256) == (
            b.frame_id,
            b.stamp_ns,
            b.rgb_file_sha256,
        )
        assert (a.tx, a.ty, a.tz, a.qx, a.qy, a.qz, a.qw) == (
            b.tx,
            b.ty,
            b.tz,
            b.qx,
            b.qy,
            b.qz,
            b.qw,
        )
        before, after = depth_of(one, a.frame_id), depth_of(two, b.frame_id)
        both = (before > 0) & (after > 0)
        assert both.sum() > 2000
        # A point on the border of two pixels may change sides; all others keep their depth.
        assert (np.abs(before - after)[both] <= STORED_STEP_M + step_m).mean() > share
        assert ((before > 0) == (after > 0)).mean() > 0.999


def depth_of(bridge: Bridge, frame_id: str) -> np.ndarray:
    (row,) = (row for row in bridge.rows if row.frame_id == frame_id)
    return bridge.read_depth(row).astype(np.float64)


def test_the_manifest_says_where_everything_came_from(walk: Path, expected: Path) -> None:
    del walk
    sources = json.loads((expected / "manifest.json").read_text())["sources"]

    assert [source["converter"] for source in sources] == ["bag", "trajectory-tum"]
