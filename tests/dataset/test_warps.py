"""Rolls, zooms, changes of camera: a pixel's point stays where it is in the map."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import pytest
import torch

from civil_rgbd.dataset.augmentations import RandomColour, RandomRoll, RandomZoom
from civil_rgbd.dataset.transforms import flip_horizontally
from civil_rgbd.dataset.warps import roll, to_camera, zoom
from civil_rgbd.errors import UsageError

WIDTH, HEIGHT = 96, 64
K = np.array([[60.0, 0.0, 47.2], [0.0, 62.0, 30.9], [0.0, 0.0, 1.0]])
NEW_K = torch.tensor([[30.0, 0.0, 20.0], [0.0, 30.0, 18.0], [0.0, 0.0, 1.0]])


@pytest.fixture
def sample() -> dict[str, Any]:
    """A slanted plane z = 8 + 0.05 (u - cx) that is measured everywhere, and a smooth image."""
    v, u = np.mgrid[0:HEIGHT, 0:WIDTH]
    depth = (8 + 0.05 * (u - K[0, 2]) + 0.02 * (v - K[1, 2])).astype(np.float32)
    image = np.stack([u * 2, v * 3, 128 + 0 * u]).astype(np.uint8)
    T_map_camera = torch.eye(4, dtype=torch.float64)
    T_map_camera[:3, 3] = torch.tensor([3.0, -2.0, 5.0])
    return {
        "image": torch.from_numpy(image),
        "depth": torch.from_numpy(depth)[None],
        "valid": torch.ones((1, HEIGHT, WIDTH), dtype=torch.bool),
        "intrinsics": torch.tensor(K, dtype=torch.float32),
        "T_map_camera": T_map_camera,
        "bridge": "B3",
        "frame": "000042",
        "stamp_ns": 1,
    }


def points_map(sample: dict[str, Any]) -> np.ndarray:
    """(3, H, W) points of the map that the pixels see."""
    k = sample["intrinsics"].double().numpy()
    depth = sample["depth"][0].double().numpy()
    v, u = np.mgrid[0 : depth.shape[0], 0 : depth.shape[1]]
    points = np.stack([(u - k[0, 2]) / k[0, 0], (v - k[1, 2]) / k[1, 1], np.ones(u.shape)]) * depth
    if sample.get("mirrored"):
        points[0] *= -1
    T = sample["T_map_camera"].numpy()
    return np.einsum("ij,jhw->ihw", T[:3, :3], points) + T[:3, 3, None, None]


def seen_by_original(points: np.ndarray, sample: dict[str, Any]) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (2, H, W) of the original image where OpenCV projects points of the map, and Z."""
    T_camera_map = np.linalg.inv(sample["T_map_camera"].numpy())
    flat = points.reshape(3, -1).T
    rotation, _ = cv2.Rodrigues(T_camera_map[:3, :3])
    uv, _ = cv2.projectPoints(flat, rotation, T_camera_map[:3, 3], K, None)
    z = (T_camera_map[:3, :3] @ flat.T + T_camera_map[:3, 3:])[2]
    return uv[:, 0].T.reshape(2, *points.shape[1:]), z.reshape(points.shape[1:])


def assert_sees_the_same(changed: dict[str, Any], original: dict[str, Any], share: float) -> None:
    """Colours and depths of the changed sample are the original's where its points project to."""
    uv, z = seen_by_original(points_map(changed), original)
    valid = changed["valid"][0].numpy()
    inner = valid & (uv[0] > 2) & (uv[0] < WIDTH - 3) & (uv[1] > 2) & (uv[1] < HEIGHT - 3)
    assert inner.mean() > share
    plane = 8 + 0.05 * (uv[0] - K[0, 2]) + 0.02 * (uv[1] - K[1, 2])
    # Depth is of the nearest pixel, so up to half a pixel off on each axis.
    assert np.abs(z - plane)[inner].max() < 0.06
    assert np.abs((z - plane)[inner].mean()) < 0.012
    assert np.abs(changed["image"][0].numpy() - uv[0] * 2)[inner].max() < 2.5
    assert np.abs(changed["image"][1].numpy() - uv[1] * 3)[inner].max() < 2.5
    assert np.abs((changed["image"][0].numpy() - uv[0] * 2)[inner].mean()) < 0.3
    assert np.abs((changed["image"][1].numpy() - uv[1] * 3)[inner].mean()) < 0.3


@pytest.mark.parametrize("angle_deg", [0.0, 7.0, -20.0])
def test_a_rolled_camera_sees_the_same_points(sample: dict[str, Any], angle_deg: float) -> None:
    rolled = roll(sample, angle_deg=angle_deg)

    assert_sees_the_same(rolled, sample, 0.6)
    assert torch.equal(rolled["intrinsics"], sample["intrinsics"])


def test_a_positive_roll_turns_the_picture_counter_clockwise(sample: dict[str, Any]) -> None:
    sample["image"].zero_()
    sample["image"][:, 31, 47 + 30] = 255  # right of the middle
    rolled = roll(sample, angle_deg=90.0)

    row, column = np.unravel_index(int(rolled["image"][0].argmax()), (HEIGHT, WIDTH))
    assert (abs(column - 47) <= 1, row < 5) == (True, True)


def test_a_mirrored_sample_rolls_as_what_it_shows(sample: dict[str, Any]) -> None:
    rolled = roll(flip_horizontally(sample), angle_deg=9.0)

    uv, _ = seen_by_original(points_map(rolled), sample)
    valid = rolled["valid"][0].numpy()
    assert np.abs(rolled["image"][0].numpy() - uv[0] * 2)[valid].max() < 3.5


def test_parts_that_no_pixel_saw_are_black_and_not_valid(sample: dict[str, Any]) -> None:
    sample["image"].fill_(200)
    rolled = roll(sample, angle_deg=45.0)

    assert not rolled["valid"][0, 0, 0]
    assert not rolled["image"][:, 0, 0].any()
    assert (rolled["depth"][~rolled["valid"]] == 0).all()
    assert 0.4 < rolled["valid"].float().mean() < 0.95


@pytest.mark.parametrize("factor", [0.53, 1.0, 1.7])
def test_another_camera_in_the_same_place_sees_the_same_points(
    sample: dict[str, Any], factor: float
) -> None:
    new_K = torch.tensor(K, dtype=torch.float32)
    new_K[:2] *= factor
    new_K[0, 2] += 3.0
    changed = to_camera(sample, width_px=70, height_px=50, K=new_K)

    assert_sees_the_same(changed, sample, 0.3)
    assert torch.equal(changed["intrinsics"], new_K)
    assert changed["image"].shape == (3, 50, 70)


def test_the_own_camera_changes_nothing(sample: dict[str, Any]) -> None:
    same = to_camera(sample, width_px=WIDTH, height_px=HEIGHT, K=sample["intrinsics"])

    for name in ("image", "depth", "valid", "intrinsics"):
        assert torch.equal(same[name], sample[name])


def test_what_another_camera_sees_beyond_the_image_is_not_valid(sample: dict[str, Any]) -> None:
    changed = to_camera(sample, width_px=80, height_px=60, K=NEW_K)

    assert changed["valid"].float().mean() == pytest.approx(48 * 32 / (80 * 60), rel=0.2)
    assert not changed["image"][:, -1].any()


@pytest.mark.parametrize("place", [(0.0, 0.0), (1.0, 0.5)])
def test_a_zoom_with_a_longer_lens_sees_the_same_points(
    sample: dict[str, Any], place: tuple[float, float]
) -> None:
    larger = zoom(sample, factor=1.37, left_share=place[0], top_share=place[1], keep_camera=False)

    assert_sees_the_same(larger, sample, 0.6)
    assert float(larger["intrinsics"][0, 0]) == pytest.approx(82.3, abs=0.1)


def test_a_zoom_that_keeps_the_camera_brings_everything_nearer(sample: dict[str, Any]) -> None:
    longer = zoom(sample, factor=1.5, left_share=0.5, top_share=0.5, keep_camera=False)
    nearer = zoom(sample, factor=1.5, left_share=0.5, top_share=0.5, keep_camera=True)

    assert torch.equal(nearer["image"], longer["image"])
    torch.testing.assert_close(nearer["depth"], longer["depth"] / 1.5)
    torch.testing.assert_close(nearer["intrinsics"][[0, 1], [0, 1]], torch.tensor([60.0, 62.0]),
                               rtol=0.01, atol=0)  # fmt: skip


def test_a_window_is_warped_as_its_frames_are(sample: dict[str, Any]) -> None:
    window = {
        name: torch.stack([value] * 2) if isinstance(value, torch.Tensor) else value
        for name, value in sample.items()
    }
    for change in (
        lambda one: roll(one, angle_deg=5.0),
        lambda one: to_camera(one, width_px=80, height_px=60, K=NEW_K),
        lambda one: zoom(one, factor=1.3, left_share=0.2, top_share=0.9, keep_camera=True),
    ):
        for name in ("image", "depth", "valid", "intrinsics", "T_map_camera"):
            torch.testing.assert_close(change(window)[name][1], change(sample)[name])


def test_the_given_sample_stays_as_it_was(sample: dict[str, Any]) -> None:
    before = {
        name: value.clone() for name, value in sample.items() if isinstance(value, torch.Tensor)
    }
    roll(sample, angle_deg=5.0)
    to_camera(sample, width_px=80, height_px=60, K=NEW_K)
    zoom(sample, factor=1.3, left_share=0.2, top_share=0.9, keep_camera=True)

    assert all(torch.equal(sample[name], value) for name, value in before.items())


@pytest.mark.parametrize("random", [RandomRoll(5.0), RandomZoom(1.4), RandomColour(0.2, 1.0)])
def test_the_same_seed_changes_a_sample_alike(
    sample: dict[str, Any], random: RandomRoll | RandomZoom | RandomColour
) -> None:
    results = []
    for seed in (1, 1, 2):
        torch.manual_seed(seed)
        results.append(random(sample)["image"])

    assert torch.equal(results[0], results[1])
    assert not torch.equal(results[0], results[2])
    assert results[0].dtype == torch.uint8


def test_colours_change_neither_depth_nor_camera(sample: dict[str, Any]) -> None:
    changed = RandomColour(0.1, 1.0)(sample)

    assert changed["depth"] is sample["depth"]
    ratio = changed["image"][2].float() / sample["image"][2].float()
    assert 0.7 < float(ratio.mean()) < 1.3
    assert RandomColour(0.1, 0.0)(sample) is sample


def test_impossible_warps_are_refused(sample: dict[str, Any]) -> None:
    with pytest.raises(UsageError, match=r"a zoom by 0\.9 has no pixels"):
        zoom(sample, factor=0.9, left_share=0, top_share=0, keep_camera=True)
    with pytest.raises(UsageError, match="the camera has no pixels: 0 x 5"):
        to_camera(sample, width_px=0, height_px=5, K=NEW_K)
