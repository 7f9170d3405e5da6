"""ROS 1 messages as engines read them: Imu, PointCloud2, Livox CustomMsg; little endian, packed."""

from __future__ import annotations

import struct
from typing import Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.ros1.bag_writer import MessageType, ros_time

IMU_TYPE: Final = "sensor_msgs/Imu"
CLOUD_TYPE: Final = "sensor_msgs/PointCloud2"
LIVOX_TYPE: Final = "livox_ros_driver/CustomMsg"

_HEADER_TEXT = "std_msgs/Header header\n"
_HEADER_PART = f"{'=' * 80}\nMSG: std_msgs/Header\nuint32 seq\ntime stamp\nstring frame_id\n"
_VECTOR_PART = f"{'=' * 80}\nMSG: geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z\n"

TYPES: Final[dict[str, MessageType]] = {
    IMU_TYPE: MessageType(
        IMU_TYPE,
        "6a62c6daae103f4ff57a132d6f95cec2",
        (
            f"{_HEADER_TEXT}geometry_msgs/Quaternion orientation\n"
            "float64[9] orientation_covariance\n"
            "geometry_msgs/Vector3 angular_velocity\nfloat64[9] angular_velocity_covariance\n"
            "geometry_msgs/Vector3 linear_acceleration\nfloat64[9] linear_acceleration_covariance\n"
            f"{_HEADER_PART}{'=' * 80}\nMSG: geometry_msgs/Quaternion\n"
            f"float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n{_VECTOR_PART}"
        ),
    ),
    CLOUD_TYPE: MessageType(
        CLOUD_TYPE,
        "1158d486dd51d683ce2f1be655c3c181",
        (
            f"{_HEADER_TEXT}uint32 height\nuint32 width\nsensor_msgs/PointField[] fields\n"
            "bool is_bigendian\nuint32 point_step\nuint32 row_step\nuint8[] data\nbool is_dense\n"
            f"{_HEADER_PART}{'=' * 80}\nMSG: sensor_msgs/PointField\n"
            "uint8 INT8=1\nuint8 UINT8=2\nuint8 INT16=3\nuint8 UINT16=4\nuint8 INT32=5\n"
            "uint8 UINT32=6\nuint8 FLOAT32=7\nuint8 FLOAT64=8\n"
            "string name\nuint32 offset\nuint8 datatype\nuint32 count\n"
        ),
    ),
    LIVOX_TYPE: MessageType(
        LIVOX_TYPE,
        "e4d6829bdfe657cb6c21a746c86b21a6",
        (
            f"{_HEADER_TEXT}uint64 timebase\nuint32 point_num\nuint8 lidar_id\nuint8[3] rsvd\n"
            f"CustomPoint[] points\n{_HEADER_PART}{'=' * 80}\nMSG: livox_ros_driver/CustomPoint\n"
            "uint32 offset_time\nfloat32 x\nfloat32 y\nfloat32 z\n"
            "uint8 reflectivity\nuint8 tag\nuint8 line\n"
        ),
    ),
}

_LIVOX_POINT: Final = np.dtype(
    [
        ("offset_time", "<u4"),
        ("xyz", "<f4", 3),
        ("reflectivity", "u1"),
        ("tag", "u1"),
        ("line", "u1"),
    ]
)
_CLOUD_POINT: Final = np.dtype([("xyz", "<f4", 3), ("intensity", "<f4"), ("t", "<u4")])
_FLOAT32, _UINT32 = 7, 6
_CLOUD_FIELDS: Final = (
    ("x", 0, _FLOAT32),
    ("y", 4, _FLOAT32),
    ("z", 8, _FLOAT32),
    ("intensity", 12, _FLOAT32),
    ("t", 16, _UINT32),
)
_LIVOX_LINES = 6


def imu_message(
    stamp_ns: int, rate_rad_s: NDArray[np.float64], force_m_s2: NDArray[np.float64]
) -> bytes:
    """Encode ``sensor_msgs/Imu``; the orientation is not measured (covariance -1)."""
    numbers = [0.0, 0.0, 0.0, 1.0, -1.0, *[0.0] * 8, *rate_rad_s, *[0.0] * 9, *force_m_s2]
    return _header(stamp_ns, "imu") + struct.pack("<37d", *numbers, *[0.0] * 9)


def livox_message(
    stamp_ns: int, points_lidar: NDArray[np.float32], offsets_ns: NDArray[np.int64]
) -> bytes:
    """Encode ``livox_ros_driver/CustomMsg``.

    Args:
        stamp_ns: of the header.
        points_lidar: (N, 3) float32 metres.
        offsets_ns: (N,) int64, after the header, ascending, below 2^32.
    """
    points = np.zeros(len(points_lidar), dtype=_LIVOX_POINT)
    points["offset_time"], points["xyz"] = offsets_ns, points_lidar
    points["tag"] = 0b010000  # the first return
    points["line"] = np.arange(len(points)) % _LIVOX_LINES
    counts = struct.pack("<QIBBBBI", stamp_ns, len(points), 0, 0, 0, 0, len(points))
    return _header(stamp_ns, "lidar") + counts + points.tobytes()


def cloud_message(
    stamp_ns: int, points_lidar: NDArray[np.float32], offsets_ns: NDArray[np.int64]
) -> bytes:
    """Encode ``sensor_msgs/PointCloud2`` with fields x y z intensity t; arguments as above."""
    points = np.zeros(len(points_lidar), dtype=_CLOUD_POINT)
    points["t"], points["xyz"] = offsets_ns, points_lidar
    fields = b"".join(
        _text(name) + struct.pack("<IBI", offset, kind, 1) for name, offset, kind in _CLOUD_FIELDS
    )
    size = points.nbytes
    return b"".join(
        (
            _header(stamp_ns, "lidar"),
            struct.pack("<III", 1, len(points), len(_CLOUD_FIELDS)),
            fields,
            struct.pack("<BIII", 0, _CLOUD_POINT.itemsize, size, size),
            points.tobytes(),
            b"\x01",  # dense: no point is NaN
        )
    )


def _header(stamp_ns: int, frame_id: str) -> bytes:
    return b"\0\0\0\0" + ros_time(stamp_ns) + _text(frame_id)


def _text(value: str) -> bytes:
    encoded = value.encode()
    return struct.pack("<I", len(encoded)) + encoded
