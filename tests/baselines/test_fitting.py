"""Sizes: what a pixel sees stays where it is."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from civil_rgbd.baselines.fitting import InputFit, apply_fit, plan_fit, undo_fit
from civil_rgbd.errors import UsageError

FITS = [
    InputFit(),
    InputFit(32),
    InputFit(32, rest="crop"),
    InputFit(32, rest="resize"),
    InputFit(32, width_px=100, height_px=70),
    InputFit(32, width_px=100, height_px=70, rest="crop"),
    InputFit(16, width_px=64, height_px=32, rest="resize"),
]


def rays(height: int, width: int, K: torch.Tensor) -> torch.Tensor:
    """(1, 3, H, W): the ray of every pixel; what a camera sees of a world painted by direction."""
    v, u = torch.meshgrid(torch.arange(height), torch.arange(width), indexing="ij")
    x, y = (u - K[0, 0, 2]) / K[0, 0, 0], (v - K[0, 1, 2]) / K[0, 1, 1]
    return torch.stack([x, y, torch.ones_like(x)])[None]


@pytest.mark.parametrize("fit", FITS, ids=repr)
def test_what_the_network_sees_agrees_with_its_camera(fit: InputFit) -> None:
    K = torch.tensor([[[60.0, 0.0, 50.3], [0.0, 55.0, 40.9], [0.0, 0.0, 1.0]]])
    plan = plan_fit(fit, height_px=83, width_px=105)

    seen, moved = apply_fit(plan, rays(83, 105, K), K)

    rows, columns = (min(a, b) for a, b in zip(plan.input, plan.resized, strict=True))
    inner = (slice(None), slice(None), slice(3, rows - 3), slice(3, columns - 3))
    assert seen.shape[-2:] == plan.input
    assert all(side % fit.side_multiple == 0 for side in plan.input)
    torch.testing.assert_close(seen[inner], rays(*plan.input, moved)[inner], atol=2e-3, rtol=0)


@pytest.mark.parametrize("fit", FITS, ids=repr)
def test_the_answer_comes_back_to_its_pixels(fit: InputFit) -> None:
    K = torch.tensor([[[60.0, 0.0, 50.3], [0.0, 55.0, 40.9], [0.0, 0.0, 1.0]]])
    image = rays(83, 105, K)
    plan = plan_fit(fit, height_px=83, width_px=105)
    seen, _ = apply_fit(plan, image, K)

    back = undo_fit(plan, seen[:, :1])

    assert back.shape == (1, 1, 83, 105)
    answered = torch.isfinite(back)
    inner = torch.zeros_like(answered)
    inner[..., 4:-4, 4:-4] = True
    difference = (back - image[:, :1])[answered & inner]
    assert difference.abs().max() < 3e-3
    assert bool(answered.all()) is (fit.rest != "crop")


def test_padding_repeats_the_last_pixels() -> None:
    rgb = torch.arange(6.0).reshape(1, 1, 2, 3).repeat(1, 3, 1, 1)
    plan = plan_fit(InputFit(4), height_px=2, width_px=3)

    seen, K = apply_fit(plan, rgb, torch.eye(3)[None])

    assert seen[0, 0].tolist() == [[0, 1, 2, 2], [3, 4, 5, 5], [3, 4, 5, 5], [3, 4, 5, 5]]
    assert torch.equal(K, torch.eye(3)[None])


def test_cropping_takes_the_middle_and_leaves_the_frame_unanswered() -> None:
    rgb = torch.arange(36.0).reshape(1, 1, 6, 6)
    plan = plan_fit(InputFit(4, rest="crop"), height_px=6, width_px=6)

    seen, K = apply_fit(plan, rgb, torch.eye(3)[None])
    back = undo_fit(plan, seen)

    assert seen[0, 0, 0].tolist() == [7, 8, 9, 10]
    assert K[0, :2, 2].tolist() == [-1, -1]
    assert int(torch.isnan(back).sum()) == 36 - 16
    np.testing.assert_array_equal(back[0, 0, 1:5, 1:5], rgb[0, 0, 1:5, 1:5])


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"rest": "stretch"}, "pad, crop, resize; not 'stretch'"),
        ({"width_px": 64}, "half a size"),
        ({"width_px": 0, "height_px": 64}, "no pixels"),
    ],
)
def test_a_fit_that_cannot_be_is_refused(options: dict[str, object], words: str) -> None:
    with pytest.raises(UsageError, match=words):
        InputFit(32, **options)  # type: ignore[arg-type] # that is the point


def test_a_crop_that_leaves_nothing_names_the_size() -> None:
    with pytest.raises(UsageError, match="nothing is left of 100 x 20 px"):
        plan_fit(InputFit(32, rest="crop"), height_px=20, width_px=100)
