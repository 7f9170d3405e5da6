"""Pixels that see through what stands before them: found as by the slow twin, and by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from civil_rgbd.domain.frame import EMPTY
from civil_rgbd.domain.recipe import (
    CLOSING_FX_PX,
    AccumulateStage,
    DepthStage,
    ImageStage,
    QualityStage,
    Recipe,
    VisibilityStage,
)
from civil_rgbd.domain.rig import Rig
from civil_rgbd.domain.scan import LidarScan
from civil_rgbd.geometry.camera import LensCamera, PinholeCamera
from civil_rgbd.pipeline.frames import FrameMaker, FrameOutcome, PlannedFrame
from civil_rgbd.pipeline.visibility import closed_front, forget_gone, nearest_surface, remove_hidden

from ..recordings import MemoryRecording, standing_still
from ..reference.visibility import hidden, without_gone
from ..reference.zbuffer import Pinhole, zbuffer_by_minimum_at
from ..strategies import seeds

CAMERA = PinholeCamera(24, 17, 12.0, 12.0, 11.5, 8.0)
AS_TUNED = replace(CAMERA, fx_px=CLOSING_FX_PX)  # whose squares are as wide as the stage says
PLAIN = Pinhole(24, 17, 12.0, 12.0, 11.5, 8.0)
LIMITS = DepthStage(min_m=0.5, max_m=50.0, step_m=0.0)
STAGE = VisibilityStage(points=1000, closing_px=5, rim_px=1, margin_m=0.1, margin_share=0.02)
NO_POINTS: NDArray[np.float32] = np.zeros((3, 0), dtype=np.float32)


def removed(
    depth_m: NDArray[np.float32],
    others: NDArray[np.float32] = NO_POINTS,
    stage: VisibilityStage = STAGE,
) -> NDArray[np.bool_]:
    """Which pixels are emptied; the rest must stay as they are."""
    before = depth_m.copy()
    surface = nearest_surface(
        depth_m, [others], T_camera_local=np.eye(4), camera=CAMERA, limits=LIMITS
    )
    front = closed_front(surface, camera=AS_TUNED, stage=stage)
    after = depth_m.copy()
    count = remove_hidden(after, front, stage=stage)
    gone = after != before
    np.testing.assert_array_equal(depth_m, before)
    assert (after[gone] == 0).all()
    assert not np.signbit(after).any()
    assert count == gone.sum()
    return gone


def points_at(depth_m: NDArray[np.float32]) -> NDArray[np.float32]:
    """One point in the middle of each pixel that has a depth: (3, n)."""
    v, u = np.nonzero(depth_m)
    z = depth_m[v, u]
    x, y = (u - CAMERA.cx_px) * z / CAMERA.fx_px, (v - CAMERA.cy_px) * z / CAMERA.fy_px
    return np.stack([x, y, z]).astype(np.float32)


def image(value: float = 0.0) -> NDArray[np.float32]:
    return np.full((CAMERA.height_px, CAMERA.width_px), value, dtype=np.float32)


@given(
    seeds,
    st.sampled_from([1, 3, 5, 9]),
    st.sampled_from([0, 1, 3]),
    st.sampled_from([(0.1, 0.02), (0.0, 0.0), (0.5, 0.3)]),
    st.sampled_from([0.02, 0.3, 1.0]),
)
def test_it_equals_its_slow_twin_pixel_by_pixel(
    seed: int, closing_px: int, rim_px: int, margin: tuple[float, float], filled: float
) -> None:
    rng = np.random.default_rng(seed)
    stage = VisibilityStage(1, 0.0, closing_px, rim_px, 0, *margin)
    # Few depths, many ties: limits are met exactly.
    depth_m = rng.choice(np.array([2, 4, 4.5, 9, 20], dtype=np.float32), image().shape)
    depth_m[rng.random(depth_m.shape) > filled] = 0
    others = rng.uniform([-20, -20, -3], [20, 20, 60], size=(200, 3)).astype(np.float32)
    drawn = zbuffer_by_minimum_at(others, np.eye(4), PLAIN, min_m=0.5, max_m=50.0, step_m=0.0)
    both = np.stack([depth_m, drawn])
    surface = np.where(both > 0, both, np.inf).min(axis=0).astype(np.float32)

    expected = hidden(
        depth_m,
        surface,
        closing_px=closing_px,
        rim_px=rim_px,
        margin_m=margin[0],
        margin_share=margin[1],
    )

    np.testing.assert_array_equal(removed(depth_m, others.T.copy(), stage), expected)


def test_a_wall_seen_through_a_sparse_pier_is_removed_and_the_wall_beside_it_stays() -> None:
    depth_m = image(15.0)
    depth_m[:, 6:18] = 0
    depth_m[::3, 6:18:3] = 6.0  # the pier: one return in nine pixels
    depth_m[7, 10] = 15.0  # the wall, between four of them

    gone = removed(depth_m)

    assert gone.sum() == 1
    assert gone[7, 10]


@pytest.mark.parametrize(
    ("fx_px", "closing_px", "square_px"),
    [
        (636.5 * 0.6, 5, 5),  # the D455s that the stage was tuned for, at the default scale
        (638.3 * 0.6, 5, 5),
        (721.5 * 0.6, 5, 5),
        (636.5, 5, 7),
        (636.5 * 0.3, 5, 3),
        (20.0, 5, 3),  # never less: some hole is closed
        (1600.0, 5, 17),
        (636.5, 9, 15),
        (636.5, 1, 1),  # nothing is closed, at any size
    ],
)
def test_holes_are_as_many_pixels_wide_as_the_focal_length_makes_them(
    fx_px: float, closing_px: int, square_px: int
) -> None:
    camera, stage = replace(CAMERA, fx_px=fx_px), replace(STAGE, closing_px=closing_px, rim_px=0)

    def front(columns: list[int]) -> list[list[int]]:
        surface_m = np.full((61, 61), np.inf, dtype=np.float32)
        surface_m[30, columns] = 6.0
        return np.argwhere(closed_front(surface_m, camera=camera, stage=stage) == 6.0).tolist()

    near, far = 20 + square_px, 21 + square_px
    assert front([20, near]) == [[30, column] for column in range(20, near + 1)]
    assert front([20, far]) == [[30, 20], [30, far]]


def test_a_front_reaches_beyond_a_pixel_by_the_rim_at_any_focal_length() -> None:
    surface_m = np.full((41, 41), np.inf, dtype=np.float32)
    surface_m[10:31, 10:31] = 6.0
    expected = np.zeros((41, 41), dtype=np.bool_)
    expected[12:29, 12:29] = True
    for fx_px in (190.0, CLOSING_FX_PX, 640.0):
        camera = replace(CAMERA, fx_px=fx_px)

        front_m = closed_front(surface_m, camera=camera, stage=replace(STAGE, rim_px=2))

        np.testing.assert_array_equal(front_m == 6.0, expected)


def test_older_points_hide_what_the_frames_own_do_not() -> None:
    depth_m, pier = image(15.0), image()
    pier[4:13:2, 6:18:2] = 6.0

    without, with_them = removed(depth_m), removed(depth_m, points_at(pier))

    assert not without.any()
    expected = image().astype(np.bool_)
    expected[5:12, 7:16] = True  # all of the pier but its rim
    np.testing.assert_array_equal(with_them, expected)


@given(seeds, st.sampled_from([0, 1, 3, 7]), st.sampled_from([0.02, 0.3, 1.0]))
def test_what_has_gone_equals_its_slow_twin_pixel_by_pixel(
    seed: int, gone_px: int, filled: float
) -> None:
    rng = np.random.default_rng(seed)
    stage = replace(STAGE, gone_px=gone_px)
    depths = np.array([2, 4, 4.18, 4.19, 9], dtype=np.float32)  # 4.18 = 4 x 1.02 + 0.1
    depth_m, older_m = rng.choice(depths, image().shape), rng.choice(depths, image().shape)
    depth_m[rng.random(depth_m.shape) > filled] = 0
    older_m[rng.random(depth_m.shape) > 0.5] = np.inf
    surface_m = np.minimum(np.where(depth_m > 0, depth_m, np.float32(np.inf)), older_m)

    found = surface_m.copy()
    forget_gone(found, depth_m, camera=AS_TUNED, stage=stage)

    expected = without_gone(surface_m, depth_m, gone_px=gone_px, margin_m=0.1, margin_share=0.02)
    np.testing.assert_array_equal(found, expected)


def test_where_a_van_stood_is_as_many_pixels_wide_as_the_focal_length_makes_it() -> None:
    stage = replace(STAGE, gone_px=5)
    depth_m, surface_m = image(), np.full(image().shape, 6.0, dtype=np.float32)
    depth_m[8, 12] = 15.0  # the one pixel that has seen the wall behind
    for fx_px, side_px in ((CLOSING_FX_PX, 5), (CLOSING_FX_PX * 2, 9), (CLOSING_FX_PX / 2, 3)):
        found = surface_m.copy()
        forget_gone(found, depth_m, camera=replace(CAMERA, fx_px=fx_px), stage=stage)

        assert (found != 6.0).sum() == side_px**2
        assert found[8, 12] == 15.0
        assert np.isinf(found[8, 13])


def test_a_thin_railing_keeps_its_own_pixels_and_those_between_its_bars() -> None:
    depth_m = image(15.0)
    depth_m[:, ::8] = 3.0

    assert not removed(depth_m).any()


def test_what_lies_behind_by_just_the_margin_stays() -> None:
    depth_m = image(4.0)
    limit = np.float32(4.0) * 1.02 + 0.1
    depth_m[8, 8], depth_m[8, 16] = np.float32(limit - 1e-4), np.float32(limit + 1e-4)

    assert np.argwhere(removed(depth_m)).tolist() == [[8, 16]]


def test_the_limit_is_reckoned_in_float64() -> None:
    front_m = np.random.default_rng(0).uniform(1, 60, (200, 300)).astype(np.float32)
    limit_m = front_m.astype(np.float64) * 1.02 + 0.1
    depth_m = limit_m.astype(np.float32)  # beside the limit, on either side

    after = depth_m.copy()
    remove_hidden(after, front_m, stage=STAGE)

    np.testing.assert_array_equal(after == 0, depth_m.astype(np.float64) > limit_m)


def test_what_hides_is_not_rounded_to_the_step_of_the_stored_depth() -> None:
    surface = nearest_surface(
        image(9.0),
        [points_at(image(3.3))],
        T_camera_local=np.eye(4),
        camera=CAMERA,
        limits=replace(LIMITS, step_m=0.5),
    )

    np.testing.assert_allclose(surface, 3.3, rtol=1e-6)


def test_points_out_of_the_depth_range_hide_nothing() -> None:
    near = image(0.4)  # the operator's own hand

    assert not removed(image(5.0), points_at(near)).any()


# --- in frames --------------------------------------------------------------------------------

SECOND = 10**9
STILL = replace(STAGE, points=100_000)
RECIPE = Recipe(
    "test",
    accumulate=AccumulateStage(points=408, min_fill=0.5),
    image=ImageStage(scale=1.0),
    depth=DepthStage(step_m=0.0),
    visibility=STILL,
)


def recording() -> MemoryRecording:
    """A pier passes by at 1 s; from 2 s on every scan sees the wall behind it."""
    pier, wall = image(), image(15.0)
    pier[4:13, 6:18] = 6.0
    images = [np.zeros((17, 24, 3), dtype=np.uint8)] * 3
    return MemoryRecording(
        rig=Rig(LensCamera(CAMERA), np.eye(4), np.eye(4)),
        trajectory=standing_still(),
        scans=[
            LidarScan((1 + i) * SECOND, points_at(seen).T.copy())
            for i, seen in enumerate([pier, wall, wall, wall])
        ],
        image_stamps_ns=np.array([5 * SECOND // 2, 7 * SECOND // 2, 9 * SECOND // 2]),
        images=images,  # type: ignore[arg-type]  # arrays
    )


def frames(recipe: Recipe = RECIPE, first: int = 0) -> list[FrameOutcome]:
    source = recording()
    planned = [
        PlannedFrame(index, int(stamp), int(stamp), np.eye(4))
        for index, stamp in enumerate(source.image_stamps_ns)
    ]
    return list(FrameMaker(source, recipe).make(planned[first:]))


def test_a_frame_says_how_many_pixels_were_removed() -> None:
    behind_the_pier = 7 * 10

    assert [outcome.pixels_removed for outcome in frames()] == [behind_the_pier] * 3
    for outcome in frames():
        assert outcome.frame is not None
        assert (outcome.frame.depth_m == 0).sum() == behind_the_pier


def test_a_frame_is_the_same_whichever_frames_were_made_before_it() -> None:
    for first in (1, 2):
        (alone, *_), whole = frames(first=first), frames()[first]
        assert alone.frame is not None
        assert whole.frame is not None
        np.testing.assert_array_equal(alone.frame.depth_m, whole.frame.depth_m)


@pytest.mark.parametrize(
    ("changed", "hides"),
    [
        ({"max_age_s": 1.0}, [False, False, False]),
        ({"max_age_s": 2.6}, [True, True, False]),
        ({"points": 408 + 408}, [True, False, False]),
        ({"points": 408 + 408 + 108}, [True, True, False]),
    ],
)
def test_points_too_old_or_too_many_hide_nothing(
    changed: dict[str, float], hides: list[bool]
) -> None:
    stage = replace(STILL, **changed)  # type: ignore[arg-type]  # named

    found = frames(replace(RECIPE, visibility=stage))

    assert [outcome.pixels_removed > 0 for outcome in found] == hides


def test_what_every_later_point_has_seen_behind_hides_nothing() -> None:
    stage = replace(STILL, gone_px=5)

    found = frames(replace(RECIPE, visibility=stage))

    assert [outcome.pixels_removed for outcome in found] == [0, 0, 0]


def test_without_the_stage_nothing_is_removed_and_no_older_scan_is_read() -> None:
    source, plain = recording(), replace(RECIPE, visibility=None)
    plan = PlannedFrame(2, 9 * SECOND // 2, 9 * SECOND // 2, np.eye(4))
    maker = FrameMaker(source, plain)

    (outcome,) = maker.make([plan])

    assert outcome.pixels_removed == 0
    assert outcome.frame is not None
    assert (outcome.frame.depth_m == 15).all()
    assert sorted(maker.point_counts) == [3]


@pytest.mark.parametrize("window", ["past", "centred", "future"])
def test_more_points_of_the_same_window_hide_others(window: str) -> None:
    recipe = replace(RECIPE, accumulate=AccumulateStage(points=408, window=window, min_fill=0.0))
    maker = FrameMaker(recording(), recipe)
    for stamp_ns in (3 * SECOND // 2, 2 * SECOND, 5 * SECOND // 2):
        occluders = maker.occluders()
        assert occluders is not None
        inner, outer = maker.windows().at(stamp_ns), occluders.at(stamp_ns)

        rest = outer.beyond(inner)

        assert sum(part.shape[1] for part in rest) == outer.count - inner.count
        whole = np.concatenate([*inner.segments, *rest], axis=1)
        expected = np.concatenate(outer.segments, axis=1)
        assert sorted(whole.T.tolist()) == sorted(expected.T.tolist())


def test_a_frame_has_the_quality_planes_that_its_recipe_asks_for() -> None:
    plain = frames()
    recipe = replace(RECIPE, quality=QualityStage(planes=("age_s", "empty", "returns")))

    for outcome, without in zip(frames(recipe), plain, strict=True):
        assert outcome.frame is not None
        assert without.frame is not None
        assert without.frame.quality is None
        assert outcome.frame.quality is not None
        np.testing.assert_array_equal(outcome.frame.depth_m, without.frame.depth_m)
        measured = outcome.frame.depth_m > 0
        planes = outcome.frame.quality
        assert set(planes["empty"][measured]) == {EMPTY["depth"]}
        assert set(planes["empty"][~measured]) == {EMPTY["hidden"]}
        assert set(planes["age_s"][measured]) == {0.5}  # the scan was half a second before
        assert (planes["returns"] == 1).all()
