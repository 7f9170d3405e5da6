"""The message definitions that go into a recording, so that any reader can decode it."""

from __future__ import annotations

from typing import Final

_TIME: Final = "int32 sec\nuint32 nanosec\n"
_HEADER: Final = "builtin_interfaces/Time stamp\nstring frame_id\n"
_VECTOR: Final = "float64 x\nfloat64 y\nfloat64 z\n"
_QUATERNION: Final = "float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n"
_POSE: Final = "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n"
_TWIST: Final = "geometry_msgs/Vector3 linear\ngeometry_msgs/Vector3 angular\n"
_TRANSFORM: Final = "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation\n"

_PARTS: Final = {
    "builtin_interfaces/Time": _TIME,
    "std_msgs/Header": _HEADER,
    "geometry_msgs/Vector3": _VECTOR,
    "geometry_msgs/Point": _VECTOR,
    "geometry_msgs/Quaternion": _QUATERNION,
    "geometry_msgs/Pose": _POSE,
    "geometry_msgs/PoseWithCovariance": "geometry_msgs/Pose pose\nfloat64[36] covariance\n",
    "geometry_msgs/Twist": _TWIST,
    "geometry_msgs/TwistWithCovariance": "geometry_msgs/Twist twist\nfloat64[36] covariance\n",
    "geometry_msgs/Transform": _TRANSFORM,
    "geometry_msgs/TransformStamped": (
        "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform\n"
    ),
    "sensor_msgs/RegionOfInterest": (
        "uint32 x_offset\nuint32 y_offset\nuint32 height\nuint32 width\nbool do_rectify\n"
    ),
    "livox_ros_driver2/CustomPoint": (
        "uint32 offset_time\nfloat32 x\nfloat32 y\nfloat32 z\n"
        "uint8 reflectivity\nuint8 tag\nuint8 line\n"
    ),
}

_MESSAGES: Final = {
    "std_msgs/msg/Header": (_HEADER, ("builtin_interfaces/Time",)),
    "livox_ros_driver2/msg/CustomMsg": (
        (
            "std_msgs/Header header\nuint64 timebase\nuint32 point_num\nuint8 lidar_id\n"
            "uint8[3] rsvd\nCustomPoint[] points\n"
        ),
        ("std_msgs/Header", "builtin_interfaces/Time", "livox_ros_driver2/CustomPoint"),
    ),
    "sensor_msgs/msg/Imu": (
        (
            "std_msgs/Header header\n"
            "geometry_msgs/Quaternion orientation\nfloat64[9] orientation_covariance\n"
            "geometry_msgs/Vector3 angular_velocity\nfloat64[9] angular_velocity_covariance\n"
            "geometry_msgs/Vector3 linear_acceleration\nfloat64[9] linear_acceleration_covariance\n"
        ),
        (
            "std_msgs/Header",
            "builtin_interfaces/Time",
            "geometry_msgs/Quaternion",
            "geometry_msgs/Vector3",
        ),
    ),
    "sensor_msgs/msg/CompressedImage": (
        "std_msgs/Header header\nstring format\nuint8[] data\n",
        ("std_msgs/Header", "builtin_interfaces/Time"),
    ),
    "sensor_msgs/msg/CameraInfo": (
        (
            "std_msgs/Header header\nuint32 height\nuint32 width\nstring distortion_model\n"
            "float64[] d\nfloat64[9] k\nfloat64[9] r\nfloat64[12] p\n"
            "uint32 binning_x\nuint32 binning_y\nRegionOfInterest roi\n"
        ),
        ("std_msgs/Header", "builtin_interfaces/Time", "sensor_msgs/RegionOfInterest"),
    ),
    "nav_msgs/msg/Odometry": (
        (
            "std_msgs/Header header\nstring child_frame_id\n"
            "geometry_msgs/PoseWithCovariance pose\ngeometry_msgs/TwistWithCovariance twist\n"
        ),
        (
            "std_msgs/Header",
            "builtin_interfaces/Time",
            "geometry_msgs/PoseWithCovariance",
            "geometry_msgs/Pose",
            "geometry_msgs/Point",
            "geometry_msgs/Quaternion",
            "geometry_msgs/TwistWithCovariance",
            "geometry_msgs/Twist",
            "geometry_msgs/Vector3",
        ),
    ),
    "tf2_msgs/msg/TFMessage": (
        "geometry_msgs/TransformStamped[] transforms\n",
        (
            "geometry_msgs/TransformStamped",
            "std_msgs/Header",
            "builtin_interfaces/Time",
            "geometry_msgs/Transform",
            "geometry_msgs/Vector3",
            "geometry_msgs/Quaternion",
        ),
    ),
}


def schema_text(message_type: str) -> str:
    """Return the full definition of a message type, with every type that it uses.

    >>> schema_text("sensor_msgs/msg/CompressedImage").splitlines()[4]
    'MSG: std_msgs/Header'
    """
    text, parts = _MESSAGES[message_type]
    rule = "=" * 80
    return text + "".join(f"{rule}\nMSG: {part}\n{_PARTS[part]}" for part in parts)
