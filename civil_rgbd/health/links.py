"""Is there a way from the poses' body to LiDAR and camera? By the names of tf and rig."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from civil_rgbd.domain.inspection import RecordingSummary, TopicSummary
from civil_rgbd.domain.recording import RecordingOptions
from civil_rgbd.health.findings import Finding


def link_findings(
    summary: RecordingSummary,
    options: RecordingOptions,
    lidars: tuple[TopicSummary, ...],
    images: tuple[TopicSummary, ...],
    poses: tuple[TopicSummary, ...],
) -> Iterator[Finding]:
    """Name the sensors that nothing links to the body of the poses.

    Where poses are missing, camera and LiDAR are at least to be linked with each other.
    """
    if len(lidars) != 1 or len(images) != 1 or len(poses) > 1:
        return  # which frames are meant is not settled yet
    frames = {"lidar": _frame(lidars[0]), "camera": _frame(images[0])}
    imu = {_frame(topic) for topic in summary.of_role("imu")}
    frames["imu"] = next(iter(imu)) if len(imu) == 1 else ""
    if frames["lidar"] and frames["lidar"] == _parent(summary, poses):
        frames["lidar"] = ""  # the clouds are in the map: only the camera needs a link
    body = _body(summary, options, frames, poses)
    links = [*_tf_links(summary, frames, body), *options.rig.extrinsics]
    start = "body" if body else "lidar"
    if body in frames:
        links.append(("body", body))
    reached = reached_from(start, links)
    known = ", ".join(sorted({name for link in summary.fixed_links for name in link})) or "none"
    if "lidar" not in reached and frames["lidar"]:
        yield Finding(
            "no-lidar-link",
            f"nothing links the clouds' frame {frames['lidar']!r} to the poses' body "
            f"{_said(body)}; frames of tf: {known}",
        )
    if "camera" not in reached:
        yield Finding(
            "no-camera-link",
            f"nothing links the camera's frame {frames['camera']!r} to the "
            + ("LiDAR" if not body else f"poses' body {_said(body)}")
            + f"; frames of tf: {known}",
        )


def _frame(topic: TopicSummary) -> str:
    return topic.frames[0] if topic.frames else ""


def _parent(summary: RecordingSummary, poses: tuple[TopicSummary, ...]) -> str:
    if poses:
        return _frame(poses[0])
    return summary.moving_links[0][0] if len(summary.moving_links) == 1 else ""


def _body(
    summary: RecordingSummary,
    options: RecordingOptions,
    frames: dict[str, str],
    poses: tuple[TopicSummary, ...],
) -> str:
    """Return a role, or ``frame NAME``; empty when nothing says what the poses move."""
    if options.pose_of:
        return options.pose_of
    child = ""
    if poses and poses[0].children:
        child = poses[0].children[0]
    elif not poses and options.trajectory is None and len(summary.moving_links) == 1:
        child = summary.moving_links[0][1]
    for role in ("lidar", "camera", "imu"):
        if child and frames[role] == child:
            return role
    return f"frame {child}" if child else ""


def _said(body: str) -> str:
    return repr(body.removeprefix("frame "))


def _tf_links(
    summary: RecordingSummary, frames: dict[str, str], body: str
) -> Iterator[tuple[str, str]]:
    """Links of tf, sensors by their roles, other frames by ``frame NAME``."""
    roles = {name: role for role, name in reversed(frames.items()) if name}
    if body.startswith("frame "):
        roles.setdefault(body.removeprefix("frame "), "body")
    for parent, child in summary.fixed_links:
        yield roles.get(parent, f"frame {parent}"), roles.get(child, f"frame {child}")
    for role, name in frames.items():
        if name and roles[name] != role:
            yield role, roles[name]  # two sensors under one frame id


def reached_from(start: str, links: Iterable[tuple[str, str]]) -> set[str]:
    """Return every sensor that a chain of links connects with one of them, itself included."""
    every, reached, grown = list(links), {start}, True
    while grown:
        size = len(reached)
        reached |= {other for a, b in every for here, other in ((a, b), (b, a)) if here in reached}
        grown = len(reached) > size
    return reached
