"""A source with a LiDAR alone: camera, images and poses come from files beside it."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.conversion.beside import (
    camera_of_rig,
    images_beside,
    lens_remarks,
    require_body,
    sources_beside,
    trajectory_remarks,
)
from civil_rgbd.conversion.clocks import check_overlap
from civil_rgbd.conversion.frame_tree import FrameTree
from civil_rgbd.conversion.image_folder import ImageFolder, read_image_file
from civil_rgbd.conversion.mounting import Frames, mount
from civil_rgbd.domain.inspection import RecordingSummary, Refusal
from civil_rgbd.domain.recording import (
    CameraImage,
    Recording,
    RecordingNotes,
    RecordingOptions,
    SourceFile,
)
from civil_rgbd.domain.rig import Rig
from civil_rgbd.domain.scan import LidarScan
from civil_rgbd.errors import CivilRgbdError, ImageDecodeError, UsageError
from civil_rgbd.geometry.trajectory import Trajectory

NO_POINT_TIMES: Final = (
    "the scans have no point times: every point is moved by the pose at its scan's stamp, without "
    "de-skewing"
)
"""The warning for scans that are not de-skewed."""


class Scans(Protocol):
    """The scans of a source; can be pickled."""

    @property
    def stamps_ns(self) -> NDArray[np.int64]:
        """(S,) stamps, LiDAR clock."""

    @property
    def reach_ns(self) -> tuple[int, int]:
        """How far point stamps may lie from their scan's, inclusive."""

    def read(self, index: int) -> LidarScan:
        """Decode one scan.

        Raises:
            RecordingError: it cannot be read.
        """


@dataclass(frozen=True, slots=True, eq=False)
class LidarSource:
    """What a converter knows of a source with a LiDAR alone.

    Attributes:
        name: what the recording is called.
        scans: its scans.
        sources: its files.
        in_map: the scans are in the map frame already.
        lidar_name: the sensor, as the source says; empty when it does not.
        notes: what the source says of itself.
        where: for errors.
    """

    name: str
    scans: Scans
    sources: tuple[SourceFile, ...]
    in_map: bool
    lidar_name: str
    notes: RecordingNotes
    where: object


@dataclass(frozen=True, slots=True, eq=False)
class LidarOnlyRecording:
    """Fits :class:`civil_rgbd.domain.recording.Recording`.

    Attributes:
        name: what the recording is called.
        sources: the files behind it: scans, images, poses, time lists.
        notes: what a reader of the built bridge must know.
        rig: camera, extrinsics, time offset.
        trajectory: ``T_map_body``, LiDAR clock.
        scans: the scans.
        images: the images.
    """

    name: str
    sources: tuple[SourceFile, ...]
    notes: RecordingNotes
    rig: Rig
    trajectory: Trajectory
    scans: Scans
    images: ImageFolder

    @property
    def image_stamps_ns(self) -> NDArray[np.int64]:
        """(I,) stamps of all images, camera clock."""
        return self.images.stamps_ns

    @property
    def scan_stamps_ns(self) -> NDArray[np.int64]:
        """(S,) stamps of all scans."""
        return self.scans.stamps_ns

    @property
    def point_reach_ns(self) -> tuple[int, int]:
        """How far point stamps may lie from their scan's."""
        return self.scans.reach_ns

    def read_scan(self, index: int) -> LidarScan:
        """Decode one scan.

        Raises:
            RecordingError: it cannot be read.
        """
        return self.scans.read(index)

    def read_image(self, index: int) -> CameraImage:
        """Decode one image.

        Raises:
            ImageDecodeError: this one image cannot be decoded; others may.
            RecordingError: the images do not fit the camera.
        """
        stamp_ns = int(self.images.stamps_ns[index])
        return read_image_file(self.images.paths[index], index, stamp_ns, self.rig.camera)


def assemble_lidar_only(source: LidarSource, options: RecordingOptions) -> LidarOnlyRecording:
    """Put a recording together from a LiDAR and what lies beside it.

    Raises:
        UsageError: images, poses or what these are poses of are not given.
        RecordingError: something that a build needs is missing or contradicts itself.
    """
    rig_file, where = options.rig, source.where
    trajectory = options.trajectory
    if trajectory is None:
        raise UsageError(
            "the source holds no poses",
            where=where,
            fix="give them in a file: --trajectory poses.tum --pose-of lidar",
        )
    require_body(options, where=where)
    rectified = options.rectified or rig_file.rectified
    camera = camera_of_rig(options, rectified=rectified, where=where)
    images = images_beside(options)
    if images is None:
        raise UsageError(
            "the source holds no images",
            where=where,
            fix="give them as a folder with a time list: --images FOLDER --image-times FILE",
        )
    frame = "map" if source.in_map else "lidar"
    frames = Frames(map="map", body="", lidar=frame, camera="camera", pose_of=options.pose_of)
    mounting = mount(frames, FrameTree(), rig_file, where=where)
    recording = LidarOnlyRecording(
        name=source.name,
        sources=source.sources + sources_beside(options, images),
        notes=source.notes,
        rig=Rig(
            camera=camera,
            T_body_camera=mounting.T_body_camera,
            T_body_lidar=mounting.T_body_lidar,
            camera_time_offset_s=rig_file.camera_time_offset_s or 0.0,
            body=frames.body_name,
            lidar_name=rig_file.lidar_name or source.lidar_name or "unknown",
            camera_name=rig_file.camera_name or "unknown",
        ),
        trajectory=trajectory,
        scans=source.scans,
        images=images,
    )
    check_overlap(
        images_ns=recording.image_stamps_ns + recording.rig.camera_time_offset_ns,
        scans_ns=recording.scan_stamps_ns,
        reach_ns=recording.point_reach_ns,
        poses_ns=trajectory.stamps_ns,
        where=where,
    )
    with suppress(ImageDecodeError):  # one damaged image is the build's to count
        recording.read_image(0)  # a wrong camera or codec shows now, not after an hour
    return replace(recording, notes=_notes(recording, source, options))


def tried(summary: RecordingSummary, open_it: Callable[[], Recording]) -> RecordingSummary:
    """Add to a summary whether a build could open the source.

    Args:
        summary: what the source holds.
        open_it: opens it as a build would.
    """
    try:
        recording = open_it()
    except CivilRgbdError as error:
        return replace(summary, refusal=Refusal(error.what, error.where, error.fix))
    return replace(
        summary,
        T_lidar_camera=recording.rig.T_lidar_camera,
        warnings=recording.notes.warnings,
    )


def _notes(
    recording: LidarOnlyRecording, source: LidarSource, options: RecordingOptions
) -> RecordingNotes:
    notes, counts = source.notes, dict(source.notes.counts)
    if recording.images.without_stamp:
        counts["image-file-without-stamp"] = recording.images.without_stamp
    rectified = options.rectified or options.rig.rectified
    reading = {
        "image_topic": "files",
        "camera_info_topic": "rig",
        "pose_topic": "file",
        "pose_of": recording.rig.body,
        "rectified": "yes" if rectified else "no",
        "registered": "yes" if source.in_map else "no",
    }
    return replace(
        notes,
        reading=notes.reading | reading,
        map_up=options.rig.map_up,
        warnings=notes.warnings
        + lens_remarks(options, rectified=rectified)
        + trajectory_remarks(recording.rig, options, recording.scans.stamps_ns),
        counts=counts,
    )
