"""The plan: which images become frames, why the others do not, and in which chunks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from civil_rgbd.builder.plan import CHUNK_FRAMES, Plan, chunks_of, in_words, plan_frames
from civil_rgbd.domain.recipe import PosesStage, Recipe, SelectStage
from civil_rgbd.domain.rig import Rig
from civil_rgbd.errors import RecordingError
from civil_rgbd.geometry.camera import LensCamera, PinholeCamera
from civil_rgbd.geometry.trajectory import Trajectory

from ..recordings import MemoryRecording, trajectory_of

SECOND = 10**9
MS = 10**6
EVERY_IMAGE = Recipe("all", select=SelectStage(0.0))
RIG = Rig(LensCamera(PinholeCamera(4, 4, 1.0, 1.0, 0.0, 0.0)), np.eye(4), np.eye(4))


def walking(seconds: int = 10) -> Trajectory:
    """1 m/s along x, from 0 s on, a pose each 0.1 s."""
    count = seconds * 10 + 1
    return trajectory_of(
        [i * 100 * MS for i in range(count)], [(0.1 * i, 0.0, 0.0) for i in range(count)]
    )


def planned(stamps_s: list[float], recipe: Recipe = EVERY_IMAGE, **other: object) -> Plan:
    recording = MemoryRecording(
        **{"rig": RIG, "trajectory": walking(), **other},  # type: ignore[arg-type]  # of one test
        image_stamps_ns=np.array([round(stamp * 1e9) for stamp in stamps_s], dtype=np.int64),
    )
    plan = plan_frames(recording, recipe)
    assert plan.images_seen == len(stamps_s) == len(plan.frames) + sum(plan.dropped.values())
    assert not recording.images_read
    assert not recording.scans_read
    return plan


def kept(plan: Plan) -> list[int]:
    return [frame.source_index for frame in plan.frames]


def test_the_time_offset_is_added_to_the_stamp() -> None:
    plan = planned([1.0], rig=replace(RIG, camera_time_offset_s=0.25))

    (frame,) = plan.frames
    assert frame.stamp_ns == 1_250_000_000
    assert frame.source_stamp_ns == 1_000_000_000
    assert frame.T_map_camera[0, 3] == pytest.approx(1.25)


def test_an_offset_may_move_images_into_the_trajectory_and_out_of_it() -> None:
    rig = replace(RIG, camera_time_offset_s=-2.0)

    plan = planned([1.0, 2.0, 12.0, 12.001], rig=rig)

    assert kept(plan) == [1, 2]
    assert plan.dropped == {"image-outside-trajectory": 2}


def test_the_camera_sits_on_the_body_as_the_rig_says() -> None:
    T_body_camera = np.array([[0.0, 0, 1, 2], [-1, 0, 0, 3], [0, -1, 0, 4], [0, 0, 0, 1]])

    (frame,) = planned([1.0], rig=replace(RIG, T_body_camera=T_body_camera)).frames

    expected = T_body_camera.copy()
    expected[0, 3] = 3.0
    np.testing.assert_allclose(frame.T_map_camera, expected, atol=1e-12)


def test_images_outside_the_trajectory_are_counted_its_ends_are_inside() -> None:
    plan = planned([-0.000000001, 0.0, 10.0, 10.000000001])

    assert kept(plan) == [1, 2]
    assert plan.dropped == {"image-outside-trajectory": 2}


def test_images_in_a_gap_of_the_trajectory_are_counted() -> None:
    trajectory = trajectory_of([0, 250 * MS, 501 * MS, 600 * MS], [(i, 0.0, 0.0) for i in range(4)])

    plan = planned([0.1, 0.25, 0.3, 0.501, 0.55], trajectory=trajectory)
    lenient = planned(
        [0.1, 0.3], replace(EVERY_IMAGE, poses=PosesStage(0.251)), trajectory=trajectory
    )

    assert kept(plan) == [0, 1, 3, 4]
    assert plan.dropped == {"image-in-pose-gap": 1}
    assert lenient.dropped == {}


def judged(quality: list[float]) -> Trajectory:
    """Poses at 0, 0.1, 0.2 ... s with these qualities."""
    return replace(walking(), quality=np.array(quality + [1.0] * (101 - len(quality))))


def test_images_at_poses_of_low_quality_are_counted_the_worse_neighbour_decides() -> None:
    recipe = replace(EVERY_IMAGE, poses=PosesStage(min_quality=0.5))
    trajectory = judged([0.5, 0.5, 0.4, 0.9])

    plan = planned([0.05, 0.1, 0.15, 0.2, 0.25, 0.3], recipe, trajectory=trajectory)

    assert kept(plan) == [0, 1, 5]
    assert plan.dropped == {"image-pose-quality-low": 3}


def test_without_a_limit_nobody_asks_for_quality() -> None:
    assert kept(planned([0.05, 0.15], trajectory=judged([0.0, 0.0, 0.0]))) == [0, 1]
    assert kept(planned([0.05, 0.15])) == [0, 1]


def test_a_limit_on_poses_that_nobody_judged_is_refused() -> None:
    with pytest.raises(RecordingError, match=r"min_quality is 0\.5, but the poses have no") as info:
        planned([0.05], replace(EVERY_IMAGE, poses=PosesStage(min_quality=0.5)))

    assert "civil-rgbd poses" in info.value.fix


def test_images_whose_stamps_do_not_ascend_are_counted() -> None:
    plan = planned([1.0, 3.0, 3.0, 2.0, 4.0])

    assert kept(plan) == [0, 1, 4]
    assert plan.dropped == {"image-stamp-not-ascending": 2}


def test_a_stray_stamp_outside_does_not_cost_the_images_after_it() -> None:
    plan = planned([1.0, 99.0, 2.0, 3.0])

    assert kept(plan) == [0, 2, 3]
    assert plan.dropped == {"image-outside-trajectory": 1}


def test_the_gate_measures_from_the_image_kept_before() -> None:
    # 1 m/s: images every 0.06 m; more than 0.10 m needs two steps.
    plan = planned([1 + 0.06 * i for i in range(7)], Recipe("gate", select=SelectStage(0.10)))

    assert kept(plan) == [0, 2, 4, 6]
    assert plan.dropped == {"image-too-near-previous": 3}


def test_the_first_image_with_a_pose_is_kept() -> None:
    plan = planned([-1.0, 0.5, 0.55], Recipe("gate", select=SelectStage(0.10)))

    assert kept(plan) == [1]
    assert plan.dropped == {"image-outside-trajectory": 1, "image-too-near-previous": 1}


def test_the_id_of_an_image_is_the_same_under_every_recipe() -> None:
    stamps = [1 + 0.06 * i for i in range(7)]

    all_frames = {f.source_index: f.stamp_ns for f in planned(stamps).frames}
    gated = planned(stamps, Recipe("gate", select=SelectStage(0.10))).frames

    assert all(all_frames[frame.source_index] == frame.stamp_ns for frame in gated)


@pytest.mark.parametrize("stamps", [[], [99.0], [-5.0, 99.0]])
def test_a_recording_without_an_image_that_has_a_pose_is_refused(stamps: list[float]) -> None:
    with pytest.raises(RecordingError, match=f"none of the {len(stamps)} images") as caught:
        planned(stamps)
    assert caught.value.where == "memory"
    assert "time offset" in caught.value.fix


def test_counts_are_said_by_reason() -> None:
    assert in_words({"a": 2, "b": 1}) == "a 2, b 1"
    assert in_words({}) == "none"


# --- chunks -----------------------------------------------------------------------------------


@given(st.sets(st.integers(0, 700)), st.integers(1, 9))
def test_chunks_cover_what_is_to_do_exactly_once(todo: set[int], workers: int) -> None:
    ordered = sorted(todo)

    chunks = chunks_of(ordered, workers=workers)

    assert [index for chunk in chunks for index in range(chunk.first, chunk.stop)] == ordered
    assert [chunk.number for chunk in chunks] == list(range(len(chunks)))
    assert all(0 < chunk.stop - chunk.first <= CHUNK_FRAMES for chunk in chunks)


def test_every_worker_gets_two_chunks_of_a_small_job_and_a_single_one_all_of_it() -> None:
    assert len(chunks_of(list(range(40)), workers=2)) == 4
    assert len(chunks_of(list(range(40)), workers=1)) == 1
    assert len(chunks_of([5], workers=8)) == 1


def test_chunks_of_a_large_job_stay_small() -> None:
    assert len(chunks_of(list(range(12_800)), workers=2)) == 200
