"""From planned images to frames: what is dropped, what is read, what is blanked."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from civil_rgbd.domain.recipe import AccumulateStage, DepthStage, ImageStage, Recipe
from civil_rgbd.domain.recording import Recording
from civil_rgbd.domain.rig import Rig
from civil_rgbd.domain.scan import LidarScan
from civil_rgbd.errors import RecordingError
from civil_rgbd.geometry.camera import LensCamera, PinholeCamera
from civil_rgbd.pipeline.frames import FrameMaker, FrameOutcome, PlannedFrame

from ..recordings import MemoryRecording, standing_still, trajectory_of

SECOND = 10**9
PINHOLE = PinholeCamera(8, 6, 4.0, 4.0, 3.5, 2.5)
RIG = Rig(LensCamera(PINHOLE), np.eye(4), np.eye(4))
RECIPE = Recipe(
    "test",
    accumulate=AccumulateStage(points=10, min_fill=0.5),
    image=ImageStage(scale=1.0),
    depth=DepthStage(step_m=0.0),
)


def wall(stamp_ns: int, *, points: int = 4, z: float = 5.0) -> LidarScan:
    """Points in a row before the camera, one pixel apart."""
    xyz = np.zeros((points, 3), dtype=np.float32)
    xyz[:, 0], xyz[:, 2] = (np.arange(points) - 1.5) * z / 4, z
    return LidarScan(stamp_ns, xyz)


def recording_of(images: list[object], **other: object) -> MemoryRecording:
    """A scan of four points each second from 1 s on, an image each second from 1.5 s on."""
    return MemoryRecording(
        rig=RIG,
        trajectory=standing_still(),
        scans=[wall((1 + i) * SECOND) for i in range(4)],
        image_stamps_ns=np.array([SECOND * (2 * i + 3) // 2 for i in range(len(images))]),
        images=images,  # type: ignore[arg-type]  # arrays or None
        **other,  # type: ignore[arg-type]  # fields of one test
    )


def picture(value: int = 100) -> np.ndarray[tuple[int, int, int], np.dtype[np.uint8]]:
    return np.full((6, 8, 3), value, dtype=np.uint8)


def planned(recording: Recording) -> list[PlannedFrame]:
    return [
        PlannedFrame(index, int(stamp), int(stamp), np.eye(4))
        for index, stamp in enumerate(recording.image_stamps_ns)
    ]


def outcomes(recording: MemoryRecording, recipe: Recipe = RECIPE) -> list[FrameOutcome]:
    return list(FrameMaker(recording, recipe).make(planned(recording)))


def test_a_frame_with_too_few_points_is_dropped_and_its_image_never_read() -> None:
    recording = recording_of([picture(), picture(), picture()])

    found = outcomes(recording)  # 4, 8 and 12 points are past; 5 are needed

    assert [outcome.dropped for outcome in found] == ["too-few-points", None, None]
    assert [outcome.points for outcome in found] == [4, 8, 10]
    assert [outcome.frame is None for outcome in found] == [True, False, False]
    assert recording.images_read == {1: 1, 2: 1}


@pytest.mark.parametrize(("min_fill", "kept"), [(0.4, 3), (0.41, 2), (0.0, 3), (1.0, 1)])
def test_exactly_min_fill_is_enough(min_fill: float, kept: int) -> None:
    recipe = replace(RECIPE, accumulate=AccumulateStage(points=10, min_fill=min_fill))

    found = outcomes(recording_of([picture()] * 3), recipe)

    assert sum(outcome.frame is not None for outcome in found) == kept


def test_without_any_points_a_frame_is_empty_when_the_recipe_allows_it() -> None:
    recording = replace(recording_of([picture()]), scans=())
    recipe = replace(RECIPE, accumulate=AccumulateStage(points=10, min_fill=0.0))

    (found,) = outcomes(recording, recipe)

    assert found.frame is not None
    assert not found.frame.depth_m.any()
    assert (found.points, found.points_in_view, found.span_ns) == (0, 0, 0)


def test_an_image_that_cannot_be_decoded_is_dropped_and_the_next_one_made() -> None:
    found = outcomes(recording_of([picture(), None, picture(7)]))

    assert [outcome.dropped for outcome in found] == ["too-few-points", "image-undecodable", None]
    assert found[1].points == 8
    assert found[2].frame is not None
    assert (found[2].frame.rgb == 7).all()


def test_an_image_that_does_not_fit_the_camera_stops_the_build() -> None:
    class Other(MemoryRecording):
        def read_image(self, index: int) -> object:  # type: ignore[override]  # it never returns
            raise RecordingError("640 x 480", where=f"image {index}", fix="give --rig")

    with pytest.raises(RecordingError, match="640 x 480"):
        outcomes(Other(**vars(recording_of([picture()] * 2))))


def test_a_frame_carries_what_was_planned() -> None:
    recording = recording_of([picture()] * 3)
    T_map_camera = np.eye(4)
    T_map_camera[:3, 3] = 0.0, 0.0, 1.0
    plan = PlannedFrame(2, 3_500_000_007, 3_500_000_000, T_map_camera)

    (outcome,) = FrameMaker(recording, RECIPE).make([plan])

    frame = outcome.frame
    assert frame is not None
    assert frame.frame_id == "000002"
    assert (frame.stamp_ns, frame.source_stamp_ns) == (3_500_000_007, 3_500_000_000)
    assert frame.camera == PINHOLE
    np.testing.assert_array_equal(frame.T_map_camera, T_map_camera)
    # The camera is 1 m nearer to the wall at 5 m.
    assert set(frame.depth_m[frame.depth_m > 0].tolist()) == {4.0}
    assert (outcome.points, outcome.points_in_view) == (10, 10)
    assert outcome.span_ns == 2 * SECOND


def test_depth_is_0_where_the_picture_has_no_pixel() -> None:
    # A pincushion lens leaves the corners without a source; a wall of points fills all else.
    wide = PinholeCamera(40, 30, 15.0, 15.0, 19.5, 14.5)
    rig = replace(RIG, camera=LensCamera(wide, "plumb_bob", (0.2, 0.0, 0.0, 0.0)))
    x, y = np.meshgrid((np.arange(40) - 19.5) / 3, (np.arange(30) - 14.5) / 3)
    points = np.stack([x, y, np.full_like(x, 5.0)], axis=-1).reshape(-1, 3).astype(np.float32)
    recording = MemoryRecording(
        rig=rig,
        trajectory=standing_still(),
        scans=[LidarScan(SECOND, points)],
        image_stamps_ns=np.array([2 * SECOND]),
        images=[np.full((30, 40, 3), 100, dtype=np.uint8)],
    )
    recipe = replace(RECIPE, accumulate=AccumulateStage(points=1200))
    maker = FrameMaker(recording, recipe)

    (outcome,) = maker.make(planned(recording))

    assert outcome.frame is not None
    exists = maker.images.exists
    assert 0 < maker.images.missing_pixels < 600
    np.testing.assert_array_equal(outcome.frame.depth_m > 0, exists)
    np.testing.assert_array_equal(outcome.frame.rgb.any(axis=-1), exists)


def test_a_frame_is_the_same_in_whichever_chunk_it_is_made() -> None:
    rng = np.random.default_rng(0)
    scans = [
        LidarScan(
            SECOND + i * SECOND // 10,
            rng.uniform([-5, -4, 1], [5, 4, 20], size=(50, 3)).astype(np.float32),
            SECOND + i * SECOND // 10 + np.sort(rng.integers(0, SECOND // 10, size=50)),
        )
        for i in range(40)
    ]
    recording = replace(
        recording_of([]),
        scans=scans,
        image_stamps_ns=SECOND * 2 + np.arange(20) * (SECOND // 10),
        images=[picture()] * 20,
    )
    recipe = replace(RECIPE, accumulate=AccumulateStage(points=170))
    plan = planned(recording)

    whole = [outcome.frame for outcome in FrameMaker(recording, recipe).make(plan)]

    for index in (0, 3, 19):
        (alone,) = FrameMaker(recording, recipe).make(plan[index : index + 1])
        assert alone.frame is not None
        assert whole[index] is not None
        np.testing.assert_array_equal(alone.frame.depth_m, whole[index].depth_m)


def test_what_became_of_points_is_counted_once_a_scan() -> None:
    scan = LidarScan(SECOND, np.array([[0, 0, 0], [0, 0, 5], [0, 0, 500]], np.float32))
    recording = replace(recording_of([picture()] * 3), scans=[scan])
    maker = FrameMaker(recording, replace(RECIPE, accumulate=AccumulateStage(10, min_fill=0.0)))

    list(maker.make(planned(recording)))

    assert {
        scan: (c.read, c.no_return, c.out_of_range) for scan, c in maker.point_counts.items()
    } == {0: (3, 1, 1)}


def test_a_recording_shifted_to_utm_gives_the_same_depth_within_a_millimetre() -> None:
    utm = np.array([540000.0, 4810000.0, 330.0])
    stamps = [i * SECOND // 10 for i in range(41)]
    path = [(0.31 + 0.1 * i, 0.07 * i, -0.02 * i) for i in range(41)]
    turn = [(0.0, np.sin(0.01 * i), 0.0, np.cos(0.01 * i)) for i in range(41)]
    rng = np.random.default_rng(1)
    points = rng.uniform([-20, -10, 1], [20, 10, 60], size=(3000, 3)).astype(np.float32)
    times = np.sort(rng.integers(SECOND, 2 * SECOND, size=3000))
    depths = []
    for shift in (np.zeros(3), utm):
        trajectory = trajectory_of(stamps, [tuple(np.array(p) + shift) for p in path], turn)
        recording = replace(
            recording_of([picture()]),
            trajectory=trajectory,
            scans=[LidarScan(SECOND, points, times)],
            rig=replace(RIG, camera=LensCamera(PinholeCamera(80, 60, 40.0, 40.0, 39.5, 29.5))),
        )
        T_map_camera = np.eye(4)
        T_map_camera[:3, 3] = np.array([2.0, 1.0, -0.4]) + shift
        maker = FrameMaker(recording, replace(RECIPE, accumulate=AccumulateStage(3000)))
        depths.append(maker.render(T_map_camera, maker.windows().at(3 * SECOND))[0])

    assert (depths[0] > 0).sum() > 500
    # A point on a boundary may change its pixel; no depth that both have differs by a millimetre.
    both = (depths[0] > 0) & (depths[1] > 0)
    assert (both != ((depths[0] > 0) | (depths[1] > 0))).sum() <= 2
    off = np.abs(depths[0] - depths[1])[both]
    assert np.sort(off)[:-2].max() < 1e-3
