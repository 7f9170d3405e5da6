"""The message definitions that go into a recording, so that any reader can decode it."""

from __future__ import annotations

from typing import Final

from civil_rgbd.ros1.bag_writer import MessageType

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
    "std_msgs/Header": (_HEADER, ("builtin_interfaces/Time",)),
    "livox_ros_driver2/CustomMsg": (
        (
            "std_msgs/Header header\nuint64 timebase\nuint32 point_num\nuint8 lidar_id\n"
            "uint8[3] rsvd\nCustomPoint[] points\n"
        ),
        ("std_msgs/Header", "builtin_interfaces/Time", "livox_ros_driver2/CustomPoint"),
    ),
    "sensor_msgs/Imu": (
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
    "sensor_msgs/CompressedImage": (
        "std_msgs/Header header\nstring format\nuint8[] data\n",
        ("std_msgs/Header", "builtin_interfaces/Time"),
    ),
    "sensor_msgs/CameraInfo": (
        (
            "std_msgs/Header header\nuint32 height\nuint32 width\nstring distortion_model\n"
            "float64[] d\nfloat64[9] k\nfloat64[9] r\nfloat64[12] p\n"
            "uint32 binning_x\nuint32 binning_y\nRegionOfInterest roi\n"
        ),
        ("std_msgs/Header", "builtin_interfaces/Time", "sensor_msgs/RegionOfInterest"),
    ),
    "nav_msgs/Odometry": (
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
    "tf2_msgs/TFMessage": (
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


_ROS1_HEADER: Final = "uint32 seq\ntime stamp\nstring frame_id\n"

# What ROS computes of each definition; a recorder writes it beside, and subscribers compare it.
_MD5: Final = {
    "std_msgs/Header": "2176decaecbce78abc3b96ef049fabed",
    "livox_ros_driver2/CustomMsg": "e4d6829bdfe657cb6c21a746c86b21a6",
    "sensor_msgs/Imu": "6a62c6daae103f4ff57a132d6f95cec2",
    "sensor_msgs/CompressedImage": "8f7a12909da2c9d3332d540a0977563f",
    "sensor_msgs/CameraInfo": "c9a58c1b0b154e0e6da7578cb991d214",
    "nav_msgs/Odometry": "cd5e73d190d741a2f92e81eda573aca7",
    "tf2_msgs/TFMessage": "94810edda583a504dfda3829e70d7eec",
}


def ros2_name(message_type: str) -> str:
    """Return a type's name as ROS 2 writes it.

    >>> ros2_name("sensor_msgs/Imu")
    'sensor_msgs/msg/Imu'
    """
    return message_type.replace("/", "/msg/")


def schema_text(message_type: str) -> str:
    """Return ROS 2's full definition of a message type, with every type that it uses.

    >>> schema_text("sensor_msgs/CompressedImage").splitlines()[4]
    'MSG: std_msgs/Header'
    """
    text, parts = _MESSAGES[message_type]
    rule = "=" * 80
    return text + "".join(f"{rule}\nMSG: {part}\n{_PARTS[part]}" for part in parts)


def ros1_type(message_type: str) -> MessageType:
    """Return the same type as ROS 1 defines it.

    >>> ros1_type("std_msgs/Header").definition.splitlines()
    ['uint32 seq', 'time stamp', 'string frame_id']
    """
    definition = schema_text(message_type).replace(_HEADER, _ROS1_HEADER)
    time = f"{'=' * 80}\nMSG: builtin_interfaces/Time\n{_TIME}"
    definition = definition.replace(time, "")
    if message_type == "sensor_msgs/CameraInfo":
        for field in "dkrp":  # which ROS 1 writes in capitals
            definition = definition.replace(f"] {field}\n", f"] {field.upper()}\n")
    return MessageType(message_type, _MD5[message_type], definition)
