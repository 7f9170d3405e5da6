"""A simulated scan as a recorder on the rig would write it: raw MCAP, or a ROS 1 bag."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from itertools import islice
from pathlib import Path
from typing import IO, Final

import numpy as np

from civil_rgbd.errors import OutputError, UsageError
from civil_rgbd.simulator.bag_file import write_bag
from civil_rgbd.simulator.camera import lens_rays, raw_camera, simulate_jpeg
from civil_rgbd.simulator.catalogue import painter_for
from civil_rgbd.simulator.drift import recorded_imu_poses
from civil_rgbd.simulator.encodings import CdrMessage, Encoding, Ros1Message
from civil_rgbd.simulator.imu import recorded_imu
from civil_rgbd.simulator.lidar import MESSAGE_NS, scan_stamps_ns, simulate_scan
from civil_rgbd.simulator.mcap_file import write_mcap
from civil_rgbd.simulator.messages import (
    camera_info_message,
    image_message,
    imu_message,
    livox_message,
    odometry_message,
    origin_message,
    tf_message,
)
from civil_rgbd.simulator.recording import (
    CAMERA_FRAME,
    IMU_FRAME,
    LIDAR_FRAME,
    MAP_FRAME,
    stated_image_stamps_ns,
)
from civil_rgbd.simulator.scene import THREADS
from civil_rgbd.simulator.spec import ScanSpec
from civil_rgbd.simulator.walk import (
    START_NS,
    T_IMU_LIDAR,
    image_instants_ns,
    stated_mount,
)
from civil_rgbd.storage.whole_files import whole_file, writing

Message = tuple[int, str, bytes]
Progress = Callable[[int, int], object]
New = Callable[[], Encoding]
"""Makes an empty message."""
_Writer = Callable[[IO[bytes], Mapping[str, str], Iterable[Message]], None]

ORIGIN: Final = "/civil_rgbd/origin"
TRANSFORMS: Final = "/tf_static"
ODOMETRY: Final = "/odometry"
IMU: Final = "/livox/imu"
LIDAR: Final = "/livox/lidar"
CAMERA_INFO: Final = "/camera/color/camera_info"
IMAGE: Final = "/camera/color/image_raw/compressed"

TOPICS: Final = {
    ORIGIN: "std_msgs/Header",
    TRANSFORMS: "tf2_msgs/TFMessage",
    ODOMETRY: "nav_msgs/Odometry",
    IMU: "sensor_msgs/Imu",
    LIDAR: "livox_ros_driver2/CustomMsg",
    CAMERA_INFO: "sensor_msgs/CameraInfo",
    IMAGE: "sensor_msgs/CompressedImage",
}

LEFT_OUT: Final = {"poses": ODOMETRY, "extrinsics": TRANSFORMS}
"""What recordings in the field often lack, and the topic that would say it."""

_WRITERS: Final[dict[str, tuple[_Writer, New]]] = {
    ".mcap": (write_mcap, CdrMessage),
    ".bag": (write_bag, Ros1Message),
}
_IMAGE_DELAY_NS: Final = 12_000_000  # from exposure to the recorder's disk


def write_recording(
    path: Path,
    spec: ScanSpec,
    *,
    without: Collection[str] = (),
    overwrite: bool = False,
    progress: Progress | None = None,
) -> None:
    """Simulate a scan and write it; the file is whole or absent.

    Args:
        path: the file, ``.mcap`` (ROS 2) or ``.bag`` (ROS 1); its folder is made if it is missing.
        spec: the scan. Equal specs give equal bytes.
        without: names of :data:`LEFT_OUT` that the recording is not to say.
        overwrite: replace a file that is there.
        progress: called with (images newly done, images in all).

    Raises:
        UsageError: the suffix is another.
        OutputError: the file is there already, or cannot be written.
    """
    if path.suffix.lower() not in _WRITERS:
        raise UsageError(
            f"{path.name!r} ends in neither .mcap nor .bag",
            where=path,
            fix=f"write to {path.with_suffix('.mcap').name!r}",
        )
    if path.exists() and not overwrite:
        raise OutputError(
            f"{path.name} is there already",
            where=path,
            fix="choose another name, or give --overwrite",
        )
    with writing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
    with whole_file(path) as scratch, scratch.open("wb") as stream:
        write, encoding = _WRITERS[path.suffix.lower()]
        left_out = {LEFT_OUT[name] for name in without}
        topics = {topic: kind for topic, kind in TOPICS.items() if topic not in left_out}
        messages = _messages(spec, encoding, progress or (lambda *_: None))
        write(stream, topics, (message for message in messages if message[1] in topics))


def _messages(spec: ScanSpec, new: New, progress: Progress) -> Iterator[Message]:
    """Yield every message in the order of log times."""
    return heapq.merge(
        _origin(new()),
        _static_transforms(spec, new()),
        _odometry(spec, new),
        _imu(spec, new),
        _scans(spec, new),
        _images(spec, new, progress),
        key=lambda message: message[0],
    )


def _origin(message: Encoding) -> Iterator[Message]:
    # As a message, it stays with the points when they are moved to a bag of another kind.
    yield START_NS, ORIGIN, origin_message(message, START_NS)


def _static_transforms(spec: ScanSpec, message: Encoding) -> Iterator[Message]:
    links = [
        (IMU_FRAME, LIDAR_FRAME, T_IMU_LIDAR[:3, 3], np.array([0.0, 0.0, 0.0, 1.0])),
        (LIDAR_FRAME, CAMERA_FRAME, *stated_mount(spec)),
    ]
    yield START_NS, TRANSFORMS, tf_message(message, START_NS, links)


def _odometry(spec: ScanSpec, new: New) -> Iterator[Message]:
    frames = (MAP_FRAME, IMU_FRAME)
    stamps, places, turns = recorded_imu_poses(spec)
    for stamp, place, turn in zip(stamps.tolist(), places, turns, strict=True):
        yield stamp, ODOMETRY, odometry_message(new(), stamp, frames, place, turn)


def _imu(spec: ScanSpec, new: New) -> Iterator[Message]:
    stamps, rates, forces = recorded_imu(spec)
    for stamp, rate, force in zip(stamps.tolist(), rates, forces, strict=True):
        yield stamp, IMU, imu_message(new(), stamp, IMU_FRAME, rate, force)


def _scans(spec: ScanSpec, new: New) -> Iterator[Message]:
    for index, stamp in enumerate(scan_stamps_ns(spec).tolist()):
        payload = livox_message(new(), simulate_scan(spec, index), LIDAR_FRAME)
        yield stamp + MESSAGE_NS, LIDAR, payload


def _images(spec: ScanSpec, new: New, progress: Progress) -> Iterator[Message]:
    stamps = stated_image_stamps_ns(spec).tolist()
    instants = image_instants_ns(spec).tolist()
    camera = raw_camera(spec.image_scale)
    for index, jpeg in enumerate(_jpegs(spec, len(stamps))):
        log_time_ns = instants[index] + _IMAGE_DELAY_NS
        info = camera_info_message(new(), stamps[index], CAMERA_FRAME, camera)
        yield log_time_ns, CAMERA_INFO, info
        image = image_message(new(), stamps[index], CAMERA_FRAME, jpeg)
        yield log_time_ns, IMAGE, image
        progress(1, len(stamps))


def _jpegs(spec: ScanSpec, count: int) -> Iterator[bytes]:
    """Render images in order, a few ahead of the writer."""
    with ThreadPoolExecutor(THREADS) as threads:
        # What all images share is worked out before the first: else each thread would do it.
        rays = threads.submit(lens_rays, raw_camera(spec.image_scale))
        painter_for(spec)
        rays.result()
        indices = iter(range(count))
        ahead = [threads.submit(simulate_jpeg, spec, i) for i in islice(indices, 2 * THREADS)]
        while ahead:
            jpeg = ahead.pop(0).result()
            ahead += [threads.submit(simulate_jpeg, spec, i) for i in islice(indices, 1)]
            yield jpeg
