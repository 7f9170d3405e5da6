"""The nearest point of each cell, against one point after another in numpy."""

from __future__ import annotations

import numpy as np
import pytest

from civil_rgbd.geometry.camera import PinholeCamera
from civil_rgbd.geometry.transforms import transform_from, transform_points
from civil_rgbd.health.nearest import nearest_a_cell

CAMERA = PinholeCamera(64, 35, 40.0, 42.0, 31.5, 17.0)


@pytest.mark.parametrize("cell_px", [2, 8])
def test_each_cell_holds_its_nearest_point(cell_px: int) -> None:
    rng = np.random.default_rng(5)
    points_map = rng.normal(0, 6, (4_000, 3))
    R = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])
    T_camera_map = transform_from(R, [0.3, -0.2, 4.0])

    table = nearest_a_cell(points_map, T_camera_map, CAMERA, cell_px)

    expected = np.zeros_like(table)
    for x, y, z in transform_points(T_camera_map, points_map):
        if z <= 0.5:
            continue
        u, v = 40 * x / z + 31.5, 42 * y / z + 17.0
        if 0 <= u < 64 and 0 <= v < 35:
            cell = expected[:, int(v // cell_px), int(u // cell_px)]
            if cell[2] == 0 or z < cell[2]:
                cell[:] = u, v, z
    assert table.shape == (3, 35 // cell_px + 1, 64 // cell_px + 1)
    assert (expected[2] > 0).sum() > 20
    np.testing.assert_allclose(table, expected, rtol=0, atol=1e-9)


def test_without_points_nothing_is_seen() -> None:
    assert not nearest_a_cell(np.zeros((0, 3)), np.eye(4), CAMERA, 2).any()
