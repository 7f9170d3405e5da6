"""What an LVX file holds, before anybody asks whether a build can use it."""

from __future__ import annotations

from typing import Final

import numpy as np

from civil_rgbd.conversion.lvx_file import Device
from civil_rgbd.conversion.lvx_scans import scans_of
from civil_rgbd.conversion.lvx_walk import Walk, point_types
from civil_rgbd.domain.inspection import CloudFacts, RecordingSummary, TopicSummary, timing_of
from civil_rgbd.errors import RecordingError

_TRIED: Final = 10  # frames that are looked at for one that can be decoded


def summarise_walk(walk: Walk) -> RecordingSummary:
    """Say what a walk over a file saw.

    Args:
        walk: over the file.

    Returns:
        each LiDAR and each IMU as a topic, by its serial number.
    """
    topics = [_lidar(walk, device) for device in walk.with_points]
    for device in walk.header.devices:
        stamps_ns = np.array(walk.seen[device.key].imu_ns, dtype=np.int64)
        if len(stamps_ns):
            name = f"{device.code or device.name} IMU"
            timing = timing_of(stamps_ns)
            topics.append(TopicSummary(name, "IMU", "imu", len(stamps_ns), "lvx", stamped=timing))
    stamps = [walk.seen[device.key].stamps_ns for device in walk.with_points]
    remarks = [f"{count} {name.replace('-', ' ')}" for name, count in walk.counts.items()]
    return RecordingSummary(
        name=walk.path.name,
        converter="lvx",
        size_bytes=walk.path.stat().st_size,
        messages=sum(topic.messages for topic in topics),
        logged=timing_of(np.concatenate([*stamps, np.zeros(0, dtype=np.int64)])),
        topics=tuple(topics),
        damage=walk.damage,
        remarks=tuple(remarks),
        lidar_only=True,
    )


def _lidar(walk: Walk, device: Device) -> TopicSummary:
    seen = walk.seen[device.key]
    return TopicSummary(
        device.code or device.name,
        device.name,
        "lidar",
        messages=len(seen.places),
        encoding="lvx",
        stamped=timing_of(seen.stamps_ns),
        frames=("lidar",),
        cloud=_cloud(walk, device),
    )


def _cloud(walk: Walk, device: Device) -> CloudFacts | None:
    """Look at the first frame that can be decoded."""
    seen = walk.seen[device.key]
    types = point_types(second=walk.header.second)
    kind = types[min(seen.kinds)]
    fields = [(name, kind.item[name].str[1:]) for name in kind.item.names or ()]
    if kind.spherical and "theta" not in dict(fields):
        fields += [("theta", "u2"), ("phi", "u2")]  # once for all returns of a beam
    scans = scans_of(walk, device, range(len(seen.places)))
    for index in range(min(_TRIED, len(seen.places))):
        try:
            count = len(scans.read(index).points)
        except RecordingError:
            continue
        step_us = scans.interval_ns / 1000
        when = f"of the packets, {step_us:.3f} us from point to point"
        return CloudFacts(count, tuple(fields), when)
    return None
