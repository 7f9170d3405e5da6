"""From what a walk gathered to a recording: camera, poses, extrinsics, clocks, warnings."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace

from civil_rgbd.conversion.beside import images_beside, sources_beside, trajectory_remarks
from civil_rgbd.conversion.camera_source import CameraSource, choose_camera
from civil_rgbd.conversion.cdr import SALVAGE_FIX, decoding
from civil_rgbd.conversion.clocks import check_overlap
from civil_rgbd.conversion.gathering import GatheredLivox
from civil_rgbd.conversion.image_folder import ImageFolder
from civil_rgbd.conversion.livox import LIVOX_TIME
from civil_rgbd.conversion.mounting import BODIES, Frames, Mounting, mount
from civil_rgbd.conversion.point_clouds import parse_cloud, scan_from_cloud, with_unit
from civil_rgbd.conversion.point_time import IGNORE, PointTime, point_time_of
from civil_rgbd.conversion.pose_source import Carriers, PoseSource, choose_pose_source
from civil_rgbd.conversion.ros_choice import (
    choose_images,
    choose_lidar,
    damage_of,
    imu_frame,
    scanner_frame,
    transforms_gathered,
)
from civil_rgbd.conversion.ros_poses import Transforms, transforms_from
from civil_rgbd.conversion.ros_recording import NO_REACH, Payloads, RosRecording, Stream
from civil_rgbd.conversion.topics import LIVOX_TYPES, Topic, TopicTable
from civil_rgbd.domain.recording import RecordingNotes, RecordingOptions, SourceFile
from civil_rgbd.domain.rig import Rig, RigFile
from civil_rgbd.errors import ImageDecodeError, RecordingError, UsageError
from civil_rgbd.resources import nearest

_TIMEBASE_TOLERANCE_NS = 1_000_000
_TRIED = 10  # messages that are looked at for one that is whole


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
    camera = choose_camera(table, options, images, where=where)
    tf = transforms_from(*transforms_gathered(table, options, where=where))
    image_frame = images.gathered.frame if images else ""
    carriers = Carriers(tf, lidar.gathered.frame, image_frame)
    poses = choose_pose_source(table, options, carriers, where=where)
    frames = Frames(
        map=_map_frame(poses.parent, lidar.gathered.frame, options),
        body=poses.child,
        lidar=lidar.gathered.frame,
        camera=camera.frame,
        imu=imu_frame(table),
        pose_of=options.pose_of,
        scanner=scanner_frame(table, lidar, poses.child),
    )
    scans = stream_of(lidar)
    point_time = point_time_of_scans(opened, options, scans)
    recording = RosRecording(
        name=opened.name,
        sources=opened.sources + sources_beside(options, folder),
        notes=_notes(opened, rig_file, lidar, point_time, in_map=frames.in_map),
        rig=_rig(camera, frames, rig_file, mount(frames, tf.fixed, rig_file, where=where)),
        trajectory=poses.trajectory,
        payloads=opened.payloads,
        scans=scans,
        images=_image_source(folder, images),
        point_time=point_time if lidar.type_name not in LIVOX_TYPES else None,
        point_reach_ns=point_time.reach_ns if point_time else NO_REACH,
        in_map=frames.in_map,
        salvage=options.salvage,
    )
    recording = _checked(recording, where)
    used = [topic for topic in (lidar, images, camera.topic, poses.topic) if topic]
    damaged, said = damage_of(used + table.of_role("tf"))
    remarks = (
        *camera.warnings,
        *poses.warnings,
        *_override(frames),
        *trajectory_remarks(recording.rig, options, recording.scan_stamps_ns),
        *_tf_warnings(tf),
        *said,
    )
    reading = _reading(recording, camera, poses, point_time)
    recording = _salvaged(recording, damaged | poses.left_out)
    left_out = damaged | poses.left_out | _left_out(tf, folder)
    return _noted(recording, reading, remarks, left_out)


def _salvaged(recording: RosRecording, lost: dict[str, int]) -> RosRecording:
    """Say of single damaged messages, too, that the recording is not whole."""
    if not lost:
        return recording
    said = f"left out as damaged: {', '.join(f'{why} {count}' for why, count in lost.items())}"
    before = recording.notes.salvage
    notes = replace(recording.notes, salvage=f"{before}; {said}" if before else said)
    return replace(recording, notes=notes)


def _noted(
    recording: RosRecording,
    reading: dict[str, str],
    remarks: tuple[str, ...],
    counts: dict[str, int],
) -> RosRecording:
    notes = recording.notes
    notes = replace(notes, reading=reading, warnings=notes.warnings + remarks, counts=counts)
    return replace(recording, notes=notes)


def _rig(camera: CameraSource, frames: Frames, rig_file: RigFile, mounting: Mounting) -> Rig:
    return Rig(
        camera=camera.camera,
        T_body_camera=mounting.T_body_camera,
        T_body_lidar=mounting.T_body_lidar,
        camera_time_offset_s=rig_file.camera_time_offset_s or 0.0,
        body=frames.body_name,
        lidar_name=rig_file.lidar_name or frames.lidar or "unknown",
        camera_name=rig_file.camera_name or camera.frame or "unknown",
    )


def _reading(
    recording: RosRecording,
    camera: CameraSource,
    poses: PoseSource,
    point_time: PointTime | None,
) -> dict[str, str]:
    images = recording.images
    return {
        "lidar_topic": recording.scans.topic,
        "image_topic": images.topic if isinstance(images, Stream) else "files",
        "camera_info_topic": camera.name,
        "pose_topic": poses.name,
        "pose_of": recording.rig.body,
        "point_time": point_time.words if point_time else IGNORE,
        "rectified": "yes" if camera.rectified else "no",
        "registered": "yes" if recording.in_map else "no",
    }


def _override(frames: Frames) -> tuple[str, ...]:
    """Say in words that ``--pose-of`` contradicts the poses' own child frame."""
    sensor = frames.named(frames.pose_of) if frames.pose_of else ""
    if not frames.pose_of or not frames.body or sensor == frames.body:
        return ()
    called = f", whose frame is {sensor!r}" if sensor else ""
    return (
        (
            f"--pose-of {frames.pose_of} overrides the poses' child frame {frames.body!r}: they "
            f"are taken for poses of the {frames.pose_of}{called}"
        ),
    )


def _left_out(tf: Transforms, folder: ImageFolder | None) -> dict[str, int]:
    counts = {
        "tf-link-broken": len(tf.broken),
        "image-file-without-stamp": folder.without_stamp if folder else 0,
    }
    return {name: count for name, count in counts.items() if count}


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


def point_time_of_scans(
    opened: Opened, options: RecordingOptions, scans: Stream
) -> PointTime | None:
    """Settle how point times are read, by the first cloud that has points.

    That cloud is decoded: a wrong unit shows now, not after an hour.

    Raises:
        UsageError: ``--point-time`` does not fit.
        RecordingError: the cloud cannot be used; under ``salvage``, a few others neither.
    """
    if scans.type_name in LIVOX_TYPES:
        return LIVOX_TIME
    where = f"{opened.where}: {scans.topic}"
    faults: list[RecordingError] = []
    types: dict[str, str] = {}
    for index in range(len(scans.index)):
        payload = opened.payloads.fetch(*scans.index.place(index))
        try:
            with decoding(f"point cloud {index}", where=where, fix=SALVAGE_FIX):
                cloud = parse_cloud(payload, scans.read)
                types = cloud.types
                if not cloud.count:
                    continue
                rule = point_time_of(types, options.point_time, where=where)
                rule = with_unit(cloud, rule)
                scan_from_cloud(payload, rule, in_map=False, read=scans.read)
        except RecordingError as error:
            faults.append(error)
            if options.salvage and len(faults) < _TRIED:
                continue
            raise faults[0] from error.__cause__
        if rule is None or rule.unit is not None:
            return rule
    if faults:
        raise faults[0]
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


def _checked(recording: RosRecording, where: object) -> RosRecording:
    check_overlap(
        images_ns=recording.image_stamps_ns + recording.rig.camera_time_offset_ns,
        scans_ns=recording.scan_stamps_ns,
        reach_ns=recording.point_reach_ns,
        poses_ns=recording.trajectory.stamps_ns,
        where=where,
    )
    for index in range(min(_TRIED, len(recording.image_stamps_ns))):
        with suppress(ImageDecodeError):  # a damaged image is the build's to count
            recording.read_image(index)  # a wrong camera or codec shows now, not after an hour
            return replace(recording, camera_fits=True)
    return recording
