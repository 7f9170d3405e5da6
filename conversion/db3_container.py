"""The messages of a rosbag2 SQLite file, walked once in the order of their rows."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any, Final

from civil_rgbd.conversion.compression import ChunkError, message_of
from civil_rgbd.conversion.container import (
    HEAD_BYTES,
    NO_CHUNK,
    SMALL_MESSAGE_BYTES,
    Extent,
    Sink,
    SinkFor,
)

MAGIC: Final = b"SQLite format 3\0"

_LARGEST_ROW: Final = 1 << 48
_TRIES_BEHIND_A_HOLE: Final = 48
# Large messages of topics whose head is enough are not read here: SQLite would read all of them.
_ROWS: Final = f"""
    SELECT id, topic_id, timestamp, length(data),
           CASE WHEN length(data) <= {SMALL_MESSAGE_BYTES} OR topic_id IN (%s) THEN data END
    FROM messages WHERE id > ? ORDER BY id
"""  # noqa: S608 - numbers of our own


def connect(path: Path) -> sqlite3.Connection:
    """Open a database for reading only; nothing is created beside it.

    A log beside it (``-wal``) holds what the recorder had not yet moved into the file: then the
    file may not be taken for immutable.

    Raises:
        sqlite3.Error: it cannot be opened.
    """
    log = path.with_name(path.name + "-wal")
    mode = "mode=ro" if log.exists() and log.stat().st_size else "mode=ro&immutable=1"
    uri = f"{path.absolute().as_uri()}?{mode}"
    # Closed by whichever thread collects it; never used by two at a time.
    return sqlite3.connect(uri, uri=True, check_same_thread=False)


def walk(path: Path, sink_for: SinkFor, size_bytes: int, base: int = 0) -> Extent:
    """Read every row once, and hand each message to its topic's sink.

    Args:
        path: a rosbag2 SQLite file.
        sink_for: called with topic, type and encoding of each topic; None = not of interest.
        size_bytes: the file's length.
        base: added to the places, for a file that goes on from others.

    Raises:
        OSError: the file cannot be read.
    """
    extent = Extent(span=size_bytes)
    journal = path.with_name(path.name + "-journal")
    if journal.exists() and journal.stat().st_size:
        extent.damage.append(f"{journal.name} lies beside it: the recorder did not finish")
    try:
        with closing(connect(path)) as database:
            # SQLite refuses a file that is shorter than it says, unless told that it is damaged.
            database.execute("PRAGMA writable_schema = ON")
            database.text_factory = bytes
            _Walk(database, sink_for, extent, base).run()
    except sqlite3.Error as error:
        extent.damage.append(f"the database cannot be read: {error}")
    extent.whole = not extent.damage
    return extent


class _Walk:
    def __init__(
        self, database: sqlite3.Connection, sink_for: SinkFor, extent: Extent, base: int
    ) -> None:
        self._database, self._extent, self._base = database, extent, base
        self._sinks: dict[Any, Sink | None] = {}
        self._define_topics(sink_for)

    def _define_topics(self, sink_for: SinkFor) -> None:
        rows = self._database.execute("SELECT id, name, type, serialization_format FROM topics")
        for number, *texts in rows:
            topic, type_name, encoding = (_text(value) for value in texts)
            self._sinks[number] = sink_for(topic, type_name, encoding)

    def run(self) -> None:
        whole = [
            str(number)
            for number, sink in self._sinks.items()
            if isinstance(number, int) and sink is not None and not sink.head_only
        ]
        query = _ROWS % ", ".join(whole)
        for row in self._rows(query):
            self._row(row)

    def _rows(self, query: str) -> Iterator[tuple[Any, ...]]:
        """Yield all rows; behind damaged pages those that can be found by their numbers."""
        last, step, tries = -1, 0, 0
        while tries <= _TRIES_BEHIND_A_HOLE:
            try:
                for row in self._database.execute(query, (last + step,)):
                    last, step = row[0], 0
                    yield row
            except sqlite3.Error as error:
                if not step:
                    self._extent.damage.append(
                        f"behind row {last} the database is damaged: {error}"
                    )
                step = 2 * step or 1
                tries += 1
            else:
                return

    def _row(self, row: tuple[Any, ...]) -> None:
        number, topic, log_time_ns, length, data = row
        well = all(isinstance(value, int) for value in (number, log_time_ns, length))
        if not well or topic not in self._sinks or not 0 <= number < _LARGEST_ROW:
            self._extent.damage.append(f"row {number} is no message of a topic that is described")
            return
        self._extent.count(log_time_ns)
        self._extent.span = max(self._extent.span, number + 1)
        sink = self._sinks[topic]
        if sink is None:
            return
        try:
            if data is None:
                with self._database.blobopen("messages", "data", number, readonly=True) as blob:
                    data = blob.read(HEAD_BYTES)
            message = message_of(memoryview(data), HEAD_BYTES if sink.head_only else -1)
        except (ChunkError, sqlite3.Error, TypeError) as error:  # the last: text or a number
            self._extent.damage.append(f"in row {number}: {error}")
            return
        sink.take(log_time_ns, (NO_CHUNK, self._base + number, length), message)


def _text(value: object) -> str:
    return value.decode("utf-8", errors="replace") if isinstance(value, bytes) else str(value)
