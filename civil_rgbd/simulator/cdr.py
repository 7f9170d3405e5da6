"""Writes ROS 2 messages: little-endian CDR, one small function a message type."""

from __future__ import annotations

import struct
from typing import Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.constants import NS_PER_S
from civil_rgbd.geometry.camera import LensCamera
from civil_rgbd.simulator.lidar import LivoxScan

_POINT: Final = np.dtype(
    {
        "names": ["offset_time", "x", "y", "z", "reflectivity", "tag", "line"],
        "formats": ["<u4", "<f4", "<f4", "<f4", "u1", "u1", "u1"],
        "offsets": [0, 4, 8, 12, 16, 17, 18],
        "itemsize": 20,  # 19 bytes and one of padding before the next point, none after the last
    }
)


class CdrMessage:
    """A message as it grows; numbers are aligned to their size, counted after the 4-byte header."""

    def __init__(self) -> None:
        self._bytes = bytearray(b"\x00\x01\x00\x00")

    def numbers(self, kind: str, *values: float) -> CdrMessage:
        """Append numbers of one :mod:`struct` kind, such as ``I`` or ``d``."""
        size = struct.calcsize(kind)
        self._bytes += bytes(-(len(self._bytes) - 4) % size)
        self._bytes += struct.pack(f"<{len(values)}{kind}", *values)
        return self

    def text(self, value: str) -> CdrMessage:
        """Append a string."""
        encoded = value.encode() + b"\x00"
        self.numbers("I", len(encoded))
        self._bytes += encoded
        return self

    def stamp(self, stamp_ns: int) -> CdrMessage:
        """Append a ``builtin_interfaces/Time``."""
        seconds, nanoseconds = divmod(stamp_ns, NS_PER_S)
        return self.numbers("i", seconds).numbers("I", nanoseconds)

    def header(self, stamp_ns: int, frame_id: str) -> CdrMessage:
        """Append a ``std_msgs/Header``."""
        return self.stamp(stamp_ns).text(frame_id)

    def raw(self, values: bytes) -> CdrMessage:
        """Append bytes as they are."""
        self._bytes += values
        return self

    def finished(self) -> bytes:
        """Return the message."""
        return bytes(self._bytes)


def livox_message(scan: LivoxScan, frame_id: str) -> bytes:
    """Encode ``livox_ros_driver2/msg/CustomMsg``."""
    points = np.zeros(len(scan.points_lidar), dtype=_POINT)
    points["offset_time"] = scan.offset_ns
    for axis, name in enumerate("xyz"):
        points[name] = scan.points_lidar[:, axis]
    points["reflectivity"], points["tag"], points["line"] = scan.reflectivity, scan.tag, scan.line
    message = CdrMessage().header(scan.stamp_ns, frame_id)
    message.numbers("Q", scan.stamp_ns).numbers("I", len(points))  # timebase, point_num
    message.numbers("B", 0, 0, 0, 0).numbers("I", len(points))  # lidar_id, rsvd; the sequence
    return message.raw(points.tobytes()[:-1]).finished()


def imu_message(
    stamp_ns: int, frame_id: str, rate_rad_s: NDArray[np.float64], force_g: NDArray[np.float64]
) -> bytes:
    """Encode ``sensor_msgs/msg/Imu``; the orientation is not measured."""
    message = CdrMessage().header(stamp_ns, frame_id)
    message.numbers("d", 0.0, 0.0, 0.0, 1.0, -1.0, *[0.0] * 8)  # covariance -1: no orientation
    message.numbers("d", *rate_rad_s, *[0.0] * 9)
    return message.numbers("d", *force_g, *[0.0] * 9).finished()


def image_message(stamp_ns: int, frame_id: str, jpeg: bytes) -> bytes:
    """Encode ``sensor_msgs/msg/CompressedImage``."""
    message = CdrMessage().header(stamp_ns, frame_id).text("rgb8; jpeg compressed bgr8")
    return message.numbers("I", len(jpeg)).raw(jpeg).finished()


def camera_info_message(stamp_ns: int, frame_id: str, camera: LensCamera) -> bytes:
    """Encode ``sensor_msgs/msg/CameraInfo`` of a raw image."""
    pinhole, K = camera.pinhole, camera.pinhole.matrix
    message = CdrMessage().header(stamp_ns, frame_id)
    message.numbers("I", pinhole.height_px, pinhole.width_px).text(camera.lens)
    message.numbers("I", len(camera.coefficients)).numbers("d", *camera.coefficients)
    message.numbers("d", *K.ravel()).numbers("d", *np.eye(3).ravel())
    message.numbers("d", *np.hstack([K, np.zeros((3, 1))]).ravel())
    message.numbers("I", 0, 0)  # binning
    return message.numbers("I", 0, 0, 0, 0).numbers("B", 0).finished()  # region of interest


def odometry_message(
    stamp_ns: int,
    frame_ids: tuple[str, str],
    translation_m: NDArray[np.float64],
    quaternion_xyzw: NDArray[np.float64],
) -> bytes:
    """Encode ``nav_msgs/msg/Odometry``; ``frame_ids`` are the parent and the child."""
    message = CdrMessage().header(stamp_ns, frame_ids[0]).text(frame_ids[1])
    message.numbers("d", *translation_m, *quaternion_xyzw, *[0.0] * 36)
    return message.numbers("d", *[0.0] * 42).finished()


def tf_message(
    stamp_ns: int,
    links: list[tuple[str, str, NDArray[np.float64], NDArray[np.float64]]],
) -> bytes:
    """Encode ``tf2_msgs/msg/TFMessage`` from (parent, child, translation, quaternion xyzw)."""
    message = CdrMessage().numbers("I", len(links))
    for parent, child, translation_m, quaternion_xyzw in links:
        message.header(stamp_ns, parent).text(child)
        message.numbers("d", *translation_m, *quaternion_xyzw)
    return message.finished()
