"""The records of a ROS 1 bag, version 2.0: headers of named fields, then data."""

from __future__ import annotations

import re
import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from civil_rgbd.constants import NS_PER_S
from civil_rgbd.conversion.compression import (
    LARGEST_CHUNK_BYTES,
    ChunkError,
    UnknownCompressionError,
    bz2_records,
    lz4_records,
    plain_records,
)

MAGIC: Final = b"#ROSBAG V2.0\n"
MESSAGE, BAG_HEADER, INDEX_DATA, CHUNK, CHUNK_INFO, CONNECTION = 2, 3, 4, 5, 6, 7
OPERATIONS: Final = frozenset({MESSAGE, BAG_HEADER, INDEX_DATA, CHUNK, CHUNK_INFO, CONNECTION})

LENGTH: Final = struct.Struct("<I")
"""Before a record's header, before each of its fields, and before its data."""

MESSAGE_HEAD_BYTES: Final = 46
"""A message's header as every known writer makes it, with the lengths before and behind."""

_MESSAGE_HEAD: Final = re.compile(
    rb"\x26\0\0\0"
    rb"(?:\x09\0\0\0conn=(.{4})|\x04\0\0\0op=\x02|\x0d\0\0\0time=(.{8})){3}"
    rb"(.{4})",
    re.DOTALL,
)
_MESSAGE_NUMBERS: Final = struct.Struct("<IIII")
_TIME: Final = struct.Struct("<II")

_LARGEST_HEADER: Final = 1 << 16

_CHUNK_FIELD: Final = rb"(?:\x04\0\0\0op=\x05|.\0\0\0compression=[a-z0-9]{1,8}|\x09\0\0\0size=.{4})"
CHUNK_HEAD: Final = re.compile(rb".\0\0\0" + _CHUNK_FIELD + rb"{3}", re.DOTALL)
"""How every chunk record begins: what to look for behind a hole."""

CHUNK_HEAD_BYTES: Final = 64
"""No chunk record's header is longer."""


Read = Callable[[int, int], bytes | memoryview]
"""Returns bytes from a position on, fewer at the end."""


class BagError(ValueError):
    """Bytes are no record of a bag."""


@dataclass(frozen=True, slots=True)
class Head:
    """A record's header, and where its data lies.

    Attributes:
        operation: one of :data:`OPERATIONS`.
        fields: name to value.
        data: where the data starts.
        length: of the data.
    """

    operation: int
    fields: dict[str, bytes]
    data: int
    length: int

    def number(self, name: str) -> int:
        """Return an unsigned field, little endian.

        Raises:
            BagError: there is no such field, or it has an odd size.
        """
        value = self.fields.get(name, b"")
        if len(value) not in {1, 4, 8}:
            raise BagError(f"a record has no number {name!r}")
        return int.from_bytes(value, "little")

    def text(self, name: str) -> str:
        """Return a text field; empty when there is none."""
        return self.fields.get(name, b"").decode("utf-8", errors="replace")


def within(content: bytes | memoryview, base: int = 0) -> Read:
    """Return what reads from bytes that begin at position ``base``."""

    def read(at: int, length: int) -> bytes | memoryview:
        return content[at - base : at - base + length]

    return read


def head_at(read: Read, at: int, end: int) -> Head:
    """Return the header of the record at a position.

    Args:
        read: gives the bytes.
        at: where the record begins.
        end: its header may not reach further.

    Raises:
        BagError: there is no record.
    """
    start = read(at, LENGTH.size)
    if len(start) < LENGTH.size:
        raise BagError("it ends there")
    (header_bytes,) = LENGTH.unpack(start)
    if not 0 < header_bytes <= _LARGEST_HEADER:
        raise BagError(f"a header of {header_bytes} bytes is claimed")
    header = read(at + LENGTH.size, header_bytes + LENGTH.size)
    if len(header) < header_bytes + LENGTH.size or at + header_bytes > end:
        raise BagError("it ends inside a header")
    fields = fields_of(header[:header_bytes])
    operation = fields.get("op", b"")
    if len(operation) != 1 or operation[0] not in OPERATIONS:
        raise BagError("a header names no operation that is known")
    (length,) = LENGTH.unpack(header[header_bytes:])
    return Head(operation[0], fields, at + 2 * LENGTH.size + header_bytes, length)


def message_head(start: bytes | memoryview) -> tuple[int, int, int] | None:
    """Return connection, log time in ns and length of a message; None for any other record.

    Args:
        start: :data:`MESSAGE_HEAD_BYTES` of it.
    """
    match = _MESSAGE_HEAD.match(start)
    if match is None:
        return None
    conn, time, length = match.groups()
    if conn is None or time is None:
        return None
    number, seconds, nanoseconds, size = _MESSAGE_NUMBERS.unpack(conn + time + length)
    return number, seconds * NS_PER_S + nanoseconds, size


def time_ns(value: bytes) -> int:
    """Return a field's time in nanoseconds.

    Raises:
        BagError: it is no time.
    """
    if len(value) != _TIME.size:
        raise BagError("a record has no time")
    seconds, nanoseconds = _TIME.unpack(value)
    return int(seconds * NS_PER_S + nanoseconds)


def fields_of(header: bytes | memoryview) -> dict[str, bytes]:
    """Take a header apart.

    Raises:
        BagError: it is none.
    """
    found, at, header = {}, 0, bytes(header)
    while at < len(header):
        if at + LENGTH.size > len(header):
            raise BagError("a header ends inside a field")
        (length,) = LENGTH.unpack_from(header, at)
        at += LENGTH.size
        name, equals, value = header[at : at + length].partition(b"=")
        if not equals or at + length > len(header):
            raise BagError("a header has a field without a value")
        found[name.decode("latin-1")] = value
        at += length
    return found


def records_of(head: Head, stored: memoryview) -> memoryview:
    """Decompress a chunk.

    Args:
        head: its header.
        stored: its data; less than the header says where the file ends before.

    Returns:
        the records inside; of a chunk that is cut, or was never closed, as much as can be had.

    Raises:
        UnknownCompressionError: neither bz2 nor lz4 nor none.
        ChunkError: it cannot be decompressed, or its length does not hold.
    """
    name, cut = head.text("compression"), is_unclosed(head) or len(stored) < head.length
    if name not in _DECOMPRESSORS:
        raise UnknownCompressionError(
            f"compression {name!r} is none of {', '.join(map(repr, _DECOMPRESSORS))}"
        )
    try:
        size = head.number("size")
    except BagError as error:
        raise ChunkError(str(error)) from error
    if size > LARGEST_CHUNK_BYTES:
        raise ChunkError(f"it claims {size} bytes once decompressed")
    records = _DECOMPRESSORS[name](stored, size, cut=cut)
    if not cut and len(records) != size:
        raise ChunkError(f"it holds {len(records)} bytes, not {size}")
    return records


def is_unclosed(head: Head) -> bool:
    """Tell whether the recorder died while it wrote a compressed chunk: its length is still 0."""
    return not head.length and head.text("compression") != "none"


_DECOMPRESSORS: Final = {"none": plain_records, "lz4": lz4_records, "bz2": bz2_records}
