"""From a table of topics to the ones that a build reads."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Final

from civil_rgbd.conversion.cdr import frame_name
from civil_rgbd.conversion.gathering import (
    Gathered,
    GatheredFrame,
    GatheredTransforms,
)
from civil_rgbd.conversion.ros_images import is_photograph
from civil_rgbd.conversion.topics import (
    Topic,
    TopicTable,
    ask_which,
    none_found,
    same_camera,
)
from civil_rgbd.domain.recording import RecordingOptions
from civil_rgbd.errors import RecordingError

_ALIKE_SHARE: Final = 0.9
_NO_POSES_FIX = (
    "give them by --trajectory FILE, which `civil-rgbd poses` computes where the recording has an "
    "IMU; or record them along (nav_msgs/Odometry, geometry_msgs/PoseStamped, nav_msgs/Path or tf) "
    "and name them with --pose-topic; say what they are of with --pose-of where they have no child "
    "frame, and give extrinsics that tf lacks with --rig"
)


def choose_lidar(table: TopicTable, options: RecordingOptions, *, where: object) -> Topic:
    """Choose the point clouds.

    Raises:
        UsageError: several fit, or the option names none.
        RecordingError: there are none, or they come in several frames.
    """
    topic = _choose(
        table,
        "lidar",
        options.lidar_topic,
        options,
        where=where,
        fix="record sensor_msgs/PointCloud2 or a Livox CustomMsg",
    )
    frames = topic.gathered.frames
    if len(frames) > 1 and not (options.salvage and nearly_all_alike(frames)):
        raise RecordingError(
            f"the point clouds come in several frames: {', '.join(sorted(topic.gathered.frames))}",
            where=f"{where}: {topic.name}",
            fix="record each LiDAR under a topic of its own",
        )
    return topic


def nearly_all_alike(names: Mapping[str, int]) -> bool:
    """Whether the other names are so few that damage may have made them.

    Args:
        names: messages by frame id.
    """
    return max(names.values()) >= _ALIKE_SHARE * sum(names.values())


def mostly(names: Mapping[str, int]) -> str:
    """Return the name of most messages; empty when there are none."""
    return max(names, key=lambda name: names[name], default="")


def choose_images(table: TopicTable, options: RecordingOptions, *, where: object) -> Topic:
    """Choose the images; depth images are left aside unless named.

    Raises:
        UsageError: several fit, or the option names none.
        RecordingError: there are none.
    """
    return _choose(
        table,
        "image",
        options.image_topic,
        options,
        where=where,
        fix="record sensor_msgs/CompressedImage (JPEG, PNG) or sensor_msgs/Image",
        fitting=[
            topic
            for topic in table.of_role("image")
            if is_photograph(
                topic.gathered.first,
                compressed="Compressed" in topic.type_name,
                read=topic.gathered.read,
            )
        ],
    )


def choose_camera_info(
    table: TopicTable, options: RecordingOptions, images: Topic, *, where: object
) -> Topic | None:
    """Choose the camera model of the chosen images: that in their namespace, else the only one.

    Raises:
        UsageError: several fit, or the option names none.
    """
    found = table.of_role("camera_info")
    if options.camera_info_topic is not None:
        found = [table.named(options.camera_info_topic, "camera_info", where=where)]
    elif len(found) > 1:
        found = same_camera(found, images.name) or found
    if len(found) > 1:
        raise ask_which(found, "camera_info", where=where)
    if not found:
        return None
    refuse_faults(found[0], options, where)
    return found[0]


def choose_poses(table: TopicTable, options: RecordingOptions, *, where: object) -> Topic | None:
    """Choose the poses; None when only tf is left to ask.

    Raises:
        UsageError: several fit, or the option names none.
        RecordingError: there are none.
    """
    found = table.of_role("pose")
    if options.pose_topic is not None:
        found = [table.named(options.pose_topic, "pose", where=where)]
    if len(found) > 1:
        raise ask_which(found, "pose", where=where)
    if found:
        refuse_faults(found[0], options, where)
        return found[0] if found[0].role == "pose" else None
    table.refuse_other_encodings("pose", where=where)
    if not table.of_role("tf"):
        raise no_poses(where)
    return None


def no_poses(where: object, why: str = "") -> RecordingError:
    """Compose the error for a recording without poses."""
    error = none_found("pose", _NO_POSES_FIX, where=where)
    return error if not why else RecordingError(f"{error.what}: {why}", where=where, fix=error.fix)


def transforms_gathered(
    table: TopicTable, options: RecordingOptions, *, where: object
) -> tuple[list[GatheredTransforms], list[GatheredTransforms]]:
    """Return what was gathered from tf_static topics, and from the other tf topics.

    Where ``--pose-topic`` names a tf topic, only that one's links may carry the poses.

    Raises:
        RecordingError: a message is damaged, and the user did not ask to go on without it.
    """
    static: list[GatheredTransforms] = []
    moving: list[GatheredTransforms] = []
    for topic in table.of_role("tf"):
        if isinstance(topic.gathered, GatheredTransforms):
            if not options.salvage:
                refuse_faults(topic, options, where)
            is_static = topic.name.endswith("tf_static") and topic.name != options.pose_topic
            (static if is_static else moving).append(topic.gathered)
    return static, moving


def imu_frame(table: TopicTable) -> str:
    """Return the frame of the IMU messages; empty when there are none or several."""
    frames = {
        frame_name(topic.gathered.frame)
        for topic in table.of_role("imu")
        if isinstance(topic.gathered, GatheredFrame)
    }
    return frames.pop() if len(frames) == 1 else ""


def scanner_frame(table: TopicTable, chosen: Topic, body: str) -> str:
    """Return the frame of the raw clouds beside registered ones; empty when that is not clear.

    Args:
        table: the recording's topics.
        chosen: the clouds that are read.
        body: what the poses move; clouds moved into it say nothing of the LiDAR's place.
    """
    frames = {topic.gathered.frame for topic in table.of_role("lidar")}
    frames -= {chosen.gathered.frame, ""}
    if len(frames) > 1:
        frames -= {body}
    return frames.pop() if len(frames) == 1 else ""


def _choose(
    table: TopicTable,
    role: str,
    wanted: str | None,
    options: RecordingOptions,
    *,
    where: object,
    fix: str,
    fitting: list[Topic] | None = None,
) -> Topic:
    if wanted is not None:
        topic = table.named(wanted, role, where=where)
    else:
        found = table.of_role(role) if fitting is None else fitting
        if len(found) > 1:
            raise ask_which(found, role, where=where)
        if not found:
            table.refuse_other_encodings(role, where=where)
            raise none_found(role, fix, where=where)
        topic = found[0]
    refuse_faults(topic, options, where)
    return topic


def damage_of(topics: Iterable[Topic]) -> tuple[dict[str, int], tuple[str, ...]]:
    """Say how many messages of the chosen topics are left out because they are damaged.

    Returns:
        counts for the notes, and warnings.
    """
    damaged = [topic for topic in topics if topic.gathered.faults]
    warnings = tuple(f"{topic.name}: {_in_words(topic)}: left out" for topic in damaged)
    total = sum(topic.gathered.faults for topic in damaged)
    return ({"message-damaged": total} if total else {}), warnings


def refuse_faults(topic: Topic, options: RecordingOptions, where: object) -> None:
    """Refuse a topic with damaged messages; under ``salvage`` one without any whole message.

    Raises:
        RecordingError: it has them.
    """
    gathered: Gathered = topic.gathered
    if not gathered.faults or (options.salvage and gathered.faults < gathered.count):
        return
    raise RecordingError(
        _in_words(topic),
        where=f"{where}: {topic.name}",
        fix="copy or record it again, or choose another topic"
        if options.salvage
        else "copy or record it again, choose another topic, or go on without: --salvage",
    )


def _in_words(topic: Topic) -> str:
    gathered = topic.gathered
    return (
        f"{gathered.faults} of {gathered.count} messages are damaged, they break their own "
        f"layout ({gathered.fault})"
    )
