"""Writes tiny.mcap: two seconds of a Livox and a camera, in a few kilobytes.

The messages are encoded by mcap-ros2-support from their definitions, not by this project:
`python tests/data/recordings/make.py` writes the file anew beside this one.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from mcap.writer import CompressionType
from mcap_ros2.writer import Writer

START_NS = 1_700_000_000_000_000_000
SCANS, POINTS, IMAGES = 20, 12, 10
RULE = "=" * 80

HEADER = f"""
{RULE}
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
{RULE}
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
GEOMETRY = f"""
{RULE}
MSG: geometry_msgs/Point
float64 x
float64 y
float64 z
{RULE}
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
{RULE}
MSG: geometry_msgs/Quaternion
float64 x
float64 y
float64 z
float64 w
{RULE}
MSG: geometry_msgs/Pose
geometry_msgs/Point position
geometry_msgs/Quaternion orientation
{RULE}
MSG: geometry_msgs/Twist
geometry_msgs/Vector3 linear
geometry_msgs/Vector3 angular
{RULE}
MSG: geometry_msgs/Transform
geometry_msgs/Vector3 translation
geometry_msgs/Quaternion rotation
"""
DEFINITIONS = {
    "livox_ros_driver2/msg/CustomMsg": f"""std_msgs/Header header
uint64 timebase
uint32 point_num
uint8 lidar_id
uint8[3] rsvd
CustomPoint[] points
{RULE}
MSG: livox_ros_driver2/CustomPoint
uint32 offset_time
float32 x
float32 y
float32 z
uint8 reflectivity
uint8 tag
uint8 line"""
    + HEADER,
    "sensor_msgs/msg/CompressedImage": "std_msgs/Header header\nstring format\nuint8[] data"
    + HEADER,
    "sensor_msgs/msg/CameraInfo": f"""std_msgs/Header header
uint32 height
uint32 width
string distortion_model
float64[] d
float64[9] k
float64[9] r
float64[12] p
uint32 binning_x
uint32 binning_y
sensor_msgs/RegionOfInterest roi
{RULE}
MSG: sensor_msgs/RegionOfInterest
uint32 x_offset
uint32 y_offset
uint32 height
uint32 width
bool do_rectify"""
    + HEADER,
    "nav_msgs/msg/Odometry": f"""std_msgs/Header header
string child_frame_id
geometry_msgs/PoseWithCovariance pose
geometry_msgs/TwistWithCovariance twist
{RULE}
MSG: geometry_msgs/PoseWithCovariance
geometry_msgs/Pose pose
float64[36] covariance
{RULE}
MSG: geometry_msgs/TwistWithCovariance
geometry_msgs/Twist twist
float64[36] covariance"""
    + HEADER
    + GEOMETRY,
    "tf2_msgs/msg/TFMessage": f"""geometry_msgs/TransformStamped[] transforms
{RULE}
MSG: geometry_msgs/TransformStamped
std_msgs/Header header
string child_frame_id
geometry_msgs/Transform transform"""
    + HEADER
    + GEOMETRY,
}


def header(stamp_ns: int, frame: str) -> dict[str, Any]:
    return {
        "stamp": {"sec": stamp_ns // 10**9, "nanosec": stamp_ns % 10**9},
        "frame_id": frame,
    }


def xyz(x: float, y: float, z: float) -> dict[str, float]:
    return {"x": x, "y": y, "z": z}


def point_of(scan: int, point: int) -> dict[str, Any]:
    return {
        "offset_time": point * 4167,
        **xyz(2.0 + scan, point * 0.25, -0.5),
        "reflectivity": point,
        "tag": 0x10 if point % 3 else 0x12,
        "line": point % 6,
    }


def custom_msg(scan: int, stamp_ns: int) -> dict[str, Any]:
    return {
        "header": header(stamp_ns, "livox_frame"),
        "timebase": stamp_ns,
        "point_num": POINTS,
        "lidar_id": 3,
        "rsvd": [0, 0, 0],
        "points": [point_of(scan, point) for point in range(POINTS)],
    }


def image(stamp_ns: int) -> dict[str, Any]:
    pixels = np.full((24, 32, 3), (40, 90, 220), dtype=np.uint8)  # BGR
    data = bytes(cv2.imencode(".png", pixels)[1])
    return {
        "header": header(stamp_ns, "optical"),
        "format": "rgb8; png compressed bgr8",
        "data": data,
    }


def camera_info(stamp_ns: int) -> dict[str, Any]:
    return {
        "header": header(stamp_ns, "optical"),
        "height": 24,
        "width": 32,
        "distortion_model": "plumb_bob",
        "d": [-0.05, 0.06, 0.0001, -0.001, -0.02],
        "k": [30.0, 0.0, 15.5, 0.0, 31.0, 11.5, 0.0, 0.0, 1.0],
        "r": [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        "p": [29.0, 0.0, 15.0, 0.0, 0.0, 29.0, 11.0, 0.0, 0.0, 0.0, 1.0, 0.0],
        "binning_x": 0,
        "binning_y": 0,
        "roi": {"x_offset": 0, "y_offset": 0, "height": 0, "width": 0, "do_rectify": False},
    }


def odometry(step: int, stamp_ns: int) -> dict[str, Any]:
    still = {"linear": xyz(0, 0, 0), "angular": xyz(0, 0, 0)}
    pose = {
        "position": xyz(0.05 * step, 0, 0),
        "orientation": {**xyz(0, 0, 0), "w": 1.0},
    }
    return {
        "header": header(stamp_ns, "camera_init"),
        "child_frame_id": "livox_frame",
        "pose": {"pose": pose, "covariance": [0.0] * 36},
        "twist": {"twist": still, "covariance": [0.0] * 36},
    }


def static_transform() -> dict[str, Any]:
    rotation = {**xyz(-0.5, 0.5, -0.5), "w": 0.5}
    link = {
        "header": header(START_NS, "livox_frame"),
        "child_frame_id": "optical",
        "transform": {"translation": xyz(0.1, 0.2, 0.3), "rotation": rotation},
    }
    return {"transforms": [link]}


def main(path: Path) -> None:
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=2048, compression=CompressionType.ZSTD)
        schema = {name: writer.register_msgdef(name, text) for name, text in DEFINITIONS.items()}

        def write(topic: str, type_name: str, message: dict[str, Any], stamp_ns: int) -> None:
            writer.write_message(topic, schema[type_name], message, stamp_ns, stamp_ns)

        write("/tf_static", "tf2_msgs/msg/TFMessage", static_transform(), START_NS)
        for i in range(SCANS + 1):
            now = START_NS + i * 10**8
            write("/Odometry", "nav_msgs/msg/Odometry", odometry(i, now), now)
            if i < SCANS:
                custom = "livox_ros_driver2/msg/CustomMsg"
                write("/livox/lidar", custom, custom_msg(i, now), now)
            if i < SCANS and i % 2:
                write("/camera/info", "sensor_msgs/msg/CameraInfo", camera_info(now), now)
                write(
                    "/camera/image/compressed", "sensor_msgs/msg/CompressedImage", image(now), now
                )
        writer.finish()


if __name__ == "__main__":
    main(Path(__file__).with_name("tiny.mcap"))
