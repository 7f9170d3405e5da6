"""Is it worth starting? Looks at the first frames before any work is done."""

from __future__ import annotations

import math

from civil_rgbd.builder.plan import Plan, in_words
from civil_rgbd.domain.recording import Recording
from civil_rgbd.errors import BuildError, RecordingError
from civil_rgbd.geometry.words import extrinsics_in_words
from civil_rgbd.pipeline.frames import FrameMaker
from civil_rgbd.pipeline.prepare import total_points

FRAMES_LOOKED_AT = 10
MIN_SHARE_IN_VIEW = 0.01
"""Below this share of points in the image the extrinsics, not the scene, are the likely cause."""


def check_before_start(maker: FrameMaker, plan: Plan) -> None:
    """Refuse a build that would make nothing, or whose points miss the images.

    Args:
        maker: of the recording and recipe.
        plan: the images to make frames of.

    Raises:
        BuildError: no window ever holds enough points; says how many there were and which key
            decides it.
        RecordingError: under 1 % of the points of the first ten frames fall into the image; says
            the extrinsics in words.
    """
    needed = maker.recipe.accumulate.min_fill * maker.recipe.accumulate.points
    windows = maker.windows()
    fullest, looked_at, points, in_view = 0, 0, 0, 0
    for frame in plan.frames:
        window = windows.at(frame.stamp_ns)
        fullest = max(fullest, window.count)
        if window.count < needed:
            continue
        looked_at += 1
        points += window.count
        in_view += maker.render(frame.T_map_camera, window)[1]
        if looked_at == FRAMES_LOOKED_AT:
            break
    if not looked_at:
        _refuse_empty(maker, plan, fullest=fullest, needed=math.ceil(needed))
    if points and in_view < MIN_SHARE_IN_VIEW * points:
        raise RecordingError(
            f"only {in_view} of {points} points of the first {looked_at} frames fall into the "
            f"image: {extrinsics_in_words(maker.recording.rig.T_lidar_camera)}",
            where=maker.recording.name,
            fix="compare these words with the rig; give the right extrinsics by --rig, and check "
            "the direction: T_lidar_camera takes camera points to the LiDAR frame",
        )


def _refuse_empty(maker: FrameMaker, plan: Plan, *, fullest: int, needed: int) -> None:
    total = total_points(maker.point_counts.values())
    lost = {reason: count for reason, count in total.items() if count and reason != "read"}
    raise BuildError(
        f"no frame has enough points: {needed} are needed, the fullest of {len(plan.frames)} "
        f"windows held {fullest}; of {total['read']} points that were read these do not count: "
        f"{in_words(lost)}; images dropped before: {in_words(plan.dropped)}",
        where=maker.recording.name,
        fix="lower accumulate.points or accumulate.min_fill (--set accumulate.min_fill=0), "
        "or record for longer",
    )


def require_images_fit(recording: Recording, *, undistort: bool) -> None:
    """Refuse to store distorted images: the stored camera is a pinhole.

    Raises:
        BuildError: the recipe leaves the distortion in.
    """
    if recording.rig.camera.distorts and not undistort:
        raise BuildError(
            f"the camera has {recording.rig.camera.lens} distortion and the recipe does not take "
            "it out, but a stored camera is a pinhole",
            where="image.undistort",
            fix="set image.undistort = true",
        )
