"""A summary of sources that cannot be looked at without opening them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from civil_rgbd.domain.inspection import (
    NOT_OPENED,
    CameraFacts,
    CloudFacts,
    ImageFacts,
    RecordingSummary,
    Refusal,
    TopicSummary,
    timing_of,
)
from civil_rgbd.domain.recording import Recording
from civil_rgbd.errors import CivilRgbdError


def summarise_opened(open_it: Callable[[], Recording], *, location: str) -> RecordingSummary:
    """Open a source and say what it holds; where it cannot be opened, why.

    Args:
        open_it: opens it.
        location: of the source.

    Raises:
        CivilRgbdError: it is not even there.
    """
    name = Path(location).name
    try:
        recording = open_it()
    except CivilRgbdError as error:
        if not Path(location).exists():
            raise
        refusal = Refusal(error.what, error.where, error.fix)
        return RecordingSummary(name, NOT_OPENED, 0, 0, None, (), refusal=refusal)
    topics = (_scans(recording), _images(recording), _camera(recording), _poses(recording))
    sources = recording.sources
    return RecordingSummary(
        name=name,
        converter=sources[0].converter if sources else "opened",
        size_bytes=sum(source.size_bytes for source in sources),
        messages=sum(topic.messages for topic in topics),
        logged=timing_of(
            np.sort(np.concatenate([recording.scan_stamps_ns, recording.image_stamps_ns]))
        ),
        topics=topics,
        T_lidar_camera=recording.rig.T_lidar_camera,
        warnings=recording.notes.warnings,
    )


def _scans(recording: Recording) -> TopicSummary:
    scan = recording.read_scan(0)
    own = "each point has its own" if scan.point_stamps_ns is not None else None
    fields = tuple((axis, scan.points.dtype.str[1:]) for axis in "xyz")
    return TopicSummary(
        "scans",
        "scan",
        "lidar",
        messages=len(recording.scan_stamps_ns),
        stamped=timing_of(recording.scan_stamps_ns),
        cloud=CloudFacts(len(scan.points), fields, own),
    )


def _images(recording: Recording) -> TopicSummary:
    pinhole = recording.rig.camera.pinhole
    return TopicSummary(
        "images",
        "image",
        "image",
        messages=len(recording.image_stamps_ns),
        stamped=timing_of(recording.image_stamps_ns),
        image=ImageFacts("image", width_px=pinhole.width_px, height_px=pinhole.height_px),
    )


def _camera(recording: Recording) -> TopicSummary:
    camera = recording.rig.camera
    pinhole = camera.pinhole
    facts = CameraFacts(pinhole.width_px, pinhole.height_px, camera.lens, calibrated=True)
    return TopicSummary("camera", "camera", "camera_info", messages=1, camera=facts)


def _poses(recording: Recording) -> TopicSummary:
    stamps_ns = recording.trajectory.stamps_ns
    return TopicSummary(
        "poses",
        "trajectory",
        "pose",
        messages=len(stamps_ns),
        stamped=timing_of(stamps_ns),
        frames=("map",),
        children=(recording.rig.body,),
    )
