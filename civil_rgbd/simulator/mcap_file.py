"""A simulated scan as raw MCAP, as a recorder on the rig would write it."""

from __future__ import annotations

import heapq
import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import IO, Final

import numpy as np
from mcap.writer import CompressionType, Writer

from civil_rgbd.errors import OutputError
from civil_rgbd.simulator.camera import raw_camera, simulate_jpeg
from civil_rgbd.simulator.cdr import (
    CdrMessage,
    camera_info_message,
    image_message,
    imu_message,
    livox_message,
    odometry_message,
    tf_message,
)
from civil_rgbd.simulator.lidar import MESSAGE_NS, scan_stamps_ns, simulate_scan
from civil_rgbd.simulator.recording import (
    CAMERA_FRAME,
    IMU_FRAME,
    LIDAR_FRAME,
    MAP_FRAME,
    stated_image_stamps_ns,
)
from civil_rgbd.simulator.ros_schemas import schema_text
from civil_rgbd.simulator.spec import ScanSpec
from civil_rgbd.simulator.walk import (
    START_NS,
    T_IMU_LIDAR,
    image_instants_ns,
    imu_poses,
    imu_readings,
    pose_stamps_ns,
    stated_mount,
)

LIBRARY: Final = "civil_rgbd simulator"
"""What the header of the file says who wrote it."""

TOPICS: Final = {
    "/civil_rgbd/origin": "std_msgs/msg/Header",
    "/tf_static": "tf2_msgs/msg/TFMessage",
    "/odometry": "nav_msgs/msg/Odometry",
    "/livox/imu": "sensor_msgs/msg/Imu",
    "/livox/lidar": "livox_ros_driver2/msg/CustomMsg",
    "/camera/color/camera_info": "sensor_msgs/msg/CameraInfo",
    "/camera/color/image_raw/compressed": "sensor_msgs/msg/CompressedImage",
}

_CHUNK_BYTES: Final = 4 << 20
_IMAGE_DELAY_NS: Final = 12_000_000  # from exposure to the recorder's disk
_THREADS: Final = min(2, os.cpu_count() or 1)

Message = tuple[int, str, bytes]
Progress = Callable[[int, int], object]


def write_recording(
    path: Path, spec: ScanSpec, *, overwrite: bool = False, progress: Progress | None = None
) -> None:
    """Simulate a scan and write it as MCAP; the file is whole or absent.

    Args:
        path: the file; its folder is made if it is missing.
        spec: the scan. Equal specs give equal bytes.
        overwrite: replace a file that is there.
        progress: called with (images newly done, images in all).

    Raises:
        OutputError: the file is there already, or cannot be written.
    """
    if path.exists() and not overwrite:
        raise OutputError(
            f"{path.name} is there already",
            where=path,
            fix="choose another name, or give --overwrite",
        )
    with _whole_file(path) as stream:
        _write(stream, spec, progress or (lambda *_: None))


def _write(stream: IO[bytes], spec: ScanSpec, progress: Progress) -> None:
    writer = Writer(
        stream,
        chunk_size=_CHUNK_BYTES,
        compression=CompressionType.ZSTD,
        enable_crcs=True,
        enable_data_crcs=True,
    )
    writer.start(profile="ros2", library=LIBRARY)
    writer.add_metadata("civil_rgbd", {"origin": "simulated"})
    channels = {
        topic: writer.register_channel(
            topic, "cdr", writer.register_schema(kind, "ros2msg", schema_text(kind).encode())
        )
        for topic, kind in TOPICS.items()
    }
    counts = dict.fromkeys(TOPICS, 0)
    for log_time_ns, topic, payload in _messages(spec, progress):
        writer.add_message(
            channels[topic], log_time_ns, payload, log_time_ns, sequence=counts[topic]
        )
        counts[topic] += 1
    writer.finish()


@contextmanager
def _whole_file(path: Path) -> Iterator[IO[bytes]]:
    # Not the format room's: rooms of one floor do not know each other.
    scratch = path.with_name(f".{path.name}.{os.getpid()}.partial")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            with scratch.open("wb") as stream:
                yield stream
                stream.flush()
                os.fsync(stream.fileno())
            scratch.replace(path)
        finally:
            scratch.unlink(missing_ok=True)
    except OSError as error:
        raise OutputError(
            f"cannot write: {error.strerror or error}",
            where=path,
            fix="free some space, or make the folder writable, or write elsewhere",
        ) from error


def _messages(spec: ScanSpec, progress: Progress) -> Iterator[Message]:
    """Yield every message in the order of log times."""
    return heapq.merge(
        _origin(),
        _static_transforms(spec),
        _odometry(spec),
        _imu(spec),
        _scans(spec),
        _images(spec, progress),
        key=lambda message: message[0],
    )


def _origin() -> Iterator[Message]:
    # As a message, it stays with the points when they are moved to a bag of another kind.
    yield START_NS, "/civil_rgbd/origin", CdrMessage().header(START_NS, "simulated").finished()


def _static_transforms(spec: ScanSpec) -> Iterator[Message]:
    links = [
        (IMU_FRAME, LIDAR_FRAME, T_IMU_LIDAR[:3, 3], np.array([0.0, 0.0, 0.0, 1.0])),
        (LIDAR_FRAME, CAMERA_FRAME, *stated_mount(spec)),
    ]
    yield START_NS, "/tf_static", tf_message(START_NS, links)


def _odometry(spec: ScanSpec) -> Iterator[Message]:
    stamps = pose_stamps_ns(spec)
    frames = (MAP_FRAME, IMU_FRAME)
    for stamp, place, turn in zip(stamps.tolist(), *imu_poses(spec, stamps), strict=True):
        yield stamp, "/odometry", odometry_message(stamp, frames, place, turn)


def _imu(spec: ScanSpec) -> Iterator[Message]:
    stamps = pose_stamps_ns(spec)
    for stamp, rate, force in zip(stamps.tolist(), *imu_readings(spec, stamps), strict=True):
        yield stamp, "/livox/imu", imu_message(stamp, IMU_FRAME, rate, force)


def _scans(spec: ScanSpec) -> Iterator[Message]:
    for index, stamp in enumerate(scan_stamps_ns(spec).tolist()):
        payload = livox_message(simulate_scan(spec, index), LIDAR_FRAME)
        yield stamp + MESSAGE_NS, "/livox/lidar", payload


def _images(spec: ScanSpec, progress: Progress) -> Iterator[Message]:
    stamps = stated_image_stamps_ns(spec).tolist()
    instants = image_instants_ns(spec).tolist()
    camera = raw_camera(spec.image_scale)
    for index, jpeg in enumerate(_jpegs(spec, len(stamps))):
        log_time_ns = instants[index] + _IMAGE_DELAY_NS
        info = camera_info_message(stamps[index], CAMERA_FRAME, camera)
        yield log_time_ns, "/camera/color/camera_info", info
        image = image_message(stamps[index], CAMERA_FRAME, jpeg)
        yield log_time_ns, "/camera/color/image_raw/compressed", image
        progress(1, len(stamps))


def _jpegs(spec: ScanSpec, count: int) -> Iterator[bytes]:
    """Render images in order, a few ahead of the writer; Embree, OpenCV and numpy free the GIL."""
    with ThreadPoolExecutor(_THREADS) as threads:
        indices = iter(range(count))
        ahead = [threads.submit(simulate_jpeg, spec, i) for i in islice(indices, 2 * _THREADS)]
        while ahead:
            jpeg = ahead.pop(0).result()
            ahead += [threads.submit(simulate_jpeg, spec, i) for i in islice(indices, 1)]
            yield jpeg
