"""From what a walk gathered to a recording: camera, poses, extrinsics, clocks, warnings."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace

from civil_rgbd.conversion.camera_info import CameraInfo, camera_from_info, parse_camera_info
from civil_rgbd.conversion.cdr import decoding
from civil_rgbd.conversion.clocks import check_overlap
from civil_rgbd.conversion.gathering import GatheredLivox, GatheredPaths, GatheredPoses
from civil_rgbd.conversion.image_folder import ImageFolder
from civil_rgbd.conversion.lidar_only import (
    camera_of_rig,
    images_beside,
    require_body,
    sources_beside,
    trajectory_remarks,
)
from civil_rgbd.conversion.livox import LIVOX_TIME
from civil_rgbd.conversion.mounting import BODIES, Frames, mount
from civil_rgbd.conversion.point_clouds import parse_cloud
from civil_rgbd.conversion.point_time import PointTime, point_time_of
from civil_rgbd.conversion.ros_choice import (
    choose_camera_info,
    choose_images,
    choose_lidar,
    choose_poses,
    imu_frame,
    no_poses,
    transforms_gathered,
)
from civil_rgbd.conversion.ros_poses import (
    Transforms,
    link_that_carries,
    trajectory_from,
    transforms_from,
)
from civil_rgbd.conversion.ros_recording import NO_REACH, Payloads, RosRecording, Stream
from civil_rgbd.conversion.topics import LIVOX_TYPES, Topic, TopicTable
from civil_rgbd.domain.recording import RecordingNotes, RecordingOptions, SourceFile
from civil_rgbd.domain.rig import Rig, RigFile
from civil_rgbd.errors import ImageDecodeError, RecordingError, UsageError
from civil_rgbd.geometry.camera import LensCamera
from civil_rgbd.geometry.trajectory import Trajectory
from civil_rgbd.resources import nearest

_TIMEBASE_TOLERANCE_NS = 1_000_000


@dataclass(frozen=True, slots=True, eq=False)
class Opened:
    """A container that was walked once.

    Attributes:
        table: its topics.
        payloads: fetches its messages.
        sources: its files.
        name: the file's stem.
        where: for errors.
        notes: what the walk found.
    """

    table: TopicTable
    payloads: Payloads
    sources: tuple[SourceFile, ...]
    name: str
    where: object
    notes: RecordingNotes


@dataclass(frozen=True, slots=True, eq=False)
class _Poses:
    trajectory: Trajectory
    parent: str
    child: str
    warnings: tuple[str, ...] = ()


def assemble(opened: Opened, options: RecordingOptions) -> RosRecording:
    """Put a recording together.

    Args:
        opened: the walked container.
        options: what the user says about it.

    Raises:
        UsageError: an option does not fit, or one is needed to choose.
        RecordingError: something that a build needs is missing or contradicts itself.
    """
    table, where = opened.table, opened.where
    _check_pose_of(options)
    rig_file = options.rig
    lidar = choose_lidar(table, options, where=where)
    folder = images_beside(options)
    images = None if folder else choose_images(table, options, where=where)
    camera, camera_frame, camera_warnings = _camera(opened, options, rig_file, images)
    tf = transforms_from(*transforms_gathered(table, options))
    poses = _poses(opened, options, tf, lidar, images)
    frames = Frames(
        map=_map_frame(poses.parent, lidar.gathered.frame, options),
        body=poses.child,
        lidar=lidar.gathered.frame,
        camera=camera_frame,
        imu=imu_frame(table),
        pose_of=options.pose_of,
    )
    mounting = mount(frames, tf.fixed, rig_file, where=where)
    scans = stream_of(lidar)
    point_time = point_time_of_scans(opened, options, scans)
    recording = RosRecording(
        name=opened.name,
        sources=opened.sources + sources_beside(options, folder),
        notes=_notes(opened, rig_file, lidar, point_time, in_map=frames.in_map),
        rig=Rig(
            camera=camera,
            T_body_camera=mounting.T_body_camera,
            T_body_lidar=mounting.T_body_lidar,
            camera_time_offset_s=rig_file.camera_time_offset_s or 0.0,
            body=frames.body_name,
            lidar_name=rig_file.lidar_name or frames.lidar or "unknown",
            camera_name=rig_file.camera_name or camera_frame or "unknown",
        ),
        trajectory=poses.trajectory,
        payloads=opened.payloads,
        scans=scans,
        images=_image_source(folder, images),
        point_time=point_time if lidar.type_name not in LIVOX_TYPES else None,
        point_reach_ns=point_time.reach_ns if point_time else NO_REACH,
        in_map=frames.in_map,
    )
    _check(recording, where)
    remarks = trajectory_remarks(recording.rig, options, recording.scan_stamps_ns)
    remarks = camera_warnings + poses.warnings + remarks + _tf_warnings(tf)
    return _with_warnings(recording, remarks)


def _image_source(folder: ImageFolder | None, images: Topic | None) -> Stream | ImageFolder:
    if images is not None:
        return stream_of(images)
    if folder is None:
        raise RuntimeError("images come from a topic or from a folder")
    return folder


def _map_frame(parent: str, lidar_frame: str, options: RecordingOptions) -> str:
    """Return the frame that poses are relative to; the user may say that the clouds are in it."""
    if options.scans_in is None:
        return parent
    return lidar_frame if options.scans_in == "map" else ""


def stream_of(topic: Topic) -> Stream:
    """Return a chosen topic's messages, ready to be decoded."""
    gathered = topic.gathered
    return Stream(topic.name, topic.type_name, gathered.index(), gathered.read)


def _check_pose_of(options: RecordingOptions) -> None:
    if options.pose_of is not None and options.pose_of not in BODIES:
        raise UsageError(
            f"--pose-of {options.pose_of!r} is no sensor",
            where="--pose-of",
            fix=nearest(options.pose_of, BODIES),
        )


def _camera(
    opened: Opened, options: RecordingOptions, rig_file: RigFile, images: Topic | None
) -> tuple[LensCamera, str, tuple[str, ...]]:
    """Return the camera, its frame, and what is odd about it."""
    frame = images.gathered.frame if images else ""
    if rig_file.camera is not None or images is None:
        return camera_of_rig(options, where=opened.where), frame, ()
    gathered = choose_camera_info(opened.table, options, images, where=opened.where)
    info: CameraInfo | None = None
    if gathered is not None:
        with decoding("CameraInfo", where=opened.where):
            info = parse_camera_info(memoryview(gathered.message), gathered.read)
    if gathered is None or info is None or not info.calibrated:
        opened.table.refuse_other_encodings("camera_info", where=opened.where)
        raise RecordingError(
            "the recording holds no camera model"
            + (": CameraInfo says that the camera is not calibrated (K is zero)" if info else ""),
            where=opened.where,
            fix="give the camera in a rig file (--rig), or record sensor_msgs/CameraInfo",
        )
    rectified = options.rectified or rig_file.rectified or "_rect" in images.name
    warnings = []
    if gathered.differing:
        warnings.append(
            f"{gathered.differing} CameraInfo messages differ from the first, which is used"
        )
    if rectified and not any(info.p):
        warnings.append("the images are rectified but CameraInfo has no P: K is used instead")
    camera = camera_from_info(info, rectified=rectified, where=opened.where)
    return camera, frame or info.frame, tuple(warnings)


def _poses(
    opened: Opened, options: RecordingOptions, tf: Transforms, lidar: Topic, images: Topic | None
) -> _Poses:
    if options.trajectory is not None:
        return _poses_from_file(options, options.trajectory, opened.where)
    topic = choose_poses(opened.table, options, where=opened.where)
    if topic is None:
        return _poses_from_tf(opened, tf, lidar, images)
    where = f"{opened.where}: {topic.name}"
    gathered = topic.gathered
    child = ""
    warnings: tuple[str, ...] = ()
    if isinstance(gathered, GatheredPaths):
        stamps_ns, poses = gathered.path.together()
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
        _refuse_several(gathered.children, "child frames", where)
        child = next(iter(gathered.children), "")
    else:
        raise no_poses(where)
    _refuse_several(gathered.frames, "parent frames", where)
    if not child and options.pose_of is None:
        raise UsageError(
            f"{topic.type_name} does not say what its poses are poses of",
            where=where,
            fix="say so with --pose-of camera, lidar or imu",
        )
    trajectory = trajectory_from(stamps_ns, poses, where=where)
    return _Poses(trajectory, gathered.frame, child, warnings)


def _poses_from_file(options: RecordingOptions, trajectory: Trajectory, where: object) -> _Poses:
    if options.pose_topic is not None:
        raise UsageError(
            "--pose-topic and --trajectory both give poses",
            where=where,
            fix="leave one of them out",
        )
    require_body(options, where=where)
    return _Poses(trajectory, "", "")


def _refuse_several(names: dict[str, int], what: str, where: object) -> None:
    if len(names) > 1:
        raise RecordingError(
            f"the poses have several {what}: {', '.join(map(repr, sorted(names)))}",
            where=where,
            fix="record each trajectory under a topic of its own, or choose another with "
            "--pose-topic",
        )


def _poses_from_tf(opened: Opened, tf: Transforms, lidar: Topic, images: Topic | None) -> _Poses:
    links = link_that_carries(lidar.gathered.frame, tf)
    if images is not None and not links:
        links = link_that_carries(images.gathered.frame, tf)
    moving = ", ".join(f"{link.parent} -> {link.child}" for link in tf.moving) or "none"
    if len(links) != 1:
        raise no_poses(
            opened.where,
            f"tf has {len(links)} moving links that carry the sensors (moving links: {moving})",
        )
    link = links[0]
    where = f"{opened.where}: tf {link.parent} -> {link.child}"
    warning = f"poses are taken from tf: {link.parent} -> {link.child}"
    above = [other for other in tf.moving if other.child == link.parent]
    if above:
        warning += f"; {above[0].parent} -> {link.parent} moves too and is left out"
    trajectory = trajectory_from(link.stamps_ns, link.poses, where=where)
    return _Poses(trajectory, link.parent, link.child, (warning,))


def point_time_of_scans(
    opened: Opened, options: RecordingOptions, scans: Stream
) -> PointTime | None:
    """Settle how point times are read, by the first cloud that has points."""
    if scans.type_name in LIVOX_TYPES:
        return LIVOX_TIME
    where = f"{opened.where}: {scans.topic}"
    types: dict[str, str] = {}
    for index in range(len(scans.index)):
        with decoding(f"point cloud {index}", where=where):
            cloud = parse_cloud(opened.payloads.fetch(*scans.index.place(index)), scans.read)
        types = cloud.types
        if cloud.count:
            break
    return point_time_of(types, options.point_time, where=where)


def _notes(
    opened: Opened, rig_file: RigFile, lidar: Topic, point_time: PointTime | None, *, in_map: bool
) -> RecordingNotes:
    deskew = "per_point" if point_time else "unavailable"
    warnings = list(opened.notes.warnings)
    if in_map:
        deskew = "registered"
    elif point_time is None:
        warnings.append(
            "the clouds have no point times: every point is moved by the pose at its message's "
            "stamp, without de-skewing"
        )
    gathered = lidar.gathered
    if isinstance(gathered, GatheredLivox):
        off_ns = gathered.timebase_off_ns
        if abs(off_ns) > _TIMEBASE_TOLERANCE_NS:
            warnings.append(
                f"Livox timebase is off the header's stamp by up to {off_ns / 1e9:+.6f} s; the "
                "header's stamp is used"
            )
    return replace(opened.notes, deskew=deskew, map_up=rig_file.map_up, warnings=tuple(warnings))


def _tf_warnings(tf: Transforms) -> tuple[str, ...]:
    return (
        *(f"tf_static changes {name}: its last value is used" for name in tf.changed),
        *(f"tf has no proper rotation for {name}: it is left out" for name in tf.broken),
    )


def _check(recording: RosRecording, where: object) -> None:
    check_overlap(
        images_ns=recording.image_stamps_ns + recording.rig.camera_time_offset_ns,
        scans_ns=recording.scan_stamps_ns,
        reach_ns=recording.point_reach_ns,
        poses_ns=recording.trajectory.stamps_ns,
        where=where,
    )
    with suppress(ImageDecodeError):  # one damaged image is the build's to count
        recording.read_image(0)  # a wrong camera or codec shows now, not after an hour


def _with_warnings(recording: RosRecording, more: tuple[str, ...]) -> RosRecording:
    notes = replace(recording.notes, warnings=recording.notes.warnings + more)
    return replace(recording, notes=notes)
