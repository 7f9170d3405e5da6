"""Single messages of a rosbag2 SQLite file, fetched by their row."""

from __future__ import annotations

import sqlite3
from pathlib import Path
from typing import Any

from civil_rgbd.conversion.compression import ChunkError, message_of
from civil_rgbd.conversion.db3_container import connect
from civil_rgbd.conversion.file_payloads import changed, no_longer


class Db3Payloads:
    """Random access to messages; opens its database when first asked, in whatever process."""

    def __init__(self, path: Path, size_bytes: int) -> None:
        self._path, self._size_bytes = path, size_bytes
        self._database: sqlite3.Connection | None = None

    def __reduce__(self) -> tuple[Any, ...]:
        return (Db3Payloads, (self._path, self._size_bytes))

    def fetch(self, chunk_start: int, offset: int, length: int) -> memoryview:
        """Return one message's payload.

        Args:
            chunk_start: -1, there are no chunks.
            offset: its row.
            length: of the payload as stored.

        Raises:
            RecordingError: the file is gone, changed, or cannot be read.
        """
        del chunk_start
        try:
            row = self._opened().execute("SELECT data FROM messages WHERE id = ?", (offset,))
            (data,) = row.fetchone() or (None,)
            if not isinstance(data, bytes) or len(data) != length:
                raise changed(self._path)
            return message_of(memoryview(data))
        except (OSError, sqlite3.Error, ChunkError) as error:
            raise no_longer(self._path, error) from error

    def _opened(self) -> sqlite3.Connection:
        if self._database is None:
            if self._path.stat().st_size != self._size_bytes:
                raise changed(self._path)
            self._database = connect(self._path)
            self._database.execute("PRAGMA writable_schema = ON")  # as while it was walked
        return self._database

    def close(self) -> None:
        """Let go of the database; the next fetch opens it again."""
        if self._database is not None:
            self._database.close()
        self._database = None

    def __del__(self) -> None:
        self.close()
