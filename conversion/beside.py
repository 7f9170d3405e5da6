"""What lies beside a recording: poses, images and a camera from files of their own."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.conversion.image_folder import ImageFolder, open_images
from civil_rgbd.domain.folders import file_source, folder_source
from civil_rgbd.domain.recording import RecordingOptions, SourceFile
from civil_rgbd.domain.rig import Rig
from civil_rgbd.errors import RecordingError, UsageError
from civil_rgbd.geometry.camera import LensCamera

_NO_TOPICS: Final = ("image_topic", "camera_info_topic", "pose_topic", "imu_topic")


def refuse_topics(options: RecordingOptions, *names: str, where: object) -> None:
    """Refuse options that choose topics: there are none.

    Args:
        options: of the user.
        names: further attributes that must not be given.
        where: the source.

    Raises:
        UsageError: one is given, or a second source: nothing is split into files like it.
    """
    if options.more_files:
        raise UsageError(
            f"{len(options.more_files) + 1} sources are given, but this one is no recording that "
            "is split into files",
            where=where,
            fix="give each a build of its own; scans in files of their own go into one folder",
        )
    for name in (*_NO_TOPICS, *names):
        if getattr(options, name) is not None:
            option = "--" + name.replace("_", "-")
            raise UsageError(
                f"{option} chooses nothing here: the source is no recording with topics",
                where=where,
                fix=f"leave {option} out; images come by --images, poses by --trajectory",
            )


def body_is_said(options: RecordingOptions) -> bool:
    """Whether ``--pose-of`` or the rig file's ``body`` says whose poses poses are."""
    return options.pose_of is not None or any("body" in pair for pair in options.rig.extrinsics)


def require_body(options: RecordingOptions, *, where: object) -> None:
    """Refuse poses from a file that nobody says whose poses they are.

    Raises:
        UsageError: neither ``--pose-of`` nor the rig file's ``body`` says it.
    """
    if not body_is_said(options):
        raise UsageError(
            "the trajectory file does not say what its poses are poses of",
            where=where,
            fix="say so with --pose-of camera, lidar or imu, or give T_body_lidar and "
            "T_body_camera in the rig file",
        )


def camera_of_rig(options: RecordingOptions, *, rectified: bool, where: object) -> LensCamera:
    """Return the camera of the rig file.

    Args:
        options: with the rig file.
        rectified: the images are rectified already: a lens would be taken out twice.
        where: the source, for errors.

    Raises:
        RecordingError: it has none.
    """
    camera = options.rig.camera
    if camera is None:
        raise RecordingError(
            "the source holds no camera model",
            where=where,
            fix="give camera and extrinsics in a rig file: --rig rig.toml",
        )
    return LensCamera(camera.pinhole) if rectified else camera


def images_beside(options: RecordingOptions) -> ImageFolder | None:
    """Return the images of a folder, where the user gives one.

    Raises:
        RecordingError: there are no images or stamps, or they do not belong to each other.
        UsageError: a time list is given without images.
    """
    if options.images is None and options.image_times is not None:
        raise UsageError(
            "--image-times gives stamps, but there are no images",
            where=options.image_times,
            fix="give their folder: --images FOLDER",
        )
    if options.images is None:
        return None
    return open_images(options.images.absolute(), options.image_times)


def sources_beside(options: RecordingOptions, images: ImageFolder | None) -> tuple[SourceFile, ...]:
    """Return the files that lie beside a source: poses, images, time lists.

    Args:
        options: with the files of the trajectory.
        images: of a folder; None when the source has its own.

    Raises:
        RecordingError: a file cannot be read.
    """
    beside = list(options.trajectory_sources)
    if images is not None:
        beside.append(folder_source(images.paths[0].parent, images.paths, "images"))
        beside.append(file_source(images.times, "times"))
    return tuple(dict.fromkeys(beside))  # one list may stamp images and poses


def trajectory_remarks(
    rig: Rig, options: RecordingOptions, scan_stamps_ns: NDArray[np.int64]
) -> tuple[str, ...]:
    """Say in words where poses from a file come from, and when they are too short.

    Args:
        rig: of the recording.
        options: with a trajectory.
        scan_stamps_ns: (S,).
    """
    trajectory = options.trajectory
    if trajectory is None:
        return ()
    origin = f"poses are taken from {options.trajectory_note}"
    remarks = [f"{origin}: poses of the {rig.body} at the instant of their own stamps"]
    inside = (scan_stamps_ns >= trajectory.start_ns) & (scan_stamps_ns <= trajectory.end_ns)
    if not inside.all():
        remarks.append(
            f"the trajectory is shorter than the scan: {int(inside.sum())} of {len(inside)} scans "
            "begin between its first and its last pose"
        )
    return tuple(remarks)


def lens_remarks(options: RecordingOptions, *, rectified: bool) -> tuple[str, ...]:
    """Say in words when a rig file's lens is not applied.

    Args:
        options: with the rig file.
        rectified: the images are rectified already.
    """
    camera = options.rig.camera
    if camera is None or not rectified or camera.lens == "none":
        return ()
    return (f"the images are rectified: the rig file's lens, {camera.lens}, is not applied",)
