"""The real drive under a concrete bridge, against a slow twin that shares no code with us.

The twin reads the file with ``mcap-ros2-support``, moves points with scipy, and draws with
``np.minimum.at`` in float64.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from scipy.spatial.transform import Rotation

from civil_rgbd.cli import main
from civil_rgbd.format.reader import read_bridge

DRIVE = Path(__file__).parents[2] / "shared/data/kitti_bridge_drive/kitti_20frames.mcap"
STEP_M = 1 / 1024
pytestmark = pytest.mark.skipif(
    not DRIVE.exists(), reason="the real drive (../shared/data/kitti_bridge_drive) is not here"
)


@dataclass(frozen=True)
class Twin:
    """The drive as somebody else's library reads it."""

    stamps_ns: list[int]
    scans_map: list[np.ndarray]
    T_map_camera: list[np.ndarray]
    K: np.ndarray
    size: tuple[int, int]


def _matrix(translation: Any, rotation: Any) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3] = Rotation.from_quat([rotation.x, rotation.y, rotation.z, rotation.w]).as_matrix()
    T[:3, 3] = translation.x, translation.y, translation.z
    return T


def _decoded() -> Iterator[tuple[str, Any]]:
    with DRIVE.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for _, channel, _, ros in reader.iter_decoded_messages():
            yield channel.topic, ros


@pytest.fixture(scope="module")
def twin() -> Twin:
    clouds, stamps, poses, K, size, T_lidar_camera = [], [], [], None, None, None
    for topic, ros in _decoded():
        match topic:
            case "/velodyne_points":
                fields = np.frombuffer(ros.data, dtype="<f4").reshape(-1, ros.point_step // 4)
                clouds.append(fields[:, :3].astype(np.float64))
                stamps.append(ros.header.stamp.sec * 10**9 + ros.header.stamp.nanosec)
            case "/Odometry":
                poses.append(_matrix(ros.pose.pose.position, ros.pose.pose.orientation))
            case "/camera_left/camera_info":
                K, size = np.array(ros.p).reshape(3, 4)[:, :3], (ros.width, ros.height)
            case "/tf_static":
                transform = ros.transforms[0].transform
                T_lidar_camera = _matrix(transform.translation, transform.rotation)
    assert K is not None
    assert size is not None
    assert T_lidar_camera is not None
    return Twin(
        stamps_ns=stamps,
        scans_map=[cloud @ T[:3, :3].T + T[:3, 3] for cloud, T in zip(clouds, poses, strict=True)],
        T_map_camera=[T @ T_lidar_camera for T in poses],
        K=K,
        size=size,
    )


def _kept(twin: Twin, *, displacement_m: float) -> list[int]:
    kept: list[int] = []
    for index, T in enumerate(twin.T_map_camera):
        if not kept:
            kept.append(index)
            continue
        moved = np.linalg.norm(T[:3, 3] - twin.T_map_camera[kept[-1]][:3, 3])
        if moved > displacement_m:
            kept.append(index)
    return kept


def _scaled(twin: Twin, scale: float) -> tuple[np.ndarray, int, int]:
    width, height = (int(np.floor(side * scale + 0.5)) for side in twin.size)
    sx, sy = width / twin.size[0], height / twin.size[1]
    K = np.array(
        [
            [twin.K[0, 0] * sx, 0, (twin.K[0, 2] + 0.5) * sx - 0.5],
            [0, twin.K[1, 1] * sy, (twin.K[1, 2] + 0.5) * sy - 0.5],
            [0, 0, 1],
        ]
    )
    return K, width, height


def _drawn(
    twin: Twin, index: int, *, points: int, scale: float
) -> tuple[np.ndarray, np.ndarray, int]:
    """Depth, and the pixels that a nudge of 1e-3 px or of a float32 rounding could change."""
    past = np.concatenate([np.zeros((0, 3)), *twin.scans_map[:index]])[-points:]
    T_camera_map = np.linalg.inv(twin.T_map_camera[index])
    K, width, height = _scaled(twin, scale)
    # The ring holds float32 relative to the first pose in whole metres (here the origin).
    camera = past.astype(np.float32).astype(np.float64) @ T_camera_map[:3, :3].T
    camera += T_camera_map[:3, 3]
    camera = camera[(camera[:, 2] >= 0.5) & (camera[:, 2] <= 200.0)]
    u, v = (camera @ K.T)[:, :2].T / camera[:, 2]
    depth = np.full((height, width), np.inf)
    columns, rows = np.floor(u + 0.5).astype(int), np.floor(v + 0.5).astype(int)
    inside = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
    np.minimum.at(depth, (rows[inside], columns[inside]), camera[inside, 2])
    close = np.zeros((height, width), dtype=bool)
    for du in (-1e-3, 0, 1e-3):
        for dv in (-1e-3, 0, 1e-3):
            c, r = np.floor(u + du + 0.5).astype(int), np.floor(v + dv + 0.5).astype(int)
            moved = (
                ((c != columns) | (r != rows)) & (c >= 0) & (c < width) & (r >= 0) & (r < height)
            )
            close[r[moved], c[moved]] = True
            back = moved & inside
            close[rows[back], columns[back]] = True
    depth[np.isinf(depth)] = 0
    steps = depth / STEP_M
    close |= np.abs(steps - np.floor(steps) - 0.5) < 1e-6 / STEP_M
    return (np.floor(steps + 0.5) * STEP_M).astype(np.float32), close, int(inside.sum())


CASES = [
    pytest.param("250k", [], 0.10, 250_000, 1.0, id="250k"),
    pytest.param("250k-all", [], 0.0, 250_000, 1.0, id="250k-all"),
    pytest.param(
        "250k",
        ["select.min_displacement_m=0.5", "accumulate.min_fill=0"],
        0.5,
        250_000,
        0.0,
        id="sparser-gate-without-fill",
    ),
]


@pytest.mark.parametrize(("recipe", "settings", "displacement_m", "points", "fill"), CASES)
def test_every_pixel_equals_the_twin(
    twin: Twin,
    tmp_path: Path,
    recipe: str,
    settings: list[str],
    displacement_m: float,
    points: int,
    fill: float,
) -> None:
    arguments = ["build", "--recipe", recipe, "--bridge", "drive", "--out", str(tmp_path)]
    arguments += [word for setting in settings for word in ("--set", setting)]
    assert main([*arguments, "--workers", "1", str(DRIVE)]) == 0
    bridge = read_bridge(tmp_path / "bridges/drive")

    held = np.cumsum([0, *(len(scan) for scan in twin.scans_map)])
    expected = [
        index
        for index in _kept(twin, displacement_m=displacement_m)
        if min(held[index], points) >= fill * points
    ]
    assert [row.source_index for row in bridge.rows] == expected
    assert [row.stamp_ns for row in bridge.rows] == [twin.stamps_ns[index] for index in expected]
    for row in bridge.rows:
        drawn, close, _ = _drawn(twin, row.source_index, points=points, scale=0.6)
        different = bridge.read_depth(row) != drawn
        assert not (different & ~close).any()
        assert different.sum() <= 6


def test_250k_gives_17_frames_and_says_why_not_20(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    status = main(["build", "--out", str(tmp_path), "--bridge", "drive", "--json", str(DRIVE)])

    report = json.loads(capsys.readouterr().out)
    assert status == 0
    assert report["counts"]["frames_kept"] == 17
    assert report["counts"]["dropped"] == {"too-few-points": 3}
    assert report["notes"]["deskew"] == "unavailable"
