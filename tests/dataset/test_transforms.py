"""Crops, flips and resizes: what a pixel sees must not change."""

from __future__ import annotations

import pickle
from functools import partial
from typing import Any

import cv2
import numpy as np
import pytest
import torch

from civil_rgbd.dataset.transforms import (
    Compose,
    RandomCrop,
    RandomHorizontalFlip,
    crop,
    flip_horizontally,
    resize,
)
from civil_rgbd.errors import UsageError

WIDTH, HEIGHT = 64, 36


def sample_seeing(points_camera: np.ndarray) -> dict[str, Any]:
    """A sample whose depth holds the given points (N, 3), each drawn at its nearest pixel."""
    K = np.array([[40.0, 0.0, 30.7], [0.0, 41.0, 18.2], [0.0, 0.0, 1.0]])
    uv, _ = cv2.projectPoints(points_camera, np.zeros(3), np.zeros(3), K, None)
    u, v = np.floor(uv[:, 0].T + 0.5).astype(int)
    depth = np.zeros((HEIGHT, WIDTH), dtype=np.float32)
    depth[v, u] = points_camera[:, 2]
    image = np.zeros((3, HEIGHT, WIDTH), dtype=np.uint8)
    image[:, v, u] = 200
    return {
        "image": torch.from_numpy(image),
        "depth": torch.from_numpy(depth)[None],
        "valid": torch.from_numpy(depth > 0)[None],
        "intrinsics": torch.tensor(K, dtype=torch.float32),
        "T_map_camera": torch.eye(4, dtype=torch.float64),
        "bridge": "B3",
        "frame": "000042",
        "stamp_ns": 1_700_000_000_000_000_000,
    }


POINTS = np.array([[0.4, 0.1, 5.0], [-1.2, 0.6, 8.0], [2.0, -1.0, 6.5], [0.0, 1.2, 4.0]])


def window_of(sample: dict[str, Any], length: int) -> dict[str, Any]:
    names = ("image", "depth", "valid", "intrinsics", "T_map_camera")
    return {**sample, **{name: torch.stack([sample[name]] * length) for name in names}}


def points_seen(sample: dict[str, Any]) -> np.ndarray:
    """Valid pixels as points of the camera (N, 3), sorted by depth."""
    v, u = np.nonzero(sample["valid"][0].numpy())
    z = sample["depth"][0].numpy()[v, u].astype(np.float64)
    K = sample["intrinsics"].numpy().astype(np.float64)
    points = np.stack([(u - K[0, 2]) / K[0, 0] * z, (v - K[1, 2]) / K[1, 1] * z, z], axis=1)
    return points[np.argsort(z)]


def test_a_crop_sees_the_same_points() -> None:
    sample = sample_seeing(POINTS)

    cropped = crop(sample, left_px=5, top_px=3, width_px=50, height_px=30)

    assert cropped["image"].shape == (3, 30, 50)
    assert cropped["depth"].is_contiguous()
    np.testing.assert_allclose(points_seen(cropped), points_seen(sample), atol=1e-5)
    assert torch.equal(cropped["image"][0] > 0, cropped["valid"][0])


@pytest.mark.parametrize(
    "window",
    [
        {"left_px": -1, "top_px": 0, "width_px": 8, "height_px": 8},
        {"left_px": 0, "top_px": 0, "width_px": WIDTH + 1, "height_px": 8},
        {"left_px": 0, "top_px": 30, "width_px": 8, "height_px": 8},
        {"left_px": 0, "top_px": 0, "width_px": 0, "height_px": 8},
    ],
)
def test_a_crop_outside_the_image_is_refused(window: dict[str, int]) -> None:
    with pytest.raises(UsageError, match="does not lie in the image of 64 x 36 px"):
        crop(sample_seeing(POINTS), **window)


def test_a_flip_sees_the_mirrored_points_and_says_so() -> None:
    sample = sample_seeing(POINTS)

    flipped = flip_horizontally(sample)

    np.testing.assert_allclose(points_seen(flipped) * [-1, 1, 1], points_seen(sample), atol=1e-5)
    assert flipped["mirrored"] is True
    assert torch.equal(flipped["T_map_camera"], sample["T_map_camera"])
    assert "mirrored" not in sample


def test_flipping_twice_gives_the_sample_back() -> None:
    sample = sample_seeing(POINTS)

    again = flip_horizontally(flip_horizontally(sample))

    assert again["mirrored"] is False
    for name in ("image", "depth", "valid", "T_map_camera"):
        assert torch.equal(again[name], sample[name])
    torch.testing.assert_close(again["intrinsics"], sample["intrinsics"])


def test_halving_by_hand_gives_the_half_pixel_principal_point() -> None:
    halved = resize(sample_seeing(POINTS), width_px=32, height_px=18)

    fx, fy, cx, cy = 20.0, 20.5, (30.7 + 0.5) / 2 - 0.5, (18.2 + 0.5) / 2 - 0.5
    expected = torch.tensor([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    torch.testing.assert_close(halved["intrinsics"], expected)


def test_an_uneven_resize_has_a_factor_for_each_axis() -> None:
    wide = resize(sample_seeing(POINTS), width_px=128, height_px=30)

    K = wide["intrinsics"].numpy()
    assert K[0, 0] == pytest.approx(80.0)
    assert K[1, 1] == pytest.approx(41.0 * 30 / 36)
    assert K[0, 2] == pytest.approx(31.2 * 2 - 0.5, abs=1e-5)
    assert K[1, 2] == pytest.approx(18.7 * 30 / 36 - 0.5, abs=1e-5)


def test_doubling_keeps_every_depth_and_moves_no_point_by_more_than_half_an_old_pixel() -> None:
    sample = sample_seeing(POINTS)

    doubled = resize(sample, width_px=2 * WIDTH, height_px=2 * HEIGHT)

    assert int(doubled["valid"].sum()) == 4 * int(sample["valid"].sum())
    corners = points_seen(doubled).reshape(-1, 4, 3)  # four new pixels for each old one
    np.testing.assert_allclose(corners.mean(axis=1), points_seen(sample), atol=1e-5)


@pytest.mark.parametrize("size", [(32, 18), (50, 29), (100, 71), (1, 3), (63, 36)])
def test_depth_is_that_of_the_old_pixel_under_the_new_centre(size: tuple[int, int]) -> None:
    width, height = size
    sample = sample_seeing(POINTS)
    sample["depth"] = torch.rand(1, HEIGHT, WIDTH) + 1

    resized = resize(sample, width_px=width, height_px=height)

    for row, column in [(0, 0), (height // 2, width // 3), (height - 1, width - 1)]:
        old_row = int(np.floor((row + 0.5) * HEIGHT / height))
        old_column = int(np.floor((column + 0.5) * WIDTH / width))
        assert resized["depth"][0, row, column] == sample["depth"][0, old_row, old_column]


def test_the_image_is_resized_about_the_same_centres_as_opencv() -> None:
    ramp = np.tile(np.arange(WIDTH, dtype=np.uint8) * 3, (HEIGHT, 1))
    sample = sample_seeing(POINTS)
    sample["image"] = torch.from_numpy(np.stack([ramp] * 3))

    halved = resize(sample, width_px=32, height_px=18)["image"][0].numpy().astype(int)

    expected = cv2.resize(ramp, (32, 18), interpolation=cv2.INTER_AREA).astype(int)
    assert halved.dtype == np.int64
    assert np.abs(halved - expected)[:, 2:-2].max() <= 1


def test_a_size_without_pixels_is_refused() -> None:
    with pytest.raises(UsageError, match="the new size has no pixels: 0 x 18"):
        resize(sample_seeing(POINTS), width_px=0, height_px=18)


@pytest.mark.parametrize(
    "transform",
    [
        partial(crop, left_px=5, top_px=3, width_px=50, height_px=30),
        partial(resize, width_px=40, height_px=20),
        flip_horizontally,
    ],
)
def test_a_window_is_treated_as_its_frames_are(transform: Any) -> None:
    sample = sample_seeing(POINTS)

    window, frame = transform(window_of(sample, 3)), transform(sample)

    for name in ("image", "depth", "valid", "intrinsics", "T_map_camera"):
        assert torch.equal(window[name], torch.stack([frame[name]] * 3)), name


@pytest.mark.parametrize(
    "transform",
    [
        partial(crop, left_px=5, top_px=3, width_px=50, height_px=30),
        partial(resize, width_px=40, height_px=20),
        flip_horizontally,
    ],
)
def test_the_given_sample_is_left_as_it_was(transform: Any) -> None:
    sample = sample_seeing(POINTS)
    before = pickle.dumps(sample)

    transform(sample)

    assert pickle.dumps(sample) == before


def test_compose_applies_in_order_and_can_be_pickled() -> None:
    both = Compose(partial(crop, left_px=4, top_px=0, width_px=40, height_px=30), flip_horizontally)

    result = pickle.loads(pickle.dumps(both))(sample_seeing(POINTS))  # noqa: S301 - our own bytes

    assert result["image"].shape == (3, 30, 40)
    assert float(result["intrinsics"][0, 2]) == pytest.approx(40 - 1 - (30.7 - 4), abs=1e-5)


def test_random_crops_follow_the_seed_of_torch_and_stay_inside() -> None:
    sample, random_crop = sample_seeing(POINTS), RandomCrop(width_px=60, height_px=30)
    torch.manual_seed(3)
    first = [float(random_crop(sample)["intrinsics"][0, 2]) for _ in range(40)]
    torch.manual_seed(3)
    second = [float(random_crop(sample)["intrinsics"][0, 2]) for _ in range(40)]

    assert first == second
    assert {round(30.7 - cx) for cx in first} == {0, 1, 2, 3, 4}


def test_a_random_crop_larger_than_the_image_is_refused() -> None:
    with pytest.raises(UsageError, match="does not lie in the image"):
        RandomCrop(width_px=WIDTH + 1, height_px=8)(sample_seeing(POINTS))


def test_random_flips_mark_every_sample() -> None:
    torch.manual_seed(0)
    flips = [RandomHorizontalFlip(0.5)(sample_seeing(POINTS))["mirrored"] for _ in range(40)]

    assert set(flips) == {True, False}
    assert RandomHorizontalFlip(0.0)(sample_seeing(POINTS))["mirrored"] is False
    assert RandomHorizontalFlip(1.0)(sample_seeing(POINTS))["mirrored"] is True
