"""The index of an MCAP file: what it says is there, before a message is read.

It is taken at its word only where its parts agree: the message indexes behind the chunks hold as
many messages of each channel as the statistics count, and every chunk is where it should be.
"""

from __future__ import annotations

import struct
from typing import BinaryIO, Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.conversion.container import IndexedTopic
from civil_rgbd.conversion.mcap_chunks import strings_in
from civil_rgbd.conversion.mcap_summary import Summary, read_summary
from civil_rgbd.storage.places import Place

_RECORD: Final = struct.Struct("<BQ")
_CHUNK: Final = 0x06
_MESSAGE_INDEX: Final = 0x07
_CHUNK_SPAN: Final = struct.Struct("<QQQQ")
"""First and last log time, start and length of the chunk record; then a map: its bytes."""
_STATISTICS: Final = struct.Struct("<QHIIIIQQI")
"""Messages, schemas, channels, attachments, metadata, chunks, times; then the bytes of a map."""
_COUNT: Final = struct.Struct("<HQ")
_INDEX_HEAD: Final = struct.Struct("<HI")
_ENTRY: Final = np.dtype([("log_time", "<u8"), ("offset", "<u8")])
_LARGEST_NS: Final = 1 << 63


class _IndexError(ValueError):
    """The parts of the index do not agree."""


def read_index(path: Place) -> tuple[IndexedTopic, ...] | None:
    """Return the channels of a file as its index has them, without reading a message.

    Args:
        path: an MCAP file.

    Returns:
        one entry a channel; None when there is no index, or its parts do not agree.

    Raises:
        OSError: the file cannot be read.
    """
    size_bytes = path.stat().st_size
    with path.open("rb") as file:
        try:
            summary = read_summary(file, size_bytes)
            return _topics(summary, _log_times_ns(file, summary, size_bytes))
        except (struct.error, ValueError, StopIteration):
            return None


def _topics(
    summary: Summary, log_times_ns: dict[int, NDArray[np.int64]]
) -> tuple[IndexedTopic, ...]:
    schemas = {
        struct.unpack_from("<H", record)[0]: next(strings_in(record, 2))
        for record in summary.schemas
    }
    topics = {}
    for record in summary.channels:
        number, schema = struct.unpack_from("<HH", record)
        topic, encoding = strings_in(record, 4, 2)
        times = log_times_ns.pop(number, np.zeros(0, dtype=np.int64))
        topics[number] = IndexedTopic(topic, schemas.get(schema, ""), encoding, times)
    if log_times_ns:
        raise _IndexError("messages of channels that are not described")
    return tuple(topics.values())


def _log_times_ns(
    file: BinaryIO, summary: Summary, size_bytes: int
) -> dict[int, NDArray[np.int64]]:
    """Return (M,) int64 log times of each channel, ascending."""
    claimed = _claimed(summary)
    found: dict[int, bytearray] = {}
    for record in summary.chunk_indexes:
        _, _, start, length = _CHUNK_SPAN.unpack_from(record)
        (map_bytes,) = struct.unpack_from("<I", record, _CHUNK_SPAN.size)
        (behind,) = struct.unpack_from("<Q", record, _CHUNK_SPAN.size + 4 + map_bytes)
        if start + length + behind > size_bytes:
            raise _IndexError("a chunk lies outside of the file")
        file.seek(start)
        opcode, content = _RECORD.unpack(file.read(_RECORD.size))
        if opcode != _CHUNK or content + _RECORD.size != length:
            raise _IndexError("a chunk is not where it should be")
        file.seek(start + length)
        _add_entries(found, memoryview(file.read(behind)))
    times = {channel: _times_of(entries) for channel, entries in found.items()}
    if {channel: len(every) for channel, every in times.items() if len(every)} != claimed:
        raise _IndexError("the statistics count otherwise")
    return times


def _claimed(summary: Summary) -> dict[int, int]:
    """Return how many messages of each channel there are by the statistics."""
    if summary.statistics is None:
        raise _IndexError("there are no statistics")
    head = _STATISTICS.unpack_from(summary.statistics)
    counts = summary.statistics[_STATISTICS.size : _STATISTICS.size + head[-1]]
    claimed = {channel: count for channel, count in _COUNT.iter_unpack(counts) if count}
    if sum(claimed.values()) != head[0] or len(summary.chunk_indexes) != head[5]:
        raise _IndexError("the statistics contradict themselves")
    return claimed


def _add_entries(found: dict[int, bytearray], section: memoryview) -> None:
    at = 0
    while at < len(section):
        opcode, length = _RECORD.unpack_from(section, at)
        channel, entries_bytes = _INDEX_HEAD.unpack_from(section, at + _RECORD.size)
        start = at + _RECORD.size + _INDEX_HEAD.size
        at += _RECORD.size + length
        if opcode != _MESSAGE_INDEX or start + entries_bytes != at or at > len(section):
            raise _IndexError("there is no message index where one belongs")
        found.setdefault(channel, bytearray()).extend(section[start:at])


def _times_of(entries: bytearray) -> NDArray[np.int64]:
    times = np.frombuffer(entries, dtype=_ENTRY)["log_time"] % np.uint64(_LARGEST_NS)
    return np.sort(times.astype(np.int64))
