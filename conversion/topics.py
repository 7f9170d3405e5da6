"""Which topic is what: found by type, chosen by option where several fit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from civil_rgbd.conversion.encodings import READERS
from civil_rgbd.conversion.gathering import (
    Gathered,
    GatheredCameraInfo,
    GatheredFrame,
    GatheredLivox,
    GatheredPaths,
    GatheredPoses,
    GatheredSensor,
    GatheredTransforms,
)
from civil_rgbd.errors import RecordingError, UsageError
from civil_rgbd.resources import nearest

ORIGIN: Final = "/civil_rgbd/origin"
"""The topic on which a simulator says that it is one, by the frame id ``simulated``."""

LIVOX_TYPES: Final = frozenset(
    f"{package}/CustomMsg"
    for package in ("livox_ros_driver", "livox_ros_driver2", "livox_interfaces")
)
"""The same message under three names."""

PATH: Final = "nav_msgs/Path"
IMAGE: Final = "sensor_msgs/Image"

_GATHERERS: Final[dict[str, tuple[str, Callable[[], Gathered]]]] = {
    "sensor_msgs/PointCloud2": ("lidar", GatheredSensor),
    **dict.fromkeys(LIVOX_TYPES, ("lidar", GatheredLivox)),
    "sensor_msgs/CompressedImage": ("image", GatheredSensor),
    IMAGE: ("image", GatheredSensor),
    "sensor_msgs/CameraInfo": ("camera_info", GatheredCameraInfo),
    "sensor_msgs/Imu": ("imu", GatheredFrame),
    "nav_msgs/Odometry": ("pose", lambda: GatheredPoses(has_child_frame=True)),
    "geometry_msgs/PoseStamped": ("pose", lambda: GatheredPoses(has_child_frame=False)),
    "geometry_msgs/PoseWithCovarianceStamped": (
        "pose",
        lambda: GatheredPoses(has_child_frame=False),
    ),
    PATH: ("pose", GatheredPaths),
    "std_msgs/Header": ("origin", GatheredFrame),
    "tf2_msgs/TFMessage": ("tf", GatheredTransforms),
    "tf/tfMessage": ("tf", GatheredTransforms),
}

_NOUNS: Final = {
    "lidar": "point clouds",
    "image": "images",
    "camera_info": "CameraInfo",
    "pose": "poses",
    "imu": "IMU readings",
}


def plain_type(name: str) -> str:
    """Return a type's name without the part that ROS 2 added.

    >>> plain_type("sensor_msgs/msg/PointCloud2")
    'sensor_msgs/PointCloud2'
    """
    return name.replace("/msg/", "/")


def role_of(type_name: str) -> str:
    """Return what a build takes messages of a plain type for; empty when no build reads them.

    >>> role_of("sensor_msgs/PointCloud2"), role_of("std_msgs/String")
    ('lidar', '')
    """
    role, _ = _GATHERERS.get(type_name, ("", Gathered))
    return role if role != "origin" else ""


@dataclass(frozen=True, slots=True, eq=False)
class Topic:
    """One topic of interest.

    Attributes:
        name: as recorded.
        type_name: plain, without ``/msg/``.
        role: lidar, image, camera_info, imu, pose, tf or origin.
        gathered: what was kept of its messages.
    """

    name: str
    type_name: str
    role: str
    gathered: Gathered

    @property
    def listing(self) -> str:
        """Name, type and count, for an error's list."""
        return f"{self.name} ({self.type_name}, {self.gathered.count} messages)"


class TopicTable:
    """All topics of a recording, by name and type; filled while the recording is walked."""

    def __init__(self) -> None:
        self._topics: dict[tuple[str, str], Topic] = {}
        self._unread: dict[tuple[str, str], str] = {}

    def sink_for(self, name: str, type_name: str, encoding: str) -> Gathered | None:
        """Return what takes the messages of one channel; channels of one topic share it."""
        plain = plain_type(type_name)
        if plain not in _GATHERERS:
            return None
        if encoding not in READERS:
            self._unread[name, plain] = encoding
            return None
        if (name, plain) not in self._topics:
            role, gather = _GATHERERS[plain]
            self._topics[name, plain] = Topic(name, plain, role, gather())
            self._topics[name, plain].gathered.read = READERS[encoding]
        elif self._topics[name, plain].gathered.read is not READERS[encoding]:
            raise RecordingError(
                f"topic {name!r} holds messages of ROS 1 and of ROS 2",
                where=name,
                fix="record each under a topic of its own, or into a file of its own",
            )
        return self._topics[name, plain].gathered

    @property
    def simulated(self) -> bool:
        """A message says that the recording comes from a simulator."""
        return any(
            (topic.name, topic.gathered.frame) == (ORIGIN, "simulated")
            for topic in self.of_role("origin")
        )

    def of_role(self, role: str) -> list[Topic]:
        """Topics of one role that have messages, by name."""
        found = [t for t in self._topics.values() if t.role == role and t.gathered.count]
        return sorted(found, key=lambda topic: (topic.name, topic.type_name))

    def refuse_other_encodings(self, role: str, *, where: object) -> None:
        """Say so when the only topics of a role are encoded neither as ROS 2 nor as ROS 1 does.

        Raises:
            RecordingError: such topics exist.
        """
        found = {
            f"{name} ({plain}, message_encoding {encoding!r})"
            for (name, plain), encoding in self._unread.items()
            if _GATHERERS[plain][0] == role
        }
        if found and not self.of_role(role):
            raise RecordingError(
                f"the {_NOUNS[role]} are in an encoding that is not read (only cdr and ros1 are): "
                + ", ".join(sorted(found)),
                where=where,
                fix="convert the recording to ROS 2 messages, e.g. `rosbags-convert` or "
                "`mcap convert` from the original bag",
            )

    def named(self, name: str, role: str, *, where: object) -> Topic:
        """Return the topic that an option names.

        Raises:
            UsageError: no such topic, or it is of another type.
        """
        known = self.of_role(role) + (self.of_role("tf") if role == "pose" else [])
        fitting = [topic for topic in known if topic.name == name]
        if len(fitting) == 1:
            return fitting[0]
        option = option_of(role)
        if fitting:
            raise UsageError(
                f"topic {name!r} carries several types: "
                + ", ".join(topic.listing for topic in fitting),
                where=where,
                fix="record each type under a topic of its own",
            )
        raise UsageError(
            f"{option} {name!r} names no topic with {_NOUNS[role]}",
            where=where,
            fix=nearest(name, [topic.name for topic in known]),
        )


def option_of(role: str) -> str:
    """Return the option that chooses a topic.

    >>> option_of("camera_info")
    '--camera-info-topic'
    """
    return f"--{role.replace('_', '-')}-topic"


def ask_which(topics: list[Topic], role: str, *, where: object) -> UsageError:
    """Compose the error for several topics that fit."""
    return UsageError(
        f"several topics carry {_NOUNS[role]}: " + ", ".join(topic.listing for topic in topics),
        where=where,
        fix=f"choose one with {option_of(role)}, e.g. `{option_of(role)} {topics[0].name}`",
    )


def none_found(role: str, fix: str, *, where: object) -> RecordingError:
    """Compose the error for no topic that fits."""
    return RecordingError(f"the recording holds no {_NOUNS[role]}", where=where, fix=fix)


def same_camera(infos: list[Topic], image_topic: str) -> list[Topic]:
    """Return the CameraInfo topics in the image topic's namespace.

    ``/left/image_rect/compressed`` and ``/left/camera_info`` belong together.
    """
    base = image_topic
    for transport in ("/compressed", "/ffmpeg", "/theora"):
        base = base.removesuffix(transport)
    namespace = base.rpartition("/")[0]
    return [topic for topic in infos if topic.name.rpartition("/")[0] == namespace]
