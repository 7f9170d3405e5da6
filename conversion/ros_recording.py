"""A ROS recording, whatever container it came in: topics chosen, rig and poses put together."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.conversion.cdr import SALVAGE_FIX, CdrError, CdrReader, decoding
from civil_rgbd.conversion.gathering import MessageIndex
from civil_rgbd.conversion.image_folder import ImageFolder, read_image_file
from civil_rgbd.conversion.livox import scan_from_livox
from civil_rgbd.conversion.point_clouds import scan_from_cloud
from civil_rgbd.conversion.point_time import PointTime
from civil_rgbd.conversion.ros_images import (
    rgb_from_compressed,
    rgb_from_image,
    shrunk,
    small_grey_from_compressed,
)
from civil_rgbd.domain.recording import CameraImage, RecordingNotes, SourceFile
from civil_rgbd.domain.rig import Rig
from civil_rgbd.domain.scan import LidarScan
from civil_rgbd.errors import ImageDecodeError, RecordingError
from civil_rgbd.geometry.trajectory import Trajectory

NO_REACH: Final = (0, 0)
"""Every point has its message's stamp."""


class Payloads(Protocol):
    """Fetches single messages; can be pickled."""

    def fetch(self, chunk_start: int, offset: int, length: int) -> memoryview:
        """Return one message's payload.

        Raises:
            RecordingError: it cannot be read any more.
        """


@dataclass(frozen=True, slots=True, eq=False)
class Stream:
    """One topic's messages, ready to be decoded.

    Attributes:
        topic: its name.
        type_name: plain message type.
        index: where the messages lie.
        read: reads their encoding.
    """

    topic: str
    type_name: str
    index: MessageIndex
    read: type[CdrReader] = CdrReader


def decoded_scan(
    scans: Stream,
    payload: memoryview,
    index: int,
    *,
    point_time: PointTime | None,
    in_map: bool,
    salvage: bool,
    where: str,
) -> LidarScan:
    """Decode one LiDAR message.

    Args:
        scans: the topic.
        payload: the message.
        index: which of the topic's.
        point_time: how a PointCloud2's time field is to be read.
        in_map: its points are in the map frame already.
        salvage: return a damaged one as a scan without points that says ``unreadable``.
        where: file and topic, for errors.

    Raises:
        RecordingError: the message breaks its own layout, and is not to be left out.
    """
    try:
        with decoding(f"point cloud {index}", where=where, fix=SALVAGE_FIX):
            if scans.type_name == "sensor_msgs/PointCloud2":
                return scan_from_cloud(payload, point_time, in_map=in_map, read=scans.read)
            return scan_from_livox(payload, in_map=in_map, read=scans.read)
    except RecordingError:
        if not salvage:
            raise
    return LidarScan.lost(int(scans.index.stamps_ns[index]), in_map=in_map)


@dataclass(frozen=True, slots=True, eq=False)
class RosRecording:
    """An indexed ROS recording; fits :class:`civil_rgbd.domain.recording.Recording`.

    Attributes:
        name: the file's stem.
        sources: the files behind it.
        notes: what a reader of the built bridge must know.
        rig: camera, extrinsics, time offset.
        trajectory: ``T_map_body``, LiDAR clock.
        payloads: fetches messages.
        scans: the point clouds.
        images: the images, of a topic or of a folder beside the recording.
        point_time: how a PointCloud2's time field is to be read; None for Livox messages, which
            know it themselves, and for clouds without.
        point_reach_ns: how far point stamps may lie from their header's.
        in_map: the clouds are in the map frame already.
        salvage: go on without messages that cannot be decoded; they are counted.
        camera_fits: an image was decoded and has the camera's size, so that one that has not is
            itself at fault.
    """

    name: str
    sources: tuple[SourceFile, ...]
    notes: RecordingNotes
    rig: Rig
    trajectory: Trajectory
    payloads: Payloads
    scans: Stream
    images: Stream | ImageFolder
    point_time: PointTime | None
    point_reach_ns: tuple[int, int]
    in_map: bool
    salvage: bool = False
    camera_fits: bool = False

    @property
    def image_stamps_ns(self) -> NDArray[np.int64]:
        """(I,) header stamps of all images, camera clock, message order."""
        images = self.images
        return images.stamps_ns if isinstance(images, ImageFolder) else images.index.stamps_ns

    @property
    def scan_stamps_ns(self) -> NDArray[np.int64]:
        """(S,) header stamps of all LiDAR messages, message order."""
        return self.scans.index.stamps_ns

    def read_scan(self, index: int) -> LidarScan:
        """Decode one LiDAR message.

        Raises:
            RecordingError: the message breaks its own layout, and is not to be left out.
        """
        payload = self.payloads.fetch(*self.scans.index.place(index))
        return decoded_scan(
            self.scans,
            payload,
            index,
            point_time=self.point_time,
            in_map=self.in_map,
            salvage=self.salvage,
            where=self._where(self.scans),
        )

    def read_image(self, index: int) -> CameraImage:
        """Decode one image.

        Raises:
            ImageDecodeError: this one image cannot be decoded; others may.
            RecordingError: the images do not fit the camera.
        """
        try:
            return self._image(index)
        except ImageDecodeError:
            raise
        except RecordingError as error:
            # A codec or a size that no image fits is no damage.
            damaged = isinstance(error.__cause__, CdrError) or self.camera_fits
            if not (self.salvage and damaged):
                raise
            raise ImageDecodeError(error.what, where=error.where, fix=error.fix) from error

    def read_small_grey(self, index: int, reduction: int) -> NDArray[np.uint8]:
        """Decode one image small and grey, a JPEG without its whole pixels.

        Raises:
            ImageDecodeError: this one image cannot be decoded; others may.
            RecordingError: its codec is not read, or it does not fit the camera.
        """
        images = self.images
        if isinstance(images, ImageFolder) or images.type_name != "sensor_msgs/CompressedImage":
            return shrunk(self.read_image(index).rgb, reduction)
        payload = self.payloads.fetch(*images.index.place(index))
        where = f"{self._where(images)}, image {index}"
        with decoding(f"image {index}", where=where, fix=SALVAGE_FIX):
            return small_grey_from_compressed(payload, reduction, where=where, read=images.read)

    def _image(self, index: int) -> CameraImage:
        stamp_ns, images = int(self.image_stamps_ns[index]), self.images
        if isinstance(images, ImageFolder):
            return read_image_file(images.paths[index], index, stamp_ns, self.rig.camera)
        payload = self.payloads.fetch(*images.index.place(index))
        where = f"{self._where(images)}, image {index}"
        with decoding(f"image {index}", where=where, fix=SALVAGE_FIX):
            compressed = images.type_name == "sensor_msgs/CompressedImage"
            decode = rgb_from_compressed if compressed else rgb_from_image
            rgb = decode(payload, where=where, read=images.read)
        camera = self.rig.camera.pinhole
        if rgb.shape[:2] != (camera.height_px, camera.width_px):
            raise self._misfit(index, rgb.shape[1], rgb.shape[0], where)
        return CameraImage(index, stamp_ns, rgb)

    def _misfit(self, index: int, width_px: int, height_px: int, where: str) -> RecordingError:
        camera = self.rig.camera.pinhole
        if self.camera_fits:
            return RecordingError(
                f"image {index} has {width_px} x {height_px} pixels, those before "
                f"{camera.width_px} x {camera.height_px}",
                where=where,
                fix="leave such images out: --salvage; or record images of one size",
            )
        return RecordingError(
            f"images have {width_px} x {height_px} pixels, the camera model "
            f"{camera.width_px} x {camera.height_px}",
            where=where,
            fix="choose the CameraInfo of this camera (--camera-info-topic), or give the "
            "camera in a rig file (--rig)",
        )

    def _where(self, stream: Stream) -> str:
        return f"{self.sources[0].name}: {stream.topic}"
