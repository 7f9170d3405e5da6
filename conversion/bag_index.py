"""The index at the end of a ROS 1 bag: what it says is there, before a message is read.

An index may be missing, cut or wrong. It is taken at its word only where it accounts for every
byte of the file: chunks and their index records follow each other without a gap, up to the index.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator
from typing import BinaryIO, Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.constants import NS_PER_S
from civil_rgbd.conversion.bag_records import (
    BAG_HEADER,
    CHUNK,
    CHUNK_HEAD_BYTES,
    CHUNK_INFO,
    CONNECTION,
    MAGIC,
    BagError,
    Head,
    fields_of,
    head_at,
    within,
)
from civil_rgbd.conversion.container import IndexedTopic
from civil_rgbd.storage.places import Place

_ENTRY: Final = np.dtype([("seconds", "<u4"), ("nanoseconds", "<u4"), ("offset", "<u4")])
_LARGEST_INDEX_BYTES: Final = 1 << 30  # of a bag with tens of millions of chunks
_COUNT: Final = struct.Struct("<II")
"""In a chunk's info: a connection, and how many of its messages the chunk holds."""

_INDEX_HEAD: Final = re.compile(
    rb"\x2f\0\0\0"
    rb"(?:\x08\0\0\0ver=\x01\0\0\0|\x09\0\0\0conn=(.{4})|\x0a\0\0\0count=(.{4})|\x04\0\0\0op=\x04)"
    rb"{4}(.{4})",
    re.DOTALL,
)
"""An index record's header as every known writer makes it, with the lengths before and behind."""


def read_index(path: Place) -> tuple[IndexedTopic, ...] | None:
    """Return the topics of a bag as its index has them, without reading a message.

    Args:
        path: a bag of version 2.0.

    Returns:
        one entry a connection, in the index's order; None when there is no index, or it does not
        account for the whole file.

    Raises:
        OSError: the file cannot be read.
    """
    with path.open("rb") as file:
        try:
            return _Index(file, path.stat().st_size).read()
        except (BagError, struct.error):
            return None


def counts_claimed(file: BinaryIO, index_at: int, size_bytes: int) -> dict[int, int] | None:
    """Return how many messages of each connection the index claims; None if it cannot be read."""
    try:
        counts: dict[int, int] = {}
        for head, data in _end_records(file, index_at, size_bytes):
            if head.operation == CHUNK_INFO:
                for connection, count in _COUNT.iter_unpack(data):
                    counts[connection] = counts.get(connection, 0) + count
    except (BagError, struct.error):
        return None
    return counts


class _Index:
    def __init__(self, file: BinaryIO, size_bytes: int) -> None:
        self._file, self._size = file, size_bytes
        self._connections: dict[int, tuple[str, str]] = {}
        self._chunks: list[tuple[int, dict[int, int]]] = []
        self._entries: dict[int, bytearray] = {}

    def read(self) -> tuple[IndexedTopic, ...]:
        start, index_at = self._bag_header()
        for head, data in _end_records(self._file, index_at, self._size):
            if head.operation == CONNECTION:
                self._connection(head, data)
            elif head.operation == CHUNK_INFO:
                self._chunks.append((head.number("chunk_pos"), dict(_COUNT.iter_unpack(data))))
        self._refuse_unless(len(self._connections) == self._connections_claimed)
        self._refuse_unless(len(self._chunks) == self._chunks_claimed)
        self._chunks.sort(key=lambda chunk: chunk[0])
        places = [place for place, _ in self._chunks] + [index_at]
        self._refuse_unless(places[0] == start and places == sorted(places))
        for (place, counts), after in zip(self._chunks, places[1:], strict=True):
            self._chunk(place, counts, after)
        return tuple(
            IndexedTopic(topic, type_name, "ros1", _log_times_ns(self._entries.get(number, b"")))
            for number, (topic, type_name) in self._connections.items()
        )

    def _read(self, at: int, length: int) -> bytes:
        self._file.seek(at)
        return self._file.read(length)

    @staticmethod
    def _refuse_unless(condition: bool) -> None:  # noqa: FBT001  # the one thing it is about
        if not condition:
            raise BagError("the index does not account for the file")

    def _bag_header(self) -> tuple[int, int]:
        """Return where the first record behind the bag's header is, and where the index is."""
        head = head_at(self._read, len(MAGIC), self._size)
        index_at = head.number("index_pos")
        self._refuse_unless(head.operation == BAG_HEADER and 0 < index_at <= self._size)
        self._connections_claimed = head.number("conn_count")
        self._chunks_claimed = head.number("chunk_count")
        return head.data + head.length, index_at

    def _connection(self, head: Head, data: bytes) -> None:
        description = fields_of(data)
        type_name = description.get("type", b"").decode("utf-8", "replace")
        topic = head.text("topic") or description.get("topic", b"").decode("utf-8", "replace")
        self._connections[head.number("conn")] = topic, type_name

    def _chunk(self, place: int, counts: dict[int, int], after: int) -> None:
        """Take the index records between a chunk and what follows them."""
        head = head_at(within(self._read(place, 2 * CHUNK_HEAD_BYTES), place), place, after)
        at = head.data + head.length
        self._refuse_unless(head.operation == CHUNK and at <= after)
        section, at, left = self._read(at, after - at), 0, dict(counts)
        while at < len(section):
            match = _INDEX_HEAD.match(section, at)
            if match is None:
                raise BagError("there is no index record where one belongs")
            connection, count, length = (
                int.from_bytes(group or b"", "little") for group in match.groups()
            )
            at = match.end() + length
            self._refuse_unless(length == count * _ENTRY.itemsize and at <= len(section))
            self._refuse_unless(left.pop(connection, -1) == count)
            self._refuse_unless(connection in self._connections)
            self._entries.setdefault(connection, bytearray()).extend(section[match.end() : at])
        self._refuse_unless(not any(left.values()))


def _end_records(file: BinaryIO, index_at: int, size_bytes: int) -> Iterator[tuple[Head, bytes]]:
    """Yield the records of the index; they must end where the file ends."""
    if not 0 < index_at <= size_bytes or size_bytes - index_at > _LARGEST_INDEX_BYTES:
        raise BagError("the index lies outside of the file")
    file.seek(index_at)
    section, at = file.read(size_bytes - index_at), 0
    while at < len(section):
        head = head_at(within(section), at, len(section))
        end = head.data + head.length
        if end > len(section):
            raise BagError("the index ends inside a record")
        yield head, section[head.data : end]
        at = end


def _log_times_ns(entries: bytes | bytearray) -> NDArray[np.int64]:
    rows = np.frombuffer(entries, dtype=_ENTRY)
    return np.sort(rows["seconds"].astype(np.int64) * NS_PER_S + rows["nanoseconds"])
