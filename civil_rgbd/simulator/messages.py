"""Writes messages, one small function a type, each into an empty message of either ROS."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.geometry.camera import LensCamera
from civil_rgbd.simulator.encodings import Encoding
from civil_rgbd.simulator.lidar import LivoxScan

_POINT_BYTES: Final = 19


def origin_message(message: Encoding, stamp_ns: int) -> bytes:
    """Encode ``std_msgs/Header`` that says who made the recording."""
    return message.header(stamp_ns, "simulated").finished()


def livox_message(message: Encoding, scan: LivoxScan, frame_id: str) -> bytes:
    """Encode Livox's ``CustomMsg``."""
    points = np.zeros(len(scan.points_lidar), dtype=_point_of(message.point_bytes))
    points["offset_time"] = scan.offset_ns
    for axis, name in enumerate("xyz"):
        points[name] = scan.points_lidar[:, axis]
    points["reflectivity"], points["tag"], points["line"] = scan.reflectivity, scan.tag, scan.line
    message.header(scan.stamp_ns, frame_id)
    message.numbers("Q", scan.stamp_ns).numbers("I", len(points))  # timebase, point_num
    message.numbers("B", 0, 0, 0, 0).numbers("I", len(points))  # lidar_id, rsvd; the sequence
    # The last point is not followed by what aligns the next.
    end = points.nbytes - (message.point_bytes - _POINT_BYTES)
    return message.raw(points.tobytes()[:end]).finished()


def imu_message(
    message: Encoding,
    stamp_ns: int,
    frame_id: str,
    rate_rad_s: NDArray[np.float64],
    force_g: NDArray[np.float64],
) -> bytes:
    """Encode ``sensor_msgs/Imu``; the orientation is not measured."""
    message.header(stamp_ns, frame_id)
    message.numbers("d", 0.0, 0.0, 0.0, 1.0, -1.0, *[0.0] * 8)  # covariance -1: no orientation
    message.numbers("d", *rate_rad_s, *[0.0] * 9)
    return message.numbers("d", *force_g, *[0.0] * 9).finished()


def image_message(message: Encoding, stamp_ns: int, frame_id: str, jpeg: bytes) -> bytes:
    """Encode ``sensor_msgs/CompressedImage``."""
    message.header(stamp_ns, frame_id).text("rgb8; jpeg compressed bgr8")
    return message.numbers("I", len(jpeg)).raw(jpeg).finished()


def camera_info_message(
    message: Encoding, stamp_ns: int, frame_id: str, camera: LensCamera
) -> bytes:
    """Encode ``sensor_msgs/CameraInfo`` of a raw image."""
    pinhole, K = camera.pinhole, camera.pinhole.matrix
    message.header(stamp_ns, frame_id)
    message.numbers("I", pinhole.height_px, pinhole.width_px).text(camera.lens)
    message.numbers("I", len(camera.coefficients)).numbers("d", *camera.coefficients)
    message.numbers("d", *K.ravel()).numbers("d", *np.eye(3).ravel())
    message.numbers("d", *np.hstack([K, np.zeros((3, 1))]).ravel())
    message.numbers("I", 0, 0)  # binning
    return message.numbers("I", 0, 0, 0, 0).numbers("B", 0).finished()  # region of interest


def odometry_message(
    message: Encoding,
    stamp_ns: int,
    frame_ids: tuple[str, str],
    translation_m: NDArray[np.float64],
    quaternion_xyzw: NDArray[np.float64],
) -> bytes:
    """Encode ``nav_msgs/Odometry``; ``frame_ids`` are the parent and the child."""
    message.header(stamp_ns, frame_ids[0]).text(frame_ids[1])
    message.numbers("d", *translation_m, *quaternion_xyzw, *[0.0] * 36)
    return message.numbers("d", *[0.0] * 42).finished()


def tf_message(
    message: Encoding,
    stamp_ns: int,
    links: list[tuple[str, str, NDArray[np.float64], NDArray[np.float64]]],
) -> bytes:
    """Encode ``tf2_msgs/TFMessage`` from (parent, child, translation, quaternion xyzw)."""
    message.numbers("I", len(links))
    for parent, child, translation_m, quaternion_xyzw in links:
        message.header(stamp_ns, parent).text(child)
        message.numbers("d", *translation_m, *quaternion_xyzw)
    return message.finished()


def _point_of(item_bytes: int) -> np.dtype[np.void]:
    return np.dtype(
        {
            "names": ["offset_time", "x", "y", "z", "reflectivity", "tag", "line"],
            "formats": ["<u4", "<f4", "<f4", "<f4", "u1", "u1", "u1"],
            "offsets": [0, 4, 8, 12, 16, 17, 18],
            "itemsize": item_bytes,
        }
    )
