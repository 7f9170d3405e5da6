"""The search for the camera's turn: on a drawn picture whose depth edges are known exactly."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from civil_rgbd.geometry.camera import PinholeCamera
from civil_rgbd.health.alignment import align
from civil_rgbd.health.depth_edges import DepthEdges, edges_seen

CAMERA = PinholeCamera(640, 360, 320.0, 320.0, 319.5, 179.5)


def _boxes(rng: np.random.Generator) -> list[tuple[int, int, int, int]]:
    corners = rng.integers((40, 40), (520, 260), (9, 2))
    sizes = rng.integers(30, 90, (9, 2))
    return [(*a, *(a + b)) for a, b in zip(corners.tolist(), sizes, strict=True)]


def _drawn(turn_deg: tuple[float, float, float], pictures: int = 8) -> DepthEdges:
    """Pictures of boxes, and the boxes' outlines as a camera turned by so much states them."""
    rng = np.random.default_rng(11)
    R, _ = cv2.Rodrigues(np.radians(turn_deg))
    images, rays, upright, number = [], [], [], []
    for n in range(pictures):
        grey = np.full((360, 640), 90, np.uint8)
        pixels = []
        for left, top, right, bottom in _boxes(rng):
            grey[top:bottom, left:right] = rng.integers(140, 250)
            down, along = np.arange(top, bottom, 3.0), np.arange(left, right, 3.0)
            for u in (left - 0.5, right - 0.5):
                pixels += [(u, v, 1) for v in down]
            for v in (top - 0.5, bottom - 0.5):
                pixels += [(u, v, 0) for u in along]
        at = np.array(pixels)
        true = np.column_stack(
            [(at[:, 0] - 319.5) / 320, (at[:, 1] - 179.5) / 320, 0 * at[:, 0] + 1]
        )
        # The camera is to be turned by it: what it should see straight ahead, it now sees turned.
        stated = true @ R.T
        rays.append(stated / stated[:, 2:])
        upright.append(at[:, 2] == 1)
        number.append(np.full(len(at), n))
        images.append(cv2.GaussianBlur(grey, (0, 0), 1.0))
    return DepthEdges(
        np.concatenate(rays),
        np.concatenate(upright),
        np.concatenate(number),
        np.stack(images),
        CAMERA,
    )


@pytest.mark.parametrize("turn_deg", [(0.0, 0.0, 0.0), (1.5, 0.0, 0.0), (-0.8, 1.2, 1.0)])
def test_the_turn_is_found_about_each_axis(turn_deg: tuple[float, float, float]) -> None:
    found = align(_drawn(turn_deg))

    assert found.turn_deg is not None
    assert np.allclose(found.turn_deg, turn_deg, atol=0.15)
    assert found.sigma_deg < 0.15


def test_a_given_turn_is_worse_than_the_found_one() -> None:
    found = align(_drawn((1.5, 0.0, 0.0)))

    assert found.contrast > 1.3 * found.contrast_as_given


def test_edges_that_meet_others_do_not_win_over_what_is_known_of_the_turn() -> None:
    known = np.zeros(3), np.full(3, np.radians(0.1))

    found = align(_drawn((1.3, 0.0, 0.0)), known)

    assert found.turn_deg is None
    assert found.why_not


def test_few_edges_give_no_number() -> None:
    found = align(_drawn((0.0, 0.0, 0.0), pictures=1))

    blank = np.zeros((1, 360, 640), np.uint8)
    few = DepthEdges(*(column[:100] for column in _rows(_drawn((0.0, 0.0, 0.0)))), blank, CAMERA)

    assert align(few).turn_deg is None
    assert align(few).why_not == "only 100 depth edges are in view"
    assert found.edges > 0


def _rows(edges: DepthEdges) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return edges.rays, edges.upright, edges.picture


def test_pictures_without_those_edges_give_no_number() -> None:
    edges = _drawn((0.0, 0.0, 0.0))
    noise = np.random.default_rng(12).integers(0, 255, edges.pictures.shape).astype(np.uint8)

    found = align(DepthEdges(*_rows(edges), noise, CAMERA))

    assert found.turn_deg is None
    assert found.why_not


def test_depth_edges_lie_between_near_and_far_and_not_at_points_seen_through_gaps() -> None:
    rows, columns = np.mgrid[0:360:2, 0:640:2].reshape(2, -1).astype(float)
    depth_m = np.where(columns < 320, 4.0, 9.0)
    depth_m[(np.abs(columns - 100) < 1) & (rows % 40 == 0)] = 9.0  # single far points
    points = np.column_stack([
        (columns - 319.5) / 320 * depth_m,
        (rows - 179.5) / 320 * depth_m,
        depth_m,
    ])  # fmt: skip

    rays, upright = edges_seen(points, np.eye(4), CAMERA)
    at_px = rays[:, 0] * 320 + 319.5

    assert upright.all()
    assert len(rays) > 150
    assert np.allclose(at_px, 319.0, atol=1.1)
