"""A build that would make nothing, or nonsense, does not start."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from civil_rgbd.builder.checks import (
    FRAMES_LOOKED_AT,
    check_before_start,
    require_images_fit,
)
from civil_rgbd.builder.plan import plan_frames
from civil_rgbd.domain.recipe import AccumulateStage, ImageStage, Recipe, SelectStage
from civil_rgbd.domain.rig import Rig
from civil_rgbd.domain.scan import LidarScan
from civil_rgbd.errors import BuildError, RecordingError
from civil_rgbd.geometry.camera import LensCamera, PinholeCamera
from civil_rgbd.pipeline.frames import FrameMaker

from ..recordings import MemoryRecording, standing_still

SECOND = 10**9
CAMERA = LensCamera(PinholeCamera(40, 30, 20.0, 20.0, 19.5, 14.5))
AHEAD = Rig(CAMERA, np.eye(4), np.eye(4))
RECIPE = Recipe(
    "test",
    select=SelectStage(0.0),
    accumulate=AccumulateStage(points=1000),
    image=ImageStage(scale=1.0),
)


def recording_of(points: np.ndarray, rig: Rig = AHEAD, images: int = 30) -> MemoryRecording:
    return MemoryRecording(
        rig=rig,
        trajectory=standing_still(),
        scans=[LidarScan(SECOND // 2 + i, part) for i, part in enumerate(np.split(points, 10))],
        image_stamps_ns=SECOND + np.arange(images, dtype=np.int64) * (SECOND // 10),
    )


def before_the_camera(count: int = 1000) -> np.ndarray:
    rng = np.random.default_rng(0)
    return rng.uniform([-5, -4, 6], [5, 4, 9], size=(count, 3)).astype(np.float32)


def check(recording: MemoryRecording, recipe: Recipe = RECIPE) -> None:
    check_before_start(FrameMaker(recording, recipe), plan_frames(recording, recipe))


def test_points_in_the_image_let_a_build_start_and_no_image_is_decoded() -> None:
    recording = recording_of(before_the_camera())

    check(recording)

    assert not recording.images_read


def test_points_behind_the_camera_stop_it_with_the_extrinsics_in_words() -> None:
    T_body_camera = np.diag([-1.0, 1.0, -1.0, 1.0])
    T_body_camera[0, 3] = 0.25

    with pytest.raises(RecordingError, match="only 0 of 10000 points of the first 10 frames") as e:
        check(recording_of(before_the_camera(), Rig(CAMERA, T_body_camera, np.eye(4))))
    assert "the camera sits at x 0.250, y 0.000, z 0.000 m of the LiDAR" in e.value.what
    assert "looks along its -z (0.0 deg off)" in e.value.what
    assert "--rig" in e.value.fix


@pytest.mark.parametrize(("seen", "starts"), [(10, True), (9, False)])
def test_one_per_cent_in_view_is_enough(seen: int, *, starts: bool) -> None:
    points = before_the_camera()
    points[seen:, 2] *= -1

    if starts:
        check(recording_of(points))
    else:
        with pytest.raises(RecordingError, match="only 90 of 10000 points"):
            check(recording_of(points))


def test_it_looks_at_ten_frames_and_no_more() -> None:
    scans = [LidarScan(SECOND // 2 + i * SECOND // 10, before_the_camera(100)) for i in range(60)]
    recording = replace(recording_of(before_the_camera(), images=60), scans=scans)

    check(recording, replace(RECIPE, accumulate=AccumulateStage(points=100)))

    assert max(recording.scans_read) < 5 + FRAMES_LOOKED_AT + 1


def test_a_window_that_never_fills_says_how_full_it_got_and_which_key_decides() -> None:
    recording = recording_of(before_the_camera())
    greedy = replace(RECIPE, accumulate=AccumulateStage(points=5000, min_fill=0.5))

    with pytest.raises(
        BuildError, match="2500 are needed, the fullest of 30 windows held 1000"
    ) as e:
        check(recording, greedy)
    assert "of 1000 points that were read these do not count: none" in e.value.what
    assert "accumulate.min_fill" in e.value.fix


def test_points_outside_the_trajectory_are_named_as_the_cause() -> None:
    recording = recording_of(before_the_camera())
    early = [replace(scan, stamp_ns=-SECOND) for scan in recording.scans]

    with pytest.raises(BuildError, match=r"held 0; of 1000 .* not count: outside_trajectory 1000"):
        check(replace(recording, scans=early))


def test_without_a_minimum_even_an_empty_window_may_start() -> None:
    recording = replace(recording_of(before_the_camera()), scans=())

    check(recording, replace(RECIPE, accumulate=AccumulateStage(points=1000, min_fill=0.0)))


def test_distortion_that_stays_in_is_refused() -> None:
    barrel = LensCamera(CAMERA.pinhole, "plumb_bob", (-0.1, 0.0, 0.0, 0.0))
    recording = recording_of(before_the_camera(), replace(AHEAD, camera=barrel))

    require_images_fit(recording, undistort=True)
    require_images_fit(recording_of(before_the_camera()), undistort=False)
    with pytest.raises(BuildError, match="plumb_bob distortion") as caught:
        require_images_fit(recording, undistort=False)
    assert caught.value.fix == "set image.undistort = true"
