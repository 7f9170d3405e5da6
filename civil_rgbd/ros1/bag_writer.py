"""Writes ROS 1 bags (format 2.0, uncompressed, indexed): every tool of that world reads them."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from types import TracebackType
from typing import IO, Final, Self

from civil_rgbd.constants import NS_PER_S

MAGIC: Final = b"#ROSBAG V2.0\n"
_MESSAGE, _BAG_HEADER, _INDEX, _CHUNK, _CHUNK_INFO, _CONNECTION = 2, 3, 4, 5, 6, 7
_BAG_HEADER_BYTES = 4096  # the format pads this record, so that it can be rewritten at the end
_CHUNK_BYTES = 4 << 20


@dataclass(frozen=True, slots=True)
class MessageType:
    """A kind of message.

    Attributes:
        name: ``package/Type``.
        md5: the sum that ROS computes of the definition.
        definition: its text, and that of every type it uses.
    """

    name: str
    md5: str
    definition: str


class Ros1BagWriter:
    """Messages in, a bag out; give them in order of time, and leave the ``with`` to finish it.

    >>> import io
    >>> stream = io.BytesIO()
    >>> with Ros1BagWriter(stream, {"/imu": MessageType("sensor_msgs/Imu", "*", "")}) as bag:
    ...     bag.write("/imu", 1_000_000_000, b"payload")
    >>> stream.getvalue()[:12]
    b'#ROSBAG V2.0'
    """

    def __init__(self, stream: IO[bytes], topics: Mapping[str, MessageType]) -> None:
        self._stream = stream
        self._numbers = {topic: number for number, topic in enumerate(topics)}
        self._connections = [_connection(n, *item) for n, item in enumerate(topics.items())]
        self._chunk_infos: list[bytes] = []
        self._first, self._last = b"", b""
        self._begin_chunk()

    def __enter__(self) -> Self:
        self._stream.write(MAGIC + _bag_header(0, 0, 0))
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if kind is not None:
            return  # without its index nobody takes it for a whole bag
        self._end_chunk()
        index_at = self._stream.tell()
        self._stream.write(b"".join(self._connections) + b"".join(self._chunk_infos))
        self._stream.seek(len(MAGIC))
        counts = len(self._connections), len(self._chunk_infos)
        self._stream.write(_bag_header(index_at, *counts))

    def write(self, topic: str, stamp_ns: int, payload: bytes) -> None:
        """Add one message."""
        number = self._numbers[topic]
        time = ros_time(stamp_ns)
        self._entries.setdefault(number, []).append(time + struct.pack("<I", len(self._chunk)))
        self._chunk += _record({"op": _op(_MESSAGE), "conn": _u4(number), "time": time}, payload)
        self._first = self._first or time
        self._last = time
        if len(self._chunk) >= _CHUNK_BYTES:
            self._end_chunk()

    def _begin_chunk(self) -> None:
        self._chunk = bytearray(b"".join(self._connections) if not self._chunk_infos else b"")
        self._entries: dict[int, list[bytes]] = {}
        self._first = self._last = b""

    def _end_chunk(self) -> None:
        if not self._entries:
            return
        at = self._stream.tell()
        size = _u4(len(self._chunk))
        fields = {"op": _op(_CHUNK), "compression": b"none", "size": size}
        self._stream.write(_record(fields, bytes(self._chunk)))
        for number, entries in self._entries.items():
            self._stream.write(
                _record(
                    {
                        "op": _op(_INDEX),
                        "ver": _u4(1),
                        "conn": _u4(number),
                        "count": _u4(len(entries)),
                    },
                    b"".join(entries),
                )
            )
        fields = {
            "op": _op(_CHUNK_INFO),
            "ver": _u4(1),
            "chunk_pos": struct.pack("<Q", at),
            "start_time": self._first,
            "end_time": self._last,
            "count": _u4(len(self._entries)),
        }
        counts = [_u4(number) + _u4(len(rows)) for number, rows in self._entries.items()]
        self._chunk_infos.append(_record(fields, b"".join(counts)))
        self._begin_chunk()


def ros_time(stamp_ns: int) -> bytes:
    """Encode a stamp as ROS 1 does: seconds and nanoseconds, uint32 each."""
    return struct.pack("<II", *divmod(stamp_ns, NS_PER_S))


def _connection(number: int, topic: str, kind: MessageType) -> bytes:
    fields = {
        "topic": topic.encode(),
        "type": kind.name.encode(),
        "md5sum": kind.md5.encode(),
        "message_definition": kind.definition.encode(),
    }
    head = {"op": _op(_CONNECTION), "conn": _u4(number), "topic": topic.encode()}
    return _record(head, _fields(fields))


def _bag_header(index_at: int, connections: int, chunks: int) -> bytes:
    fields = {
        "op": _op(_BAG_HEADER),
        "index_pos": struct.pack("<Q", index_at),
        "conn_count": _u4(connections),
        "chunk_count": _u4(chunks),
    }
    head = _fields(fields)
    return _record(fields, b" " * (_BAG_HEADER_BYTES - len(head) - 8))


def _record(fields: Mapping[str, bytes], data: bytes) -> bytes:
    head = _fields(fields)
    return _u4(len(head)) + head + _u4(len(data)) + data


def _fields(fields: Mapping[str, bytes]) -> bytes:
    pairs = [name.encode() + b"=" + value for name, value in fields.items()]
    return b"".join(_u4(len(pair)) + pair for pair in pairs)


def _op(code: int) -> bytes:
    return bytes([code])


def _u4(value: int) -> bytes:
    return struct.pack("<I", value)
