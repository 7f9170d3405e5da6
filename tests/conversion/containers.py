"""The same messages in every container: written by the rosbags library, and bags also by hand."""

from __future__ import annotations

import bz2
import struct
from collections.abc import Iterable, Sequence
from functools import cache, partial
from itertools import chain, groupby
from pathlib import Path

import lz4.frame
from mcap.reader import make_reader
from rosbags import rosbag1, rosbag2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from .scene import Message

CUSTOM_POINT = """uint32 offset_time
float32 x
float32 y
float32 z
uint8 reflectivity
uint8 tag
uint8 line
"""
CUSTOM_MSG = """std_msgs/Header header
uint64 timebase
uint32 point_num
uint8 lidar_id
uint8[3] rsvd
CustomPoint[] points
"""
COMPRESSORS = {
    "none": bytes,
    "lz4": partial(lz4.frame.compress, content_checksum=True),  # as roscpp's own writer
    "bz2": bz2.compress,
}


@cache
def _store(store: Stores) -> Typestore:
    typestore = get_typestore(store)
    if store is Stores.ROS1_NOETIC:  # which has ROS's common_msgs, and tf2_msgs is none of them
        tf = "geometry_msgs/TransformStamped[] transforms"
        typestore.register(get_types_from_msg(tf, "tf2_msgs/msg/TFMessage"))
    for package in ("livox_ros_driver", "livox_ros_driver2", "livox_interfaces"):
        typestore.register(get_types_from_msg(CUSTOM_POINT, f"{package}/msg/CustomPoint"))
        typestore.register(get_types_from_msg(CUSTOM_MSG, f"{package}/msg/CustomMsg"))
    return typestore


def messages_of(mcap: Path) -> list[Message]:
    """All messages of an MCAP file, by its reference reader."""
    with mcap.open("rb") as file:
        return [
            Message(channel.topic, schema.name, message.log_time, message.data)
            for schema, channel, message in make_reader(file).iter_messages()
        ]


def as_ros1(message: Message) -> bytes:
    """A ROS 2 message in ROS 1's encoding, by the rosbags library."""
    raw = _store(Stores.ROS2_HUMBLE).cdr_to_ros1(message.payload, message.type_name)
    return bytes(raw)


def write_bag(path: Path, messages: Iterable[Message], *, compression: str = "none") -> Path:
    """A ROS 1 bag by the rosbags library."""
    writer = rosbag1.Writer(path)
    if compression != "none":
        writer.set_compression(rosbag1.Writer.CompressionFormat[compression.upper()])
    writer.chunk_threshold = 1 << 14
    with writer:
        connections = {}
        for message in messages:
            key = message.topic, message.type_name
            if key not in connections:
                connections[key] = writer.add_connection(
                    *key, typestore=_store(Stores.ROS1_NOETIC), latching=1
                )
            writer.write(connections[key], message.log_time_ns, as_ros1(message))
    return path


def write_folder(
    folder: Path,
    messages: Iterable[Message],
    *,
    storage: str = "sqlite3",
    compression: str | None = None,
) -> Path:
    """A ROS 2 folder by the rosbags library; compression is file, message or storage."""
    plugin = {"sqlite3": rosbag2.StoragePlugin.SQLITE3, "mcap": rosbag2.StoragePlugin.MCAP}
    writer = rosbag2.Writer(folder, version=9, storage_plugin=plugin[storage])
    if compression:
        writer.set_compression(
            rosbag2.CompressionMode[compression.upper()], rosbag2.CompressionFormat.ZSTD
        )
    with writer:
        connections = {}
        for message in messages:
            key = message.topic, message.type_name
            if key not in connections:
                connections[key] = writer.add_connection(*key, typestore=_store(Stores.ROS2_HUMBLE))
            writer.write(connections[key], message.log_time_ns, message.payload)
    return folder


def record(fields: Sequence[tuple[str, bytes]], data: bytes) -> bytes:
    """One record of a bag."""
    header = b"".join(
        struct.pack("<I", len(name) + 1 + len(value)) + name.encode() + b"=" + value
        for name, value in fields
    )
    return struct.pack("<I", len(header)) + header + struct.pack("<I", len(data)) + data


def bag_by_hand(
    messages: Sequence[Message],
    *,
    compression: str = "none",
    per_chunk: int = 7,
    order: Sequence[str] = ("conn", "op", "time"),
    more_fields: Sequence[tuple[str, bytes]] = (),
    index: bool = True,
    last_chunk_open: bool = False,
    header: Sequence[tuple[str, bytes]] = (),
) -> bytes:
    """A bag as roscpp writes it, or as it leaves it when it is killed."""
    numbers: dict[tuple[str, str], int] = {}
    connections = b""
    chunks = b""
    starts, held = [], []
    groups = [list(g) for _, g in groupby(enumerate(messages), lambda item: item[0] // per_chunk)]
    for at, group in enumerate(groups):
        inside = b""
        entries: dict[int, list[bytes]] = {}
        for _, message in group:
            key = message.topic, message.type_name.replace("/msg/", "/")
            if key not in numbers:
                numbers[key] = len(numbers)
                connection = _connection(numbers[key], *key)
                connections += connection
                inside += connection
            seconds, nanoseconds = divmod(message.log_time_ns, 10**9)
            values = {
                "op": b"\x02",
                "conn": struct.pack("<I", numbers[key]),
                "time": struct.pack("<II", seconds, nanoseconds),
            }
            fields = [(name, values[name]) for name in order]
            entry = values["time"] + struct.pack("<I", len(inside))
            entries.setdefault(numbers[key], []).append(entry)
            inside += record([*fields, *more_fields], as_ros1(message))
        starts.append(len(chunks))
        is_open = last_chunk_open and at == len(groups) - 1
        stored = COMPRESSORS[compression](inside)
        chunk = record(
            [
                ("compression", compression.encode()),
                ("op", b"\x05"),
                ("size", struct.pack("<I", 0 if is_open else len(inside))),
            ],
            b"" if is_open else stored,
        )
        held.append(entries)
        chunks += chunk + (stored if is_open else _index_of(entries))
    index_at = len(b"#ROSBAG V2.0\n") + 4096 + len(chunks) if index else 0
    start = record(
        [
            *header,
            ("chunk_count", struct.pack("<I", len(groups) if index else 0)),
            ("conn_count", struct.pack("<I", len(numbers) if index else 0)),
            ("index_pos", struct.pack("<Q", index_at)),
            ("op", b"\x03"),
        ],
        b"",
    )[:-4]
    start += struct.pack("<I", 4096 - len(start) - 4)
    start = b"#ROSBAG V2.0\n" + start.ljust(4096)
    infos = b"".join(
        record(
            [
                ("chunk_pos", struct.pack("<Q", 13 + 4096 + at)),
                ("count", struct.pack("<I", len(entries))),
                ("end_time", max(chain(*entries.values()), key=_time)[:8]),
                ("op", b"\x06"),
                ("start_time", min(chain(*entries.values()), key=_time)[:8]),
                ("ver", struct.pack("<I", 1)),
            ],
            b"".join(struct.pack("<II", key, len(rows)) for key, rows in entries.items()),
        )
        for at, entries in zip(starts, held, strict=True)
    )
    return start + chunks + (connections + infos if index else b"")


def _connection(number: int, topic: str, type_name: str) -> bytes:
    description = record(
        [
            ("callerid", b"/recorder"),
            ("latching", b"1"),
            ("md5sum", b"*"),
            ("message_definition", b"# none"),
            ("topic", topic.encode()),
            ("type", type_name.encode()),
        ],
        b"",
    )[4:-4]
    fields = [
        ("conn", struct.pack("<I", number)),
        ("op", b"\x07"),
        ("topic", topic.encode()),
    ]
    return record(fields, description)


def _index_of(entries: dict[int, list[bytes]]) -> bytes:
    """The records behind a chunk: time and offset of each message."""
    return b"".join(
        record(
            [
                ("conn", struct.pack("<I", key)),
                ("count", struct.pack("<I", len(rows))),
                ("op", b"\x04"),
                ("ver", struct.pack("<I", 1)),
            ],
            b"".join(rows),
        )
        for key, rows in entries.items()
    )


def _time(entry: bytes) -> tuple[int, ...]:
    return struct.unpack_from("<II", entry)
