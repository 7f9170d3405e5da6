"""On the real drive, where depth jumps the picture has an edge: the world itself is the reference.

A mistake that every computation shared, ours and the twins', would still put the bridge's piers and
the cars beside their pictures.
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from civil_rgbd.builder.plan import plan_frames
from civil_rgbd.builder.recipes import load_recipe
from civil_rgbd.converters import open_recording
from civil_rgbd.domain.frame import RgbdFrame
from civil_rgbd.pipeline.frames import FrameMaker

DRIVE = "kitti_bridge_drive/kitti_20frames.mcap"
SHIFTS_PX = range(-12, 13)
JUMP_WITHIN_PX = 6  # two to three steps of this LiDAR across the image


@pytest.fixture(scope="module")
def frames(shared_data: Path) -> list[RgbdFrame]:
    """Every other frame at full size, each with the points of its own turn of the LiDAR."""
    settings = ["accumulate.points=100000", "accumulate.window=future", "accumulate.min_fill=0.5"]
    recipe = load_recipe("250k-all", [*settings, "image.scale=1.0"])
    recording = open_recording(shared_data / DRIVE)
    planned = plan_frames(recording, recipe).frames[::2]
    made = [outcome.frame for outcome in FrameMaker(recording, recipe).make(planned)]
    return [frame for frame in made if frame is not None]


def foreground_rims(
    depth_m: NDArray[np.float32], side: int
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Rows and columns of points whose neighbour on one side lies well behind them."""
    rows, columns = np.nonzero((depth_m > 0) & (depth_m < 30))
    behind_m = np.zeros(len(rows))
    for step in range(1, JUMP_WITHIN_PX + 1):
        at = columns + side * step
        inside = (at >= 0) & (at < depth_m.shape[1])
        there = np.where(inside, depth_m[rows, at.clip(0, depth_m.shape[1] - 1)], 0)
        behind_m = np.where(behind_m > 0, behind_m, there)
    rim = behind_m > depth_m[rows, columns] * 1.1 + 1.0
    return rows[rim], columns[rim]


def upright_edges(rgb: NDArray[np.uint8]) -> NDArray[np.float32]:
    """How strongly each pixel differs from those left and right of it, beside its surroundings."""
    grey = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY).astype(np.float32)
    steep = cv2.GaussianBlur(np.abs(cv2.Sobel(grey, cv2.CV_32F, 1, 0)), (0, 0), 1.0)
    around: NDArray[np.float32] = cv2.GaussianBlur(steep, (0, 0), 15.0)
    edges: NDArray[np.float32] = steep / (around + 10)
    return edges


def edge_strength(frames: list[RgbdFrame], side: int, *, down_px: int) -> NDArray[np.float64]:
    """Mean edge strength under the rims when the depth is moved sideways by each of the shifts."""
    strength, count = np.zeros(len(SHIFTS_PX)), 0
    for frame in frames:
        edges = upright_edges(frame.rgb)
        rows, columns = foreground_rims(frame.depth_m, side)
        height, width = edges.shape
        kept = (rows + down_px >= 0) & (rows + down_px < height)
        kept &= (columns >= max(SHIFTS_PX)) & (columns < width - max(SHIFTS_PX))
        rows, columns = rows[kept] + down_px, columns[kept]
        strength += [edges[rows, columns + shift].sum() for shift in SHIFTS_PX]
        count += len(rows)
    assert count > 200
    return strength / count


@pytest.mark.slow
def test_depth_jumps_where_the_picture_has_an_edge(frames: list[RgbdFrame]) -> None:
    left = edge_strength(frames, -1, down_px=0)
    right = edge_strength(frames, +1, down_px=0)

    best_left, best_right = SHIFTS_PX[int(left.argmax())], SHIFTS_PX[int(right.argmax())]
    # The last return lies up to 2.5 px inside the rim: the edge is further out, on either side.
    assert best_left < best_right
    # Their mean is what is left of it: calibration, and a car's way during a turn of the LiDAR.
    assert abs(best_left + best_right) / 2 <= 3
    assert min(left.max() / np.median(left), right.max() / np.median(right)) > 1.4


@pytest.mark.slow
def test_depth_moved_up_or_down_fits_less_well(frames: list[RgbdFrame]) -> None:
    by_row = {
        down_px: sum(edge_strength(frames, side, down_px=down_px).max() for side in (-1, 1))
        for down_px in range(-12, 13, 3)
    }

    assert abs(max(by_row, key=by_row.__getitem__)) <= 3
