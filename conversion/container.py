"""What a walk over one file of a recording finds, and what every kind of container offers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.storage.places import Place

NO_CHUNK: Final = -1
"""In place of a chunk's start, for messages that lie outside of compressed chunks."""

HEAD_BYTES: Final = 1 << 17
"""Enough for a header, and for one block of a compressed message."""

SMALL_MESSAGE_BYTES: Final = 1 << 14
"""Reading so much at once costs no more than reading its head."""


class Sink(Protocol):
    """What takes the messages of one channel; ``head_only`` when large ones may come cut."""

    @property
    def head_only(self) -> bool:
        """Whether large messages may come cut."""

    def take(self, log_time_ns: int, place: tuple[int, int, int], payload: memoryview) -> None:
        """Take one message; ``place`` is chunk start (or -1), offset, length."""


SinkFor = Callable[[str, str, str], Sink | None]
"""Called with topic, type and encoding of each channel; None = not of interest."""


@dataclass(slots=True)
class Extent:
    """What a walk found.

    Attributes:
        span: places of the file's messages lie below this, counted from the file's own base.
        messages: how many messages could be read, of all topics.
        first_ns: earliest log time.
        last_ns: latest log time.
        damage: what could not be read, in words, in order.
        remarks: what is odd though nothing is lost.
        unknown_compression: a chunk is compressed in a way that is not known.
        whole: the data section was read to its end.
        simulated: a metadata record says that a simulator wrote the file.
    """

    span: int = 0
    messages: int = 0
    first_ns: int = 1 << 63
    last_ns: int = 0
    damage: list[str] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)
    unknown_compression: bool = False
    whole: bool = False
    simulated: bool = False

    def count(self, log_time_ns: int) -> None:
        """Count one message that could be read."""
        self.messages += 1
        self.first_ns = min(self.first_ns, log_time_ns)
        self.last_ns = max(self.last_ns, log_time_ns)

    @property
    def duration_s(self) -> float:
        """Seconds between the first and the last readable message."""
        return max(0, self.last_ns - self.first_ns) / 1e9 if self.messages else 0.0

    def add(self, other: Extent, name: str) -> None:
        """Add what the walk over the next file, ``name``, found."""
        self.span += other.span
        self.messages += other.messages
        self.first_ns = min(self.first_ns, other.first_ns)
        self.last_ns = max(self.last_ns, other.last_ns)
        self.damage += [f"{name}: {what}" for what in other.damage]
        self.remarks += [f"{name}: {what}" for what in other.remarks]
        self.unknown_compression |= other.unknown_compression
        self.whole &= other.whole
        self.simulated |= other.simulated


@dataclass(frozen=True, slots=True, eq=False)
class IndexedTopic:
    """One channel as a file's own index has it.

    Attributes:
        topic: its name.
        type_name: as the file says it.
        encoding: of its messages.
        log_times_ns: (M,) int64, ascending.
    """

    topic: str
    type_name: str
    encoding: str
    log_times_ns: NDArray[np.int64]


def no_index(_path: Place) -> None:
    """Say that a kind of file has no index to go by."""


class FilePayloads(Protocol):
    """Fetches single messages of one file; can be pickled."""

    def fetch(self, chunk_start: int, offset: int, length: int) -> memoryview:
        """Return one message's payload.

        Raises:
            RecordingError: it cannot be read any more.
        """

    def close(self) -> None:
        """Let go of the file; the next fetch opens it again."""


@dataclass(frozen=True, slots=True)
class Container:
    """One kind of file with messages in it.

    Attributes:
        name: of the converter, for the manifest.
        refuse: raises RecordingError for a file that is of another kind: given its path and its
            first bytes.
        walk: reads every record of a file once, and hands each message to its channel's sink:
            given path, sinks, the file's length, and the base from which its places count.
        payloads: given path and length, fetches messages by places that count from 0.
        recompress: what to do about a compression that is not known.
        index: reads the index of a file, no message; None where there is none that accounts for
            the whole file.
    """

    name: str
    refuse: Callable[[Place, bytes], None]
    walk: Callable[[Place, SinkFor, int, int], Extent]
    payloads: Callable[[Place, int], FilePayloads]
    recompress: str
    index: Callable[[Place], tuple[IndexedTopic, ...] | None] = no_index
