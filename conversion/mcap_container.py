"""The records of an MCAP file, walked once from front to back: whole, without summary, or cut."""

from __future__ import annotations

import contextlib
import struct
from typing import BinaryIO, Final

from civil_rgbd.conversion.compression import ChunkError, UnknownCompressionError, message_of
from civil_rgbd.conversion.container import HEAD_BYTES, NO_CHUNK, Extent, Sink, SinkFor
from civil_rgbd.conversion.mcap_chunks import parse_chunk, records_of, strings_in
from civil_rgbd.conversion.mcap_summary import Summary, read_summary
from civil_rgbd.storage.places import Place

MAGIC: Final = b"\x89MCAP0\r\n"
RECORD: Final = struct.Struct("<BQ")
"""Opcode and length, before every record."""
MESSAGE: Final = struct.Struct("<HIQQ")
"""channel, sequence, log time, publish time, before every payload."""
FOOTER, SCHEMA, CHANNEL, MESSAGE_OP, CHUNK, METADATA, DATA_END = 2, 3, 4, 5, 6, 0x0C, 0x0F

_SMALL_MESSAGE_BYTES = 1 << 20
_LARGEST_READ = 1 << 32  # a damaged length must not ask for the whole file at once


def walk(path: Place, sink_for: SinkFor, *, size_bytes: int, base: int = 0) -> Extent:
    """Read every record of a file once, and hand each message to its channel's sink.

    Memory holds one chunk at a time. Damage does not stop the walk: it is noted, and what follows
    is read where the summary tells the way.

    Args:
        path: an MCAP file.
        sink_for: called with topic, type and encoding of each channel; None = not of interest.
        size_bytes: the file's length.
        base: added to the places, for a file that goes on from others.

    Returns:
        what there was.

    Raises:
        OSError: the file cannot be read.
    """
    with path.open("rb") as file:
        return _Walk(file, size_bytes, sink_for, base).run()


class _Walk:
    def __init__(self, file: BinaryIO, size_bytes: int, sink_for: SinkFor, base: int) -> None:
        self._file, self._size, self._sink_for = file, size_bytes, sink_for
        self._base = base
        self._schemas: dict[int, str] = {}
        self._sinks: dict[int, Sink | None] = {}
        self._chunks_seen: set[int] = set()
        self._summary: Summary | None = None
        self._extent = Extent(span=size_bytes)

    def run(self) -> Extent:
        at: int | None = len(MAGIC)
        while at is not None:
            at = self._record(at)
        self._chunks_that_the_walk_missed()
        return self._extent

    def _record(self, at: int) -> int | None:
        """Read the record at ``at``; return where the next one is, None at the end."""
        self._file.seek(at)
        head = self._file.read(RECORD.size)
        if len(head) < RECORD.size:
            self._note(at, "ends there without a footer")
            return None
        opcode: int = head[0]
        length = int.from_bytes(head[1:], "little")
        body, after = at + RECORD.size, at + RECORD.size + length
        if opcode == DATA_END or (opcode == FOOTER and not self._extent.whole):
            self._extent.whole = True
        if opcode == 0:
            self._note(at, "has no record where one begins")
            return None
        if opcode == CHUNK:
            self._chunk(at, min(length, self._size - body, _LARGEST_READ), cut=after > self._size)
        if after > self._size:
            self._note(at, f"is cut inside a record of {length} bytes")
            return None
        if opcode == FOOTER:
            return None
        if opcode in (SCHEMA, CHANNEL):
            self._definition(opcode, memoryview(self._file.read(length)))
        elif opcode == MESSAGE_OP:
            self._message_outside_of_chunks(body, length)
        elif opcode == METADATA and length < _SMALL_MESSAGE_BYTES:
            self._metadata(memoryview(self._file.read(length)))
        return after

    def _metadata(self, record: memoryview) -> None:
        with contextlib.suppress(struct.error, ValueError):  # no message depends on it
            (name_length,) = struct.unpack_from("<I", record)
            (name,) = strings_in(record, 0)
            # After the name a map: its length in bytes, then keys and values.
            key, value = strings_in(record, 8 + name_length, 2)
            self._extent.simulated |= (name, key, value) == ("civil_rgbd", "origin", "simulated")

    def _note(self, at: int, what: str) -> None:
        if self._extent.whole:
            self._extent.remarks.append(
                f"the summary {what} (byte {at} of {self._size}); no message is lost"
            )
        else:
            self._extent.damage.append(f"the file {what}, at byte {at} of {self._size}")

    def _chunks_that_the_walk_missed(self) -> None:
        for start in self._known_summary().chunk_starts:
            if start in self._chunks_seen or not len(MAGIC) <= start <= self._size - RECORD.size:
                continue
            self._file.seek(start)
            opcode, length = RECORD.unpack(self._file.read(RECORD.size))
            if opcode == CHUNK and start + RECORD.size + length <= self._size:
                if not self._extent.damage:
                    self._extent.damage.append(f"the records lead past the chunk at byte {start}")
                self._chunk(start, length, cut=False)

    def _chunk(self, start: int, length: int, *, cut: bool) -> None:
        self._chunks_seen.add(start)
        try:
            body = memoryview(self._file.read(length))
            records = records_of(parse_chunk(body, cut=cut))
            whole = self._records_in_chunk(start, records)
        except ChunkError as error:
            self._extent.unknown_compression |= isinstance(error, UnknownCompressionError)
            self._extent.damage.append(f"the chunk at byte {start} is not readable: {error}")
            return
        if not whole and not cut:
            self._extent.damage.append(f"the chunk at byte {start} ends inside a record")

    def _records_in_chunk(self, start: int, records: memoryview) -> bool:
        at, end = 0, len(records)
        while at + RECORD.size <= end:
            opcode, length = RECORD.unpack_from(records, at)
            body = at + RECORD.size
            at = body + length
            if at > end:
                return False
            if opcode == MESSAGE_OP:
                if length < MESSAGE.size:
                    return False
                channel, _, log_time_ns, _ = MESSAGE.unpack_from(records, body)
                sink = self._sink(channel, log_time_ns)
                if sink is not None:
                    offset = body + MESSAGE.size
                    place = (self._base + start, offset, at - offset)
                    self._hand_over(sink, log_time_ns, place, records[offset:at])
            elif opcode in (SCHEMA, CHANNEL):
                self._definition(opcode, records[body:at])
        return at == end

    def _message_outside_of_chunks(self, body: int, length: int) -> None:
        if length < MESSAGE.size:
            self._extent.damage.append(f"the message at byte {body} is shorter than its head")
            return
        channel, _, log_time_ns, _ = MESSAGE.unpack(self._file.read(MESSAGE.size))
        sink = self._sink(channel, log_time_ns)
        if sink is not None:
            size = length - MESSAGE.size
            cut = sink.head_only and size > _SMALL_MESSAGE_BYTES
            payload = memoryview(self._file.read(HEAD_BYTES if cut else size))
            place = (NO_CHUNK, self._base + body + MESSAGE.size, size)
            self._hand_over(sink, log_time_ns, place, payload)

    def _hand_over(
        self, sink: Sink, log_time_ns: int, place: tuple[int, int, int], payload: memoryview
    ) -> None:
        try:
            message = message_of(payload, HEAD_BYTES if sink.head_only else -1)
        except ChunkError as error:
            self._extent.damage.append(f"in the message at byte {place[1]}: {error}")
            return
        sink.take(log_time_ns, place, message)

    def _sink(self, channel: int, log_time_ns: int) -> Sink | None:
        self._extent.count(log_time_ns)
        if channel not in self._sinks:  # its definition lay in what was lost
            self._define_from_summary(channel)
        return self._sinks[channel]

    def _define_from_summary(self, channel: int) -> None:
        self._sinks[channel] = None
        for schema in self._known_summary().schemas:
            self._definition(SCHEMA, schema)
        for record in self._known_summary().channels:
            if struct.unpack_from("<H", record)[0] == channel:
                del self._sinks[channel]
                self._definition(CHANNEL, record)

    def _definition(self, opcode: int, record: memoryview) -> None:
        try:
            if opcode == SCHEMA:
                (number,) = struct.unpack_from("<H", record)
                self._schemas.setdefault(number, next(strings_in(record, 2)))
                return
            number, schema = struct.unpack_from("<HH", record)
            topic, encoding, *_ = strings_in(record, 4, 2)
        except (struct.error, StopIteration, ValueError):
            self._extent.damage.append("a schema or channel record is shorter than it claims")
            return
        if number not in self._sinks:
            self._sinks[number] = self._sink_for(topic, self._schemas.get(schema, ""), encoding)

    def _known_summary(self) -> Summary:
        if self._summary is None:
            self._summary = read_summary(self._file, self._size)
        return self._summary
