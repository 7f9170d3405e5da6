"""What a recording lacks for a build, and the option that supplies it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from civil_rgbd.constants import NS_PER_S
from civil_rgbd.domain.inspection import NOT_OPENED, RecordingSummary, TopicSummary
from civil_rgbd.domain.recording import RecordingOptions
from civil_rgbd.health.beside import beside_findings
from civil_rgbd.health.clocks import clock_findings
from civil_rgbd.health.findings import Finding
from civil_rgbd.health.gaps import gap_findings
from civil_rgbd.health.links import link_findings

_OPTIONS: Final = {
    "lidar": "--lidar-topic",
    "image": "--image-topic",
    "camera_info": "--camera-info-topic",
    "pose": "--pose-topic",
}
_NOUNS: Final = {
    "lidar": "point clouds",
    "image": "images",
    "camera_info": "camera models",
    "pose": "poses",
}
_READ_ENCODINGS: Final = ("cdr", "ros1")


@dataclass(frozen=True, slots=True)
class Chosen:
    """The topics a build would look at: those that an option names, else all that fit.

    Attributes:
        lidars: point clouds.
        images: photographs; depth images only where an option names them.
        cameras: camera models of the chosen images' namespace, else all.
        poses: poses; tf aside.
    """

    lidars: tuple[TopicSummary, ...]
    images: tuple[TopicSummary, ...]
    cameras: tuple[TopicSummary, ...]
    poses: tuple[TopicSummary, ...]


def findings_of(summary: RecordingSummary, options: RecordingOptions) -> tuple[Finding, ...]:
    """List everything that a build misses or should know, errors first.

    Args:
        summary: what the recording holds.
        options: what the user says about it, the same as given to the summary.

    Returns:
        no error exactly when ``open_recording`` accepts the recording with these options.
    """
    chosen = choose(summary, options)
    if summary.converter == NOT_OPENED:
        return tuple(_agreeing([], summary))
    if summary.lidar_only:
        found = [
            *_damage(summary, options),
            *_lidar(chosen.lidars, summary),
            *beside_findings(summary, options, chosen.lidars),
            *clock_findings(chosen.lidars, (), (), options),
            *gap_findings(chosen.lidars, chosen.images, chosen.poses, options),
        ]
    else:
        found = [
            *_damage(summary, options),
            *_lidar(chosen.lidars, summary),
            *(() if options.images else _images(chosen.images, summary)),
            *_camera(chosen, summary, options),
            *_poses(chosen.poses, summary, options),
            *link_findings(summary, options, chosen.lidars, chosen.images, chosen.poses),
            *clock_findings(chosen.lidars, chosen.images, chosen.poses, options),
            *gap_findings(chosen.lidars, chosen.images, chosen.poses, options),
        ]
    found = _agreeing(found, summary)
    return tuple(sorted(found, key=lambda finding: finding.level != "error"))


def choose(summary: RecordingSummary, options: RecordingOptions) -> Chosen:
    """Settle which topics a build would look at."""
    images = () if options.images else _named(summary, "image", options.image_topic)
    if options.image_topic is None:
        images = tuple(t for t in images if t.image is None or t.image.photograph)
    cameras = _named(summary, "camera_info", options.camera_info_topic)
    if len(cameras) > 1 and len(images) == 1:
        space = _namespace(images[0].name)
        cameras = tuple(t for t in cameras if _namespace(t.name) == space) or cameras
    return Chosen(
        lidars=_named(summary, "lidar", options.lidar_topic),
        images=images,
        cameras=cameras,
        poses=() if options.trajectory else _named(summary, "pose", options.pose_topic),
    )


def _named(summary: RecordingSummary, role: str, name: str | None) -> tuple[TopicSummary, ...]:
    return tuple(t for t in summary.of_role(role) if name is None or t.name == name)


def _namespace(topic: str) -> str:
    for transport in ("/compressed", "/ffmpeg", "/theora"):
        topic = topic.removesuffix(transport)
    return topic.rpartition("/")[0]


def _damage(summary: RecordingSummary, options: RecordingOptions) -> Iterator[Finding]:
    if not summary.damage:
        return
    code = "damage-salvaged" if options.salvage else "damaged"
    logged = summary.logged
    span_s = (logged.last_ns - logged.first_ns) / NS_PER_S if logged else 0.0
    for said in summary.damage:
        yield Finding(code, f"{said}; {summary.messages} messages over {span_s:.3f} s are readable")


def _several(role: str, topics: tuple[TopicSummary, ...], *, lidar_only: bool = False) -> Finding:
    names = ", ".join(topic.name for topic in topics)
    if lidar_only:
        return Finding(
            f"several-{role}-topics",
            f"{len(topics)} LiDARs are in the file: {names}",
            fix=f"choose one by its number: {_OPTIONS[role]} {topics[0].name}",
        )
    return Finding(
        f"several-{role.replace('_', '-')}-topics",
        f"{len(topics)} topics carry {_NOUNS[role]}: {names}",
        fix=f"choose one: {_OPTIONS[role]} {topics[0].name}",
    )


def _unread(summary: RecordingSummary, role_types: tuple[str, ...]) -> str:
    others = [
        f"{topic.name} ({topic.encoding})"
        for topic in summary.topics
        if topic.encoding not in _READ_ENCODINGS and topic.type_name.endswith(role_types)
    ]
    return f"; not in ROS's encoding: {', '.join(others)}" if others else ""


def _faults(topics: tuple[TopicSummary, ...]) -> Iterator[Finding]:
    for topic in topics:
        if topic.fault is not None:
            yield Finding("message-broken", f"{topic.name}: {topic.fault}")


def _lidar(topics: tuple[TopicSummary, ...], summary: RecordingSummary) -> Iterator[Finding]:
    if not topics and not summary.lidar_only:
        unread = _unread(summary, ("/PointCloud2", "/CustomMsg"))
        yield Finding("no-point-clouds", f"no topic carries point clouds{unread}")
    if len(topics) > 1:
        yield _several("lidar", topics, lidar_only=summary.lidar_only)
        return
    yield from _faults(topics)
    for topic in topics:
        if len(topic.frames) > 1:
            said = f"{topic.name}: frames {', '.join(map(repr, topic.frames))}"
            yield Finding("several-lidar-frames", said)
        if topic.cloud is None or topic.fault:
            continue
        if topic.cloud.unclear_time:
            yield Finding("point-time-unclear", f"{topic.name}: {topic.cloud.unclear_time}")
        elif topic.cloud.point_time is None:
            yield Finding("no-point-time", f"{topic.name} gives no time for each point")


def _images(topics: tuple[TopicSummary, ...], summary: RecordingSummary) -> Iterator[Finding]:
    if not topics:
        unread = _unread(summary, ("/Image", "/CompressedImage"))
        yield Finding("no-images", f"no topic carries colour or grey images{unread}")
    if len(topics) > 1:
        yield _several("image", topics)
        return
    yield from _faults(topics)
    for topic in topics:
        if topic.image is not None and topic.image.fault is not None:
            broken = "which is not read" in topic.image.fault
            code = "image-encoding" if broken else "first-image-broken"
            yield Finding(code, f"{topic.name}: {topic.image.fault}")


def _camera(
    chosen: Chosen, summary: RecordingSummary, options: RecordingOptions
) -> Iterator[Finding]:
    size = None
    if options.rig.camera is not None:
        pinhole = options.rig.camera.pinhole
        size, whose = (pinhole.width_px, pinhole.height_px), "the rig file's camera"
    elif not chosen.cameras:
        unread = _unread(summary, ("/CameraInfo",))
        yield Finding("no-camera-model", f"no topic carries a camera model (CameraInfo){unread}")
    elif len(chosen.cameras) > 1:
        yield _several("camera_info", chosen.cameras)
    else:
        topic = chosen.cameras[0]
        yield from _faults((topic,))
        if topic.camera is not None and not topic.camera.calibrated:
            yield Finding("camera-uncalibrated", f"{topic.name}: K is zero")
        elif topic.camera is not None:
            size, whose = (topic.camera.width_px, topic.camera.height_px), topic.name
    if size is None or len(chosen.images) != 1:
        return
    image = chosen.images[0].image
    if image is not None and image.width_px and (image.width_px, image.height_px) != size:
        yield Finding(
            "camera-size",
            f"images have {image.width_px}x{image.height_px} pixels, {whose} says "
            f"{size[0]}x{size[1]}",
        )


def _poses(
    topics: tuple[TopicSummary, ...], summary: RecordingSummary, options: RecordingOptions
) -> Iterator[Finding]:
    if options.trajectory is not None:
        if options.pose_of is None and not any("body" in pair for pair in options.rig.extrinsics):
            yield Finding(
                "pose-of-unknown", "the trajectory file does not say what it is a pose of"
            )
        return
    if len(topics) > 1:
        yield _several("pose", topics)
        return
    yield from _faults(topics)
    for topic in topics:
        if len(topic.children) > 1:
            said = f"{topic.name}: child frames {', '.join(map(repr, topic.children))}"
            yield Finding("several-pose-frames", said)
        elif not any(topic.children) and options.pose_of is None:
            yield Finding("pose-of-unknown", f"{topic.name} does not say what it is a pose of")
    if not topics and not summary.moving_links:
        imu = summary.of_role("imu")
        said = f"; it has an IMU ({imu[0].name})" if imu else "; it has no IMU either"
        yield Finding("no-poses", f"no topic carries poses, and nothing moves in tf{said}")


def _agreeing(found: list[Finding], summary: RecordingSummary) -> list[Finding]:
    """Let what a build really says decide: its refusal is never left out."""
    if summary.refusal is None:
        return [finding for finding in found if finding.level != "error"]
    if any(finding.level == "error" for finding in found):
        return found
    refusal = summary.refusal
    return [*found, Finding("build-refuses", refusal.what, fix=refusal.fix)]
