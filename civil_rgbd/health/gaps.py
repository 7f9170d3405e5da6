"""When a sensor is silent: in the middle of a recording, or while another one still measures."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from typing import Final

from civil_rgbd.constants import NS_PER_S
from civil_rgbd.domain.folders import TIME_LISTS
from civil_rgbd.domain.inspection import Timing, TopicSummary, timing_of
from civil_rgbd.domain.recording import RecordingOptions
from civil_rgbd.domain.stamps import read_stamp_list
from civil_rgbd.errors import RecordingError
from civil_rgbd.health.findings import Finding

_GAP_NS: Final = NS_PER_S // 4
"""The gap over which a build interpolates no pose by default (poses.max_gap_s)."""


def gap_findings(
    lidars: tuple[TopicSummary, ...],
    images: tuple[TopicSummary, ...],
    poses: tuple[TopicSummary, ...],
    options: RecordingOptions,
) -> Iterator[Finding]:
    """Name silences of the chosen sensors; where several fit, nothing is said yet.

    Args:
        lidars: the point clouds.
        images: the images.
        poses: the poses.
        options: images that lie beside the recording, and the camera's time offset.
    """
    for code, topics in (("cloud-gap", lidars), ("image-gap", images), ("pose-gap", poses)):
        if len(topics) == 1:
            yield from _inside(code, topics[0])
    if len(lidars) == 1 and lidars[0].stamped is not None:
        yield from _ends(lidars[0], lidars[0].stamped, images, options)


def _inside(code: str, topic: TopicSummary) -> Iterator[Finding]:
    timing = topic.stamped
    if timing is None:
        return
    if timing.gaps and timing.longest_gap_ns > _GAP_NS:
        many = f"{timing.gaps} gaps" if timing.gaps > 1 else "1 gap"
        at_s = (timing.longest_gap_at_ns - timing.first_ns) / NS_PER_S
        yield Finding(
            code,
            f"{topic.name}: {many} of more than three periods, the longest "
            f"{timing.longest_gap_ns / NS_PER_S:.2f} s, {at_s:.1f} s after its start",
        )
    if timing.backward:
        yield Finding(
            "stamps-backward",
            f"{topic.name}: {timing.backward} messages are stamped earlier than the one before",
        )


def _ends(
    lidar: TopicSummary,
    scans: Timing,
    images: tuple[TopicSummary, ...],
    options: RecordingOptions,
) -> Iterator[Finding]:
    """Compare where the point clouds and the images begin and end, on the LiDAR's clock."""
    taken, name = _taken(images, options)
    if taken is None:
        return
    offset_ns = round((options.rig.camera_time_offset_s or 0.0) * NS_PER_S)
    first_ns, last_ns = taken.first_ns + offset_ns, taken.last_ns + offset_ns
    ended_ns = scans.last_ns + scans.period_ns  # the points of a scan come after its stamp
    if last_ns < scans.first_ns or ended_ns < first_ns:
        return  # another clock: that is said elsewhere
    for code, silence_ns, said in (
        ("cloud-gap", last_ns - ended_ns, f"{lidar.name} ends {{:.2f}} s before {name} do"),
        ("cloud-gap", scans.first_ns - first_ns, f"{lidar.name} begins {{:.2f}} s after {name} do"),
        ("image-gap", ended_ns - last_ns, f"{name} end {{:.2f}} s before {lidar.name} does"),
        ("image-gap", first_ns - scans.first_ns, f"{name} begin {{:.2f}} s after {lidar.name}"),
    ):
        # Slow cameras begin and end within a period of theirs as a matter of course.
        if silence_ns > _GAP_NS + (taken.period_ns if code == "image-gap" else 0):
            yield Finding(code, said.format(silence_ns / NS_PER_S))


def _taken(
    images: tuple[TopicSummary, ...], options: RecordingOptions
) -> tuple[Timing | None, str]:
    """Return when the images were taken, camera clock, and what they are called."""
    if len(images) == 1:
        return images[0].stamped, f"the images of {images[0].name}"
    if options.images is None:
        return None, ""
    inside = [options.images / name for name in TIME_LISTS]
    times = options.image_times or next((path for path in inside if path.is_file()), None)
    with suppress(RecordingError):  # what is wrong with the list is said where it is needed
        return timing_of(read_stamp_list(times).stamps_ns) if times else None, "the images"
    return None, ""
