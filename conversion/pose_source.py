"""Where a recording's trajectory comes from: a file, a topic of poses, or a moving link of tf."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.conversion.beside import body_is_said, require_body
from civil_rgbd.conversion.gathering import GatheredPaths, GatheredPoses
from civil_rgbd.conversion.ros_choice import choose_poses, mostly, nearly_all_alike, no_poses
from civil_rgbd.conversion.ros_poses import (
    Transforms,
    link_that_carries,
    trajectory_from,
    without_broken,
)
from civil_rgbd.conversion.topics import Topic, TopicTable
from civil_rgbd.domain.recording import RecordingOptions
from civil_rgbd.domain.stamps import signed_seconds
from civil_rgbd.errors import RecordingError, UsageError
from civil_rgbd.geometry.trajectory import Trajectory


@dataclass(frozen=True, slots=True, eq=False)
class Carriers:
    """What tf can tell of poses.

    Attributes:
        tf: all of it.
        lidar: frame of the point clouds.
        camera: frame of the images; empty for images beside the recording.
    """

    tf: Transforms
    lidar: str
    camera: str


@dataclass(frozen=True, slots=True, eq=False)
class PoseSource:
    """The chosen poses.

    Attributes:
        trajectory: parent to child.
        parent: frame that they are relative to; empty when not named.
        child: frame that they move; empty when not named.
        name: ``file``, a topic, or ``tf: parent -> child``.
        warnings: what is odd about them.
        topic: whose messages they are; None for those of a file and of tf.
        left_out: poses that are damaged, by reason; only where the user asked to go on without.
    """

    trajectory: Trajectory
    parent: str
    child: str
    name: str
    warnings: tuple[str, ...] = ()
    topic: Topic | None = None
    left_out: dict[str, int] = field(default_factory=dict)


def choose_pose_source(
    table: TopicTable, options: RecordingOptions, carriers: Carriers, *, where: object
) -> PoseSource:
    """Find the trajectory: from a file, else from a topic of poses, else from tf.

    Args:
        table: the recording's topics.
        options: what the user says.
        carriers: what tf says, and of which sensors.
        where: the file, for errors.

    Raises:
        UsageError: several fit, or nothing says what the poses are poses of.
        RecordingError: there are no poses, or they contradict themselves.
    """
    if options.trajectory is not None:
        return _poses_from_file(options, options.trajectory, where)
    topic = choose_poses(table, options, where=where)
    if topic is None:
        return _moved(_poses_from_tf(carriers, options, where), options)
    return _moved(_poses_from_topic(topic, options, where), options)


def _moved(poses: PoseSource, options: RecordingOptions) -> PoseSource:
    """Bring recorded poses to the LiDAR's clock, by what the user says."""
    offset_ns, path = options.pose_offset_ns, poses.trajectory
    if not offset_ns:
        return poses
    path = Trajectory(path.stamps_ns + offset_ns, path.translations_m, path.quaternions_xyzw)
    said = f"the stamps of the poses of {poses.name} are moved by {signed_seconds(offset_ns)} s"
    return replace(poses, trajectory=path, warnings=(*poses.warnings, said))


def _poses_from_topic(topic: Topic, options: RecordingOptions, where: object) -> PoseSource:
    where = f"{where}: {topic.name}"
    gathered = topic.gathered
    child, unordered = "", 0
    warnings: tuple[str, ...] = ()
    if isinstance(gathered, GatheredPaths):
        stamps_ns, poses = gathered.path.together(salvage=options.salvage)
        unordered = gathered.path.unordered
        if not len(stamps_ns):
            raise no_poses(where, "every Path is empty")
        if earlier := gathered.path.from_earlier_messages:
            warnings = (
                (
                    f"{earlier} of {len(stamps_ns)} poses come from earlier Paths than the last "
                    "one; where several Paths give a stamp, the latest one's pose is taken"
                ),
            )
    elif isinstance(gathered, GatheredPoses):
        stamps_ns, poses = gathered.poses()
        _refuse_several(gathered.children, "child frames", options, where)
        child = mostly(gathered.children)
    else:
        raise no_poses(where)
    _refuse_several(gathered.frames, "parent frames", options, where)
    if not child and options.pose_of is None:
        raise UsageError(
            f"{topic.type_name} does not say what its poses are poses of",
            where=where,
            fix="say so with --pose-of camera, lidar or imu",
        )
    trajectory, left_out = _checked(stamps_ns, poses, options, where)
    if unordered:
        left_out["path-unordered"] = unordered
    warnings += _said(left_out)
    return PoseSource(trajectory, gathered.frame, child, topic.name, warnings, topic, left_out)


def _checked(
    stamps_ns: NDArray[np.int64],
    poses: NDArray[np.float64],
    options: RecordingOptions,
    where: object,
) -> tuple[Trajectory, dict[str, int]]:
    """Make a trajectory of poses; under ``salvage`` of those that are whole."""
    left_out: dict[str, int] = {}
    if options.salvage:
        stamps_ns, poses, left_out = without_broken(stamps_ns, poses)
    return trajectory_from(stamps_ns, poses, where=where), left_out


def _said(left_out: dict[str, int]) -> tuple[str, ...]:
    if not left_out:
        return ()
    return (
        f"damaged poses are left out: {', '.join(f'{why} {n}' for why, n in left_out.items())}",
    )


def _poses_from_file(
    options: RecordingOptions, trajectory: Trajectory, where: object
) -> PoseSource:
    if options.pose_topic is not None:
        raise UsageError(
            "--pose-topic and --trajectory both give poses",
            where=where,
            fix="leave one of them out",
        )
    require_body(options, where=where)
    return PoseSource(trajectory, "", "", "file")


def _refuse_several(
    names: dict[str, int], what: str, options: RecordingOptions, where: object
) -> None:
    if len(names) > 1 and not (options.salvage and nearly_all_alike(names)):
        raise RecordingError(
            f"the poses have several {what}: {', '.join(map(repr, sorted(names)))}",
            where=where,
            fix="record each trajectory under a topic of its own, or choose another with "
            "--pose-topic",
        )


def _poses_from_tf(carriers: Carriers, options: RecordingOptions, where: object) -> PoseSource:
    tf = carriers.tf
    links = link_that_carries(carriers.lidar, tf)
    if carriers.camera and not links:
        links = link_that_carries(carriers.camera, tf)
    if not links and len(tf.moving) == 1 and body_is_said(options):
        links = [*tf.moving]  # R3LIVE and FAST-LIVO2 publish nothing but world -> aft_mapped
    moving = ", ".join(f"{link.parent} -> {link.child}" for link in tf.moving) or "none"
    if len(links) != 1:
        said = f"tf has {len(links)} moving links that carry the sensors (moving links: {moving})"
        if not links and len(tf.moving) == 1:
            raise RecordingError(
                f"nothing says what the poses are poses of: {said}",
                where=where,
                fix="say so with --pose-of camera, lidar or imu; or give T_body_lidar and "
                "T_body_camera in a rig file (--rig), or other poses with --trajectory",
            )
        raise no_poses(where, said)
    link = links[0]
    name = f"tf: {link.parent} -> {link.child}"
    warning = f"poses are taken from {name}"
    above = [other for other in tf.moving if other.child == link.parent]
    if above:
        warning += f"; {above[0].parent} -> {link.parent} moves too and is left out"
    where = f"{where}: {name}"
    trajectory, left_out = _checked(link.stamps_ns, link.poses, options, where)
    warnings = (warning, *_said(left_out))
    return PoseSource(trajectory, link.parent, link.child, name, warnings, left_out=left_out)
