"""A raw recording, whatever it came in: the contract that every converter meets."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.domain.rig import Rig, RigFile
from civil_rgbd.domain.scan import LidarScan
from civil_rgbd.geometry.trajectory import Trajectory
from civil_rgbd.storage.places import Place


@dataclass(frozen=True, slots=True)
class SourceFile:
    """One file that a recording was read from.

    Attributes:
        name: file name without folders: no path of a machine enters a manifest.
        size_bytes: its length.
        sha256: of its bytes, lower-case hex; None where nobody took it.
        converter: name of the converter that read it.
        etag: of an object on object storage, where its hash was not taken.
    """

    name: str
    size_bytes: int
    sha256: str | None
    converter: str
    etag: str | None = None


@dataclass(frozen=True, slots=True)
class RecordingOptions:
    """What a user says about a recording that the recording does not say itself.

    Attributes:
        lidar_topic: the point cloud's topic, where several fit.
        image_topic: the image's topic, where several fit.
        camera_info_topic: the CameraInfo's topic, where several fit.
        pose_topic: the topic of the poses, where several fit.
        imu_topic: the IMU's topic, where several fit; only odometry reads it.
        pose_of: ``camera``, ``lidar`` or ``imu``: the body of poses without a child frame.
        pose_offset_ns: added to the stamps of the recording's own poses to reach the LiDAR's clock.
        rig: what a rig file says; it gives or overrides camera, extrinsics and time offset.
        point_time: ``FIELD:UNIT:REFERENCE`` for unusual per-point times.
        rectified: the images are rectified already, whatever their topic's name.
        salvage: read what is readable of a damaged file.
        trajectory: poses from a file, in place of the recording's own; ``pose_of`` says of what.
        trajectory_sources: the files that ``trajectory`` was read from.
        trajectory_note: where ``trajectory`` comes from, in words, for the manifest.
        scan_times: a file with the stamps of a folder of scans; None = one inside the folder.
        scans_in: ``map`` or ``lidar``: the frame of scans that do not say it themselves.
        images: a folder of images, for a source without images of its own.
        image_times: a file with the stamps of ``images``, one a line.
        more_files: the further files of a recording that was split, in order.
        sha256: of the recording's files, in order, where somebody wrote them down; that of an
            object on object storage is believed, as taking it means reading all of it.
        source_hash: take the hashes of files that have none written down.
    """

    lidar_topic: str | None = None
    image_topic: str | None = None
    camera_info_topic: str | None = None
    pose_topic: str | None = None
    imu_topic: str | None = None
    pose_of: str | None = None
    pose_offset_ns: int = 0
    rig: RigFile = field(default_factory=RigFile)
    point_time: str | None = None
    rectified: bool = False
    salvage: bool = False
    trajectory: Trajectory | None = None
    trajectory_sources: tuple[SourceFile, ...] = ()
    trajectory_note: str = "a file"
    scan_times: Path | None = None
    scans_in: str | None = None
    images: Path | None = None
    image_times: Path | None = None
    more_files: tuple[Place, ...] = ()
    sha256: tuple[str, ...] = ()
    source_hash: bool = True


@dataclass(frozen=True, slots=True)
class RecordingNotes:
    """What a reader of the built bridge must know of the recording.

    Attributes:
        deskew: ``per_point`` (points have their own times), ``unavailable`` (they have none) or
            ``registered`` (the clouds are in the map already).
        salvage: None for a whole recording, else in words what was lost.
        reading: how the recording was read, by name, where it could have been read otherwise:
            ``lidar_topic``, ``image_topic``, ``camera_info_topic``, ``pose_topic``, ``pose_of``,
            ``point_time``, ``rectified``, ``registered`` and the like. Two openings that would give
            different frames differ here, or in rig, poses or stamps.
        simulated: the points and images come from a simulator.
        map_up: unit vector against gravity in the map frame, where it is known.
        warnings: things that are odd but not fatal, in words.
        counts: things skipped while reading, by name, for the report.
    """

    deskew: str = "per_point"
    salvage: str | None = None
    reading: dict[str, str] = field(default_factory=dict)
    simulated: bool = False
    map_up: tuple[float, float, float] | None = None
    warnings: tuple[str, ...] = ()
    counts: dict[str, int] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, eq=False)
class CameraImage:
    """One decoded image.

    Attributes:
        index: its place in the recording, from 0, in message order.
        source_stamp_ns: header stamp, camera clock, before the rig's time offset.
        rgb: (H, W, 3) uint8, as taken: distorted, full size.
    """

    index: int
    source_stamp_ns: int
    rgb: NDArray[np.uint8]


class Recording(Protocol):
    """An indexed recording: stamps are known beforehand, payloads are read when asked for.

    Message order is the order of the container's log times, ties by place in the file. An object
    that fits this can be pickled and sent to a worker; it opens its files there anew.
    """

    @property
    def name(self) -> str:
        """The file's stem, or what else names it."""

    @property
    def sources(self) -> tuple[SourceFile, ...]:
        """The files behind it, in order."""

    @property
    def notes(self) -> RecordingNotes:
        """What a reader of the built bridge must know."""

    @property
    def rig(self) -> Rig:
        """Camera, extrinsics, time offset."""

    @property
    def trajectory(self) -> Trajectory:
        """``T_map_body``, LiDAR clock."""

    @property
    def image_stamps_ns(self) -> NDArray[np.int64]:
        """(I,) header stamps of all images, camera clock, message order."""

    @property
    def scan_stamps_ns(self) -> NDArray[np.int64]:
        """(S,) header stamps of all LiDAR messages, message order."""

    @property
    def point_reach_ns(self) -> tuple[int, int]:
        """How far point stamps may lie from their header's: (earliest, latest), inclusive.

        (0, 0) without point times; (0, 10**9) for offsets that cannot be negative.
        """

    def read_scan(self, index: int) -> LidarScan:
        """Decode one LiDAR message.

        Under ``salvage`` a damaged one is a scan without points that says ``unreadable``.

        Raises:
            RecordingError: the message breaks its own layout.
        """

    def read_image(self, index: int) -> CameraImage:
        """Decode one image.

        Raises:
            ImageDecodeError: this one image cannot be decoded; others may.
            RecordingError: the images do not fit the camera.
        """


@runtime_checkable
class SmallGreys(Protocol):
    """A recording that decodes small grey images for less than whole coloured ones cost.

    No converter has to: who wants small images asks for it, and else shrinks whole ones.
    """

    def read_small_grey(self, index: int, reduction: int) -> NDArray[np.uint8]:
        """Decode one image small and grey.

        Args:
            index: of the image.
            reduction: 1, 2, 4 or 8.

        Returns:
            (H, W) uint8, as taken: distorted; height and width are divided and rounded up.

        Raises:
            ImageDecodeError: this one image cannot be decoded; others may.
            RecordingError: its codec is not read.
        """
