"""Real sets of others: the poses carry one frame's depth onto another's within millimetres.

The check is written out here with numpy alone, beside the product's own.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from civil_rgbd.exporters.poses import transform_of
from civil_rgbd.format.reader import Bridge

Take = Any


def carried_error_m(bridge: Bridge, i: int, j: int) -> float:
    """Median of |depth of frame i carried into j - depth of j|, metres."""
    a, b = bridge.rows[i], bridge.rows[j]
    z, there = (bridge.read_depth(row).astype(float) for row in (a, b))
    K = bridge.camera.matrix
    v, u = np.nonzero(z)
    rays = np.linalg.inv(K) @ np.stack([u, v, np.ones_like(u)])
    points_a = np.vstack([rays * z[v, u], np.ones(len(u))])
    points_b = (np.linalg.inv(transform_of(b)) @ transform_of(a) @ points_a)[:3]
    points_b = points_b[:, points_b[2] > 0]
    columns, rows = np.rint((K @ points_b)[:2] / points_b[2]).astype(int)
    height, width = z.shape
    inside = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
    found = there[rows[inside], columns[inside]]
    return float(np.median(np.abs(found - points_b[2, inside])[found > 0]))


def test_exact_depth_agrees_within_millimetres(take: Take, shared_data: Path) -> None:
    bridge = take(shared_data / "icl_livingroom_o3d", "redwood")

    assert len(bridge.rows) == 40
    errors_m = [carried_error_m(bridge, i, i + step) for i in (0, 15, 25) for step in (1, 5, 14)]
    assert max(errors_m) < 0.005


@pytest.mark.parametrize("importer", ["redwood", "icl"])
def test_millimetres_are_found_in_real_depth(importer: str, take: Take, shared_data: Path) -> None:
    bridge = take(shared_data / "icl_livingroom_o3d", importer)

    assert not any("depth scale" in said for said in bridge.manifest.warnings)


def test_a_mirrored_camera_agrees_and_an_unmirrored_one_does_not(
    take: Take, shared_data: Path
) -> None:
    root = shared_data / "slambook2_rgbd/ch12/dense_RGBD/data"
    bridge = take(root, "icl")
    assert max(carried_error_m(bridge, i, i + 1) for i in (3,)) < 0.05

    upright = take(root, "icl", intrinsics="481.2,480.0,319.5,239.5", overwrite=True)

    assert carried_error_m(upright, 3, 4) > 3 * carried_error_m(bridge, 3, 4)


def test_real_frames_of_a_depth_camera_agree_within_its_noise(
    take: Take, shared_data: Path
) -> None:
    root = shared_data / "slambook2_rgbd/ch5/rgbd"

    bridge = take(root, "bridge-rgbd", intrinsics="518.0,519.0,325.5,253.5")

    assert any("depth scale 1000 instead of 256" in said for said in bridge.manifest.warnings)
    assert carried_error_m(bridge, 3, 4) < 0.05
