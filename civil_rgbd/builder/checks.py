"""Is it worth starting? Looks at the first frames before any work is done."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.builder.plan import Plan, in_words
from civil_rgbd.domain.recording import Recording
from civil_rgbd.errors import BuildError, RecordingError
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


def extrinsics_in_words(T_lidar_camera: NDArray[np.float64]) -> str:
    """Say where the camera sits and looks, seen from the LiDAR.

    Args:
        T_lidar_camera: (4, 4) camera optical frame to LiDAR frame.

    >>> T = np.array([[0., 0, 1, 0.1], [-1, 0, 0, 0], [0, -1, 0, -0.05], [0, 0, 0, 1]])
    >>> words = extrinsics_in_words(T).split(", looks along its ")
    >>> print(words[0])
    the camera sits at x 0.100, y 0.000, z -0.050 m of the LiDAR
    >>> print(words[1])
    +x (0.0 deg off), its right is -y (0.0 deg off), its down is -z (0.0 deg off)
    """
    x, y, z = T_lidar_camera[:3, 3]
    axes = [_axis_in_words(T_lidar_camera[:3, column]) for column in (2, 0, 1)]
    return (
        f"the camera sits at x {x:.3f}, y {y:.3f}, z {z:.3f} m of the LiDAR, looks along its "
        f"{axes[0]}, its right is {axes[1]}, its down is {axes[2]}"
    )


def _axis_in_words(direction: NDArray[np.float64]) -> str:
    axis = int(np.argmax(np.abs(direction)))
    sign = "+" if direction[axis] > 0 else "-"
    off_deg = math.degrees(math.acos(min(1.0, abs(float(direction[axis])))))
    return f"{sign}{'xyz'[axis]} ({off_deg:.1f} deg off)"
