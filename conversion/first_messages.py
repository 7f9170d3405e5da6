"""What the first message of a topic shows: point fields, picture size, camera model."""

from __future__ import annotations

from typing import Final

from civil_rgbd.conversion.camera_info import parse_camera_info
from civil_rgbd.conversion.cdr import CdrError
from civil_rgbd.conversion.gathering import GatheredCameraInfo
from civil_rgbd.conversion.livox import LIVOX_TIME, scan_from_livox
from civil_rgbd.conversion.point_clouds import parse_cloud
from civil_rgbd.conversion.point_time import point_time_of
from civil_rgbd.conversion.ros_assembly import Opened
from civil_rgbd.conversion.ros_images import (
    is_photograph,
    read_head,
    rgb_from_compressed,
    rgb_from_image,
)
from civil_rgbd.conversion.topics import LIVOX_TYPES, Topic
from civil_rgbd.domain.inspection import CameraFacts, CloudFacts, ImageFacts
from civil_rgbd.domain.recording import RecordingOptions
from civil_rgbd.errors import CivilRgbdError, RecordingError

_LIVOX_FIELDS: Final[tuple[tuple[str, str], ...]] = (
    ("offset_time", "u4"),
    ("x", "f4"),
    ("y", "f4"),
    ("z", "f4"),
    ("reflectivity", "u1"),
    ("tag", "u1"),
    ("line", "u1"),
)


def cloud_facts(topic: Topic, opened: Opened, options: RecordingOptions) -> CloudFacts | None:
    """Look at the first cloud that has points; None when none can be read."""
    index, read = topic.gathered.index(), topic.gathered.read
    for at in range(len(index)):
        try:
            payload = opened.payloads.fetch(*index.place(at))
            if topic.type_name in LIVOX_TYPES:
                count, fields = (
                    len(scan_from_livox(payload, in_map=False, read=read).points),
                    _LIVOX_FIELDS,
                )
            else:
                cloud = parse_cloud(payload, read)
                count, fields = cloud.count, tuple(cloud.types.items())
        except (CdrError, RecordingError):
            return None
        if count:
            return _with_time(count, fields, topic, options)
    return None


def _with_time(
    count: int, fields: tuple[tuple[str, str], ...], topic: Topic, options: RecordingOptions
) -> CloudFacts:
    if topic.type_name in LIVOX_TYPES:
        return CloudFacts(count, fields, LIVOX_TIME.meaning)
    try:
        rule = point_time_of(dict(fields), options.point_time, where=topic.name)
    except CivilRgbdError as error:
        return CloudFacts(count, fields, unclear_time=error.what)
    return CloudFacts(count, fields, rule.meaning if rule else None)


def image_facts(topic: Topic, opened: Opened) -> ImageFacts | None:
    """Decode the first image; None when it does not even say its encoding."""
    compressed = "Compressed" in topic.type_name
    start, read = topic.gathered.first, topic.gathered.read
    try:
        encoding = read_head(start, compressed=compressed, read=read).encoding
    except CdrError:
        return None
    if not is_photograph(start, compressed=compressed, read=read):
        return ImageFacts(encoding, photograph=False)
    try:
        payload = opened.payloads.fetch(*topic.gathered.index().place(0))
        decode = rgb_from_compressed if compressed else rgb_from_image
        height_px, width_px = decode(payload, where=topic.name, read=read).shape[:2]
    except CivilRgbdError as error:
        return ImageFacts(encoding, fault=error.what)
    except CdrError as error:
        return ImageFacts(encoding, fault=str(error))
    return ImageFacts(encoding, width_px=width_px, height_px=height_px)


def camera_facts(gathered: GatheredCameraInfo) -> CameraFacts | None:
    """Read the first camera model; None when there is none that can be read."""
    if not gathered.message:
        return None
    try:
        info = parse_camera_info(memoryview(gathered.message), gathered.read)
    except CdrError:
        return None
    return CameraFacts(info.width_px, info.height_px, info.model, info.calibrated)
