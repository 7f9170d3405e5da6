"""The records of a ROS 1 bag, walked once from front to back: indexed, unindexed, or damaged.

The index at a bag's end is not needed: chunks tell what they hold. It is asked for the definitions
of connections that lay in what was lost, and compared with what was read.
"""

from __future__ import annotations

import struct
from typing import BinaryIO, Final

from civil_rgbd.conversion.bag_index import counts_claimed
from civil_rgbd.conversion.bag_records import (
    BAG_HEADER,
    CHUNK,
    CHUNK_HEAD,
    CHUNK_HEAD_BYTES,
    CONNECTION,
    MAGIC,
    MESSAGE,
    MESSAGE_HEAD_BYTES,
    BagError,
    Head,
    Read,
    fields_of,
    head_at,
    is_unclosed,
    message_head,
    records_of,
    time_ns,
    within,
)
from civil_rgbd.conversion.compression import ChunkError, UnknownCompressionError
from civil_rgbd.conversion.container import (
    NO_CHUNK,
    Extent,
    Sink,
    SinkFor,
)
from civil_rgbd.storage.places import Place

_BUFFER_BYTES: Final = 1 << 14  # small messages lie close together, large ones are stepped over
_SCAN_BYTES: Final = 1 << 20
_START_BYTES: Final = 4096  # holds most small messages, and the header of every large one


def walk(path: Place, sink_for: SinkFor, size_bytes: int, base: int = 0) -> Extent:
    """Read every record of a bag once, and hand each message to its connection's sink.

    Memory holds one compressed chunk at a time. Damage does not stop the walk: it is noted, and
    the walk goes on with the next chunk.

    Args:
        path: a bag of version 2.0.
        sink_for: called with topic, type and encoding of each connection; None = not of interest.
        size_bytes: the file's length.
        base: added to the places, for a file that goes on from others.

    Raises:
        OSError: the file cannot be read.
    """
    with path.open("rb", buffering=_BUFFER_BYTES) as file:
        return _Walk(file, sink_for, size_bytes, base).run()


class _Walk:
    def __init__(self, file: BinaryIO, sink_for: SinkFor, size_bytes: int, base: int) -> None:
        self._file, self._sink_for = file, sink_for
        self._size, self._base = size_bytes, base
        self._sinks: dict[int, Sink | None] = {}
        self._extent = Extent(span=size_bytes)
        self._index_at = self._chunks_claimed = self._chunks_seen = 0
        self._chunk_end = 0  # of the uncompressed chunk that the walk is in
        self._cut_chunk = False
        self._counts: dict[int, int] = {}  # messages of each connection

    def run(self) -> Extent:
        at: int | None = len(MAGIC)
        while at is not None and at < self._size:
            at = self._record(at)
        self._judge_the_end()
        return self._extent

    def _read(self, at: int, length: int) -> bytes:
        self._file.seek(at)
        return self._file.read(length)

    def _record(self, at: int) -> int | None:
        """Read the record at ``at``; return where to go on, None at the end."""
        start = self._read(at, _START_BYTES)
        message = message_head(start)
        if message is not None:
            offset = at + MESSAGE_HEAD_BYTES
            after = offset + message[2]
            if after <= (self._chunk_end if at < self._chunk_end else self._size):
                if after <= at + _START_BYTES:
                    self._message(message, within(start, at), offset, NO_CHUNK)
                else:
                    self._message(message, self._read, offset, NO_CHUNK)
                return after
        try:
            head = head_at(self._read, at, self._size)
            if head.operation == CHUNK:
                return self._chunk(at, head)
            if head.data + head.length > self._size:
                return self._lost(at, f"is cut inside a record of {head.length} bytes")
            self._other(head, self._read)
        except (BagError, struct.error) as error:
            return self._lost(at, f"has no record where one begins ({error})")
        return head.data + head.length

    def _other(self, head: Head, read: Read) -> None:
        """Take a record that is neither chunk nor an ordinary message."""
        if head.operation == CONNECTION:
            self._define(head, read(head.data, head.length))
        elif head.operation == BAG_HEADER:
            self._index_at = head.number("index_pos")
            self._chunks_claimed = head.number("chunk_count")
        elif head.operation == MESSAGE:  # with more fields in its header than others write
            time = time_ns(head.fields.get("time", b""))
            message = head.number("conn"), time, head.length
            self._message(message, read, head.data, NO_CHUNK)

    def _chunk(self, at: int, head: Head) -> int | None:
        after = head.data + head.length
        self._chunks_seen += after <= self._size
        if head.text("compression") == "none":
            self._chunk_end = min(after, self._size)
            self._cut_chunk |= after > self._size
            return head.data  # its records lie open
        if is_unclosed(head):
            self._note(at, "was not closed: its last chunk is cut")
            after = self._size
        try:
            stored = self._read(head.data, min(after, self._size) - head.data)
            records = records_of(head, memoryview(stored))
        except ChunkError as error:
            self._extent.unknown_compression |= isinstance(error, UnknownCompressionError)
            self._extent.damage.append(f"the chunk at byte {at} is not readable: {error}")
        else:
            whole = self._records_in_chunk(at, records)
            if not whole and after <= self._size and not is_unclosed(head):
                self._extent.damage.append(f"the chunk at byte {at} ends inside a record")
        if after > self._size:
            self._note(at, f"is cut inside a record of {head.length} bytes")
        return after

    def _records_in_chunk(self, start: int, records: memoryview) -> bool:
        read, at, end = within(records, 0), 0, len(records)
        while at < end:
            message = message_head(records[at : at + MESSAGE_HEAD_BYTES])
            if message is not None and at + MESSAGE_HEAD_BYTES + message[2] <= end:
                self._message(message, read, at + MESSAGE_HEAD_BYTES, start)
                at += MESSAGE_HEAD_BYTES + message[2]
                continue
            try:
                head = head_at(read, at, end)
                if head.data + head.length > end:
                    return False
                if head.operation == MESSAGE:
                    time = time_ns(head.fields.get("time", b""))
                    self._message((head.number("conn"), time, head.length), read, head.data, start)
                else:
                    self._other(head, read)
            except (BagError, struct.error):
                return False
            at = head.data + head.length
        return True

    def _message(
        self, message: tuple[int, int, int], read: Read, offset: int, chunk_start: int
    ) -> None:
        connection, log_time_ns, length = message
        self._extent.count(log_time_ns)
        self._counts[connection] = self._counts.get(connection, 0) + 1
        if connection not in self._sinks:  # its definition lay in what was lost
            self._define_from_index(connection)
        sink = self._sinks[connection]
        if sink is None:
            return
        wanted = min(length, _START_BYTES) if sink.head_only else length
        payload = memoryview(read(offset, wanted))
        place = (
            (NO_CHUNK, self._base + offset, length)
            if chunk_start == NO_CHUNK
            else (self._base + chunk_start, offset, length)
        )
        sink.take(log_time_ns, place, payload)

    def _define(self, head: Head, data: bytes | memoryview) -> None:
        connection = head.number("conn")
        if connection in self._sinks:
            return
        description = fields_of(data)
        type_name = description.get("type", b"").decode("utf-8", errors="replace")
        topic = head.text("topic") or description.get("topic", b"").decode("utf-8", "replace")
        self._sinks[connection] = self._sink_for(topic, type_name, "ros1")

    def _define_from_index(self, connection: int) -> None:
        at = self._index_at
        try:
            while 0 < at < self._size:
                head = head_at(self._read, at, self._size)
                if head.operation != CONNECTION or head.data + head.length > self._size:
                    break
                self._define(head, self._read(head.data, head.length))
                at = head.data + head.length
        except (BagError, struct.error):
            pass  # what it defines no more is said below
        if connection not in self._sinks:
            self._sinks[connection] = None
            self._extent.damage.append(
                f"no record says what the messages of connection {connection} are"
            )

    def _lost(self, at: int, what: str) -> int | None:
        """Note damage, and return where the next chunk begins."""
        self._note(at, what)
        if at < self._chunk_end < self._size:
            return self._chunk_end
        return self._next_chunk(at + 1)

    def _next_chunk(self, at: int) -> int | None:
        while at < self._size:
            block = self._read(at, _SCAN_BYTES + CHUNK_HEAD_BYTES)
            match = CHUNK_HEAD.search(block)
            if match is not None:
                return at + match.start()
            at += _SCAN_BYTES
        return None

    @property
    def _all_chunks_seen(self) -> bool:
        return self._index_at > 0 and self._chunks_seen >= self._chunks_claimed

    def _note(self, at: int, what: str) -> None:
        if self._all_chunks_seen and at >= self._chunk_end:
            self._extent.remarks.append(
                f"the index {what} (byte {at} of {self._size}); no message is lost"
            )
        else:
            self._extent.damage.append(f"the file {what}, at byte {at} of {self._size}")

    def _judge_the_end(self) -> None:
        extent = self._extent
        if self._cut_chunk and not extent.damage:
            extent.damage.append("the file is cut inside its last chunk")
        if self._index_at and self._chunks_seen < self._chunks_claimed:
            if not extent.damage:
                extent.damage.append(
                    f"{self._chunks_seen} of {self._chunks_claimed} chunks are there"
                )
        elif not self._index_at:
            extent.remarks.append(
                "the bag has no index, as its recorder did not close it; it was read from front to "
                "back"
            )
        elif not extent.damage:
            self._compare_with_the_index()
        extent.whole = not extent.damage

    def _compare_with_the_index(self) -> None:
        claimed = counts_claimed(self._file, self._index_at, self._size)
        if claimed is None:
            return  # it is cut: the walk has met that and remarked it
        wrong = sum(
            self._counts.get(key, 0) != claimed.get(key, 0) for key in self._counts | claimed
        )
        if wrong:
            self._extent.remarks.append(
                f"the bag's index counts {sum(claimed.values())} messages, {self._extent.messages} "
                f"are there ({wrong} connections differ); all that are there were read"
            )
