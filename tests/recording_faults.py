"""Faults planted into recordings: the messages of an MCAP file are edited and written anew.

Every fault is planted at no less than twice the limit of the check that is to find it. It works on
recordings of the simulator (topics and CDR as it writes them), without any code of the converters.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from numpy.typing import NDArray

LIDAR: Final = "/livox/lidar"
IMU: Final = "/livox/imu"
IMAGE: Final = "/camera/color/image_raw/compressed"
CAMERA_INFO: Final = "/camera/color/camera_info"
ODOMETRY: Final = "/odometry"
TRANSFORMS: Final = "/tf_static"

_NS: Final = 1_000_000_000


@dataclass(frozen=True)
class Message:
    """One message of a recording."""

    topic: str
    log_ns: int
    data: bytes

    @property
    def stamp_ns(self) -> int:
        """What its header says."""
        seconds, rest = struct.unpack_from("<iI", self.data, 4)
        return seconds * _NS + rest

    def stamped(self, stamp_ns: int) -> Message:
        """Return it with another header stamp."""
        stamp = struct.pack("<iI", stamp_ns // _NS, stamp_ns % _NS)
        return replace(self, data=self.data[:4] + stamp + self.data[12:])


Edit = Callable[[Message], Iterable[Message]]


@dataclass(frozen=True)
class Extent:
    """The time that a recording covers."""

    first_ns: int
    last_ns: int

    @property
    def seconds(self) -> float:
        """Its length."""
        return (self.last_ns - self.first_ns) / _NS

    def at(self, share: float) -> int:
        """Return an instant of it."""
        return self.first_ns + round(share * (self.last_ns - self.first_ns))


@dataclass(frozen=True, eq=False)
class Contents:
    """A recording in memory.

    Attributes:
        topics: name and encoding of messages and schema, and the schema, by topic.
        messages: in the file's order of log times.
    """

    topics: dict[str, tuple[str, str, str, bytes]]
    messages: tuple[Message, ...]


def contents_of(source: Path) -> Contents:
    """Read a recording."""
    topics: dict[str, tuple[str, str, str, bytes]] = {}
    messages: list[Message] = []
    with source.open("rb") as stream:
        for schema, channel, message in make_reader(stream).iter_messages():
            assert schema is not None
            topics[channel.topic] = (
                channel.message_encoding, schema.name, schema.encoding, schema.data,
            )  # fmt: skip
            messages.append(Message(channel.topic, message.log_time, message.data))
    return Contents(topics, tuple(messages))


def rewrite(source: Path | Contents, out: Path, edit: Edit) -> Path:
    """Copy a recording message by message through an edit, in order of the new log times."""
    contents = source if isinstance(source, Contents) else contents_of(source)
    messages = [new for message in contents.messages for new in edit(message)]
    with out.open("wb") as target:
        writer = Writer(target, compression=CompressionType.NONE, chunk_size=4 << 20)
        writer.start(profile="ros2", library="recording_faults")
        channels: dict[str, int] = {}
        for topic, (encoding, name, schema_encoding, schema) in contents.topics.items():
            known = writer.register_schema(name, schema_encoding, schema)
            channels[topic] = writer.register_channel(topic, encoding, known)
        for number, message in enumerate(sorted(messages, key=lambda message: message.log_ns)):
            writer.add_message(
                channels[message.topic], message.log_ns, message.data, message.log_ns, number
            )
        writer.finish()
    return out


def extent_of(source: Path) -> Extent:
    """Return what a recording's own summary says of its time."""
    with source.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    return Extent(summary.statistics.message_start_time, summary.statistics.message_end_time)


def drop(topics: tuple[str, ...], chosen: Callable[[Message], bool]) -> Edit:
    """Leave out messages of some topics."""

    def edit(message: Message) -> Iterator[Message]:
        if message.topic not in topics or not chosen(message):
            yield message

    return edit


def drop_share(topics: tuple[str, ...], share: float, rng: np.random.Generator) -> Edit:
    """Leave out that share of the messages, here and there; those of one stamp together."""
    fates: dict[int, bool] = {}

    def lost(message: Message) -> bool:
        return fates.setdefault(message.stamp_ns, bool(rng.random() < share))

    return drop(topics, lost)


def scattered(share: float, rng: np.random.Generator) -> Callable[[int], bool]:
    """Choose that share of stamps exactly, as they come: one by chance of each 1 / share."""
    fates: dict[int, bool] = {}
    parts: dict[int, float] = {}

    def chosen(stamp_ns: int) -> bool:
        if stamp_ns not in fates:
            part, within = divmod(len(fates) * share, 1)
            # Of each part the first stamp from a random place on.
            place = parts.setdefault(int(part), rng.uniform(0, 1 - share))
            fates[stamp_ns] = place <= within
            if fates[stamp_ns]:
                parts[int(part)] = 1.0
        return fates[stamp_ns]

    return chosen


def silence(topics: tuple[str, ...], start_ns: int, seconds: float) -> Edit:
    """Leave out everything for a while."""
    return drop(topics, lambda m: start_ns <= m.stamp_ns < start_ns + seconds * _NS)


def keep_every(topics: tuple[str, ...], step: int) -> Edit:
    """Keep every so manyth message."""
    numbers: dict[str, int] = {}

    def skipped(message: Message) -> bool:
        numbers[message.topic] = numbers.get(message.topic, -1) + 1
        return numbers[message.topic] % step != 0

    return drop(topics, skipped)


def cut(first_ns: int, last_ns: int) -> Edit:
    """Keep a part of the recording; what is said once at its start stays."""

    def edit(message: Message) -> Iterator[Message]:
        if (
            message.topic not in {LIDAR, IMU, IMAGE, CAMERA_INFO, ODOMETRY}
            or first_ns <= message.stamp_ns <= last_ns
        ):
            yield message

    return edit


def restamp(topics: tuple[str, ...], new_stamp: Callable[[int], int]) -> Edit:
    """Give the messages of some topics other header stamps; log times stay."""

    def edit(message: Message) -> Iterator[Message]:
        if message.topic in topics:
            message = message.stamped(new_stamp(message.stamp_ns))
        yield message

    return edit


def log_later(delay_ns: Callable[[], int]) -> Edit:
    """Let the recorder take every message some time later; those of a topic keep their order."""
    last: dict[str, int] = {}

    def edit(message: Message) -> Iterator[Message]:
        late_ns = max(message.log_ns + delay_ns(), last.get(message.topic, 0) + 1)
        last[message.topic] = late_ns
        yield replace(message, log_ns=late_ns)

    return edit


def repaint(
    chosen: Callable[[int], bool], paint: Callable[[NDArray[np.uint8], int], NDArray[np.uint8]]
) -> Edit:
    """Change the pixels of images whose stamps are chosen."""

    def edit(message: Message) -> Iterator[Message]:
        if message.topic == IMAGE and chosen(message.stamp_ns):
            at = _after_strings(message.data, 2)
            head, jpeg = message.data[:at], message.data[at + 4 :]
            pixels = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
            _, coded = cv2.imencode(".jpg", paint(pixels, message.stamp_ns))
            data = head + struct.pack("<I", len(coded)) + coded.tobytes()
            message = replace(message, data=data)
        yield message

    return edit


def truncate(chosen: Callable[[int], bool], size: int) -> Edit:
    """Keep so many bytes of the compressed images whose stamps are chosen."""

    def edit(message: Message) -> Iterator[Message]:
        if message.topic == IMAGE and chosen(message.stamp_ns):
            at = _after_strings(message.data, 2)
            data = message.data[:at] + struct.pack("<I", size) + message.data[at + 4 :][:size]
            message = replace(message, data=data)
        yield message

    return edit


def move_poses(
    moved: Callable[[int, NDArray[np.float64], NDArray[np.float64]], NDArray[np.float64]],
) -> Edit:
    """Give odometry other numbers: a function of stamp, place (3,) and quaternion (4,) to (7,)."""

    def edit(message: Message) -> Iterator[Message]:
        if message.topic == ODOMETRY:
            at = _aligned(_after_strings(message.data, 2), 8)
            seven = np.array(struct.unpack_from("<7d", message.data, at))
            new = moved(message.stamp_ns, seven[:3], seven[3:])
            data = message.data[:at] + struct.pack("<7d", *new) + message.data[at + 56 :]
            message = replace(message, data=data)
        yield message

    return edit


def remount(change: Callable[[NDArray[np.float64]], NDArray[np.float64]]) -> Edit:
    """Give the camera another mounting: a function of T_lidar_camera (4, 4)."""

    def edit(message: Message) -> Iterator[Message]:
        if message.topic == TRANSFORMS:
            at = len(message.data) - 56  # the last link of two is the camera's
            x, y, z, *quaternion = struct.unpack_from("<7d", message.data, at)
            T = np.eye(4)
            T[:3, :3], T[:3, 3] = matrix_of(np.array(quaternion)), (x, y, z)
            new = change(T)
            seven = *new[:3, 3], *quaternion_of(new[:3, :3])
            message = replace(message, data=message.data[:at] + struct.pack("<7d", *seven))
        yield message

    return edit


def chained(*edits: Edit) -> Edit:
    """Apply edits one after another."""

    def edit(message: Message) -> Iterable[Message]:
        messages: Iterable[Message] = (message,)
        for one in edits:
            messages = [new for old in messages for new in one(old)]
        return messages

    return edit


def brighten(pixels: NDArray[np.uint8], factor: float) -> NDArray[np.uint8]:
    """Expose that much longer: grey levels of a display are the light's 2.2nd root."""
    light = (pixels.astype(np.float32) / 255) ** 2.2 * factor
    return np.asarray(np.clip(light, 0, 1) ** (1 / 2.2) * 255, dtype=np.uint8)


def blur(pixels: NDArray[np.uint8], sigma_px: float, angle_rad: float | None) -> NDArray[np.uint8]:
    """Defocus, or with an angle smear along it, over some four sigma."""
    if angle_rad is None:
        return np.asarray(cv2.GaussianBlur(pixels, (0, 0), sigma_px), dtype=np.uint8)
    size = 2 * round(2 * sigma_px) + 1
    kernel = np.zeros((size, size), np.float32)
    reach = size // 2
    for step in np.linspace(-reach, reach, 4 * size):
        column = round(reach + step * np.cos(angle_rad))
        kernel[round(reach + step * np.sin(angle_rad)), column] = 1
    return np.asarray(cv2.filter2D(pixels, -1, kernel / kernel.sum()), dtype=np.uint8)


def rotation(axis: NDArray[np.float64], degrees: float) -> NDArray[np.float64]:
    """Return a (4, 4) turn about an axis."""
    T = np.eye(4)
    T[:3, :3], _ = cv2.Rodrigues(np.radians(degrees) * axis / np.sqrt((axis**2).sum()))
    return T


def matrix_of(quaternion_xyzw: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the rotation of a unit quaternion."""
    x, y, z, w = quaternion_xyzw
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip


def quaternion_of(R: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the unit quaternion, xyzw, of a rotation: the eigenvector that Bar-Itzhack found."""
    K = np.array([
        [R[0, 0] - R[1, 1] - R[2, 2], R[1, 0] + R[0, 1], R[2, 0] + R[0, 2], R[2, 1] - R[1, 2]],
        [R[1, 0] + R[0, 1], R[1, 1] - R[0, 0] - R[2, 2], R[2, 1] + R[1, 2], R[0, 2] - R[2, 0]],
        [R[2, 0] + R[0, 2], R[2, 1] + R[1, 2], R[2, 2] - R[0, 0] - R[1, 1], R[1, 0] - R[0, 1]],
        [R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1], R.trace()],
    ])  # fmt: skip
    q = np.linalg.eigh(K / 3)[1][:, -1]
    return np.asarray(q if q[3] >= 0 else -q)


def _after_strings(data: bytes, count: int) -> int:
    """Return where the message goes on after its stamp and so many strings, 4-aligned."""
    at = 12
    for _ in range(count):
        at = _aligned(at, 4)
        (length,) = struct.unpack_from("<I", data, at)
        at += 4 + length
    return _aligned(at, 4)


def _aligned(at: int, size: int) -> int:
    """CDR aligns from behind its own four bytes."""
    return -(-(at - 4) // size) * size + 4
