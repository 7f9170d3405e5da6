"""A two-second recording in a few kilobytes, with every part replaceable."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from mcap.writer import CompressionType, Writer

from . import messages

START_NS = 1_700_000_000_000_000_000
STEP_NS = 100_000_000
SCANS = 20


class Message(NamedTuple):
    topic: str
    type_name: str
    log_time_ns: int
    payload: bytes


LIDAR, CAMERA, INFO, ODOM = "/lidar", "/cam/image/compressed", "/cam/camera_info", "/odom"


def jpeg(
    size: tuple[int, int] = (64, 48), colour_rgb: tuple[int, int, int] = (200, 30, 60)
) -> bytes:
    pixels = np.full((size[1], size[0], 3), colour_rgb[::-1], dtype=np.uint8)
    return bytes(cv2.imencode(".jpg", pixels)[1])


def stamp(index: float) -> int:
    return START_NS + round(index * STEP_NS)


def scans(topic: str = LIDAR, *, frame: str = "lidar", count: int = SCANS) -> list[Message]:
    rng = np.random.default_rng(5)
    return [
        Message(
            topic,
            "sensor_msgs/msg/PointCloud2",
            stamp(i),
            messages.xyz_cloud(stamp(i), rng.normal(size=(30, 3)).astype(np.float32), frame=frame),
        )
        for i in range(count)
    ]


def images(topic: str = CAMERA, *, size: tuple[int, int] = (64, 48)) -> list[Message]:
    data = jpeg(size)
    return [
        Message(
            topic,
            "sensor_msgs/msg/CompressedImage",
            stamp(i) + 7,
            messages.compressed_image(stamp(i) + 5, data),
        )
        for i in range(SCANS)
    ]


def infos(topic: str = INFO, **what: object) -> list[Message]:
    payload = messages.camera_info(START_NS, **what)  # type: ignore[arg-type]  # handed through
    return [Message(topic, "sensor_msgs/msg/CameraInfo", START_NS, payload)]


def poses(topic: str = ODOM, *, child: str = "lidar", frame: str = "odom") -> list[Message]:
    return [
        Message(
            topic,
            "nav_msgs/msg/Odometry",
            stamp(i),
            messages.odometry(stamp(i), (0.1 * i, 0, 0, 0, 0, 0, 1), child=child, frame=frame),
        )
        for i in range(SCANS + 1)
    ]


def static(parent: str = "lidar", child: str = "camera") -> list[Message]:
    half = 0.5
    payload = messages.transforms([(START_NS, parent, child, (1, 2, 3, -half, half, -half, half))])
    return [Message("/tf_static", "tf2_msgs/msg/TFMessage", START_NS, payload)]


def whole() -> dict[str, list[Message]]:
    return {
        "tf": static(),
        "infos": infos(),
        "scans": scans(),
        "images": images(),
        "poses": poses(),
    }


def flat(parts: dict[str, list[Message]]) -> list[Message]:
    """All messages in the order of their log times, as a recorder writes them."""
    return sorted(
        (message for part in parts.values() for message in part), key=lambda m: m.log_time_ns
    )


def write(  # each knob is one way that real files differ
    file: Path,
    content: dict[str, list[Message]] | list[Message],
    *,
    compression: CompressionType = CompressionType.ZSTD,
    chunk_size: int = 4096,
    chunked: bool = True,
    crcs: bool = True,
    encoding: str = "cdr",
    summary: bool = True,
    silent: tuple[tuple[str, str], ...] = (),
) -> Path:
    written = flat(content) if isinstance(content, dict) else content
    writer = Writer(
        str(file),
        chunk_size=chunk_size,
        compression=compression,
        use_chunking=chunked,
        enable_crcs=crcs,
        repeat_channels=summary,
        repeat_schemas=summary,
        use_statistics=summary,
        use_summary_offsets=summary,
    )
    writer.start(profile="ros2", library="tests")
    for topic, type_name in silent:  # advertised, but nothing was published
        writer.register_channel(topic, encoding, writer.register_schema(type_name, "ros2msg", b""))
    channels: dict[tuple[str, str], int] = {}
    for message in written:
        key = message.topic, message.type_name
        if key not in channels:
            schema = writer.register_schema(message.type_name, "ros2msg", b"")
            channels[key] = writer.register_channel(message.topic, encoding, schema)
        writer.add_message(channels[key], message.log_time_ns, message.payload, message.log_time_ns)
    writer.finish()
    return file


def chunk_places(data: bytes) -> list[tuple[int, int]]:
    """Start and length of every chunk record."""
    at, found = 8, []
    while data[at] != 0x02:
        length = struct.unpack_from("<Q", data, at + 1)[0]
        if data[at] == 0x06:
            found.append((at, 9 + length))
        at += 9 + length
    return found
