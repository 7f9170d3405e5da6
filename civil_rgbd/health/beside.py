"""What a source with LiDARs alone lacks for a build: all of it comes from files beside it."""

from __future__ import annotations

from collections.abc import Iterator

from civil_rgbd.domain.inspection import RecordingSummary, TopicSummary
from civil_rgbd.domain.recording import RecordingOptions
from civil_rgbd.health.findings import Finding
from civil_rgbd.health.links import reached_from


def beside_findings(
    summary: RecordingSummary, options: RecordingOptions, lidars: tuple[TopicSummary, ...]
) -> Iterator[Finding]:
    """Name what is missing beside the scans.

    Args:
        summary: of a source that is ``lidar_only``.
        options: what the user says.
        lidars: those that may be meant.
    """
    for topic in lidars:
        if topic.unstamped is not None:
            yield Finding("no-scan-times", f"{topic.name}: {topic.unstamped}")
        if not topic.frames:
            yield Finding("scans-in-unknown", "files do not say which frame their points are in")
    if options.trajectory is None:
        imu = summary.of_role("imu")
        said = f"; it has an IMU ({imu[0].name})" if imu else "; it has no IMU either"
        yield Finding("no-poses", f"such a source holds no poses{said}")
    elif not _body_is_known(options):
        yield Finding("pose-of-unknown", "the trajectory file does not say what it is a pose of")
    if options.images is None:
        yield Finding("no-images", "such a source holds no images")
    if options.rig.camera is None:
        yield Finding("no-camera-model", "such a source holds no camera model")
    yield from _links(options, in_map=any("map" in topic.frames for topic in lidars))


def _body_is_known(options: RecordingOptions) -> bool:
    return options.pose_of is not None or any("body" in pair for pair in options.rig.extrinsics)


def _links(options: RecordingOptions, *, in_map: bool) -> Iterator[Finding]:
    """Is there a way from the body to camera and LiDAR? Points in the map need none to these."""
    links = [*options.rig.extrinsics]
    known = _body_is_known(options)
    if options.pose_of and not reached_from("body", links) & {"lidar", "camera"}:
        links.append(("body", options.pose_of))
    if in_map and not known:
        return  # whose poses they are is to be said first
    reached = reached_from("body" if known else "lidar", links)
    whose = f"the poses' body ({options.pose_of or 'body'})" if known else "the LiDAR"
    if known and not in_map and "lidar" not in reached:
        yield Finding("no-lidar-link", f"nothing links the LiDAR to {whose}")
    if "camera" not in reached:
        yield Finding("no-camera-link", f"nothing links the camera to {whose}")
