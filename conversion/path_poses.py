"""Poses of nav_msgs/Path: each message may repeat, go on from or correct the ones before."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.constants import NS_PER_S
from civil_rgbd.conversion.cdr import CdrReader

_POSE_BYTES: Final = 56
_SMALLEST_BYTES: Final = 68  # two numbers of the stamp, the length of the frame id, the pose
_FIRST_SLOWLY: Final = 2  # the first record may be padded otherwise than all others


def poses_of_path(
    payload: memoryview, read: type[CdrReader] = CdrReader
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Read a ``nav_msgs/Path``: stamps (P,) and poses (P, 7), by the stamps of its poses.

    Args:
        payload: the message.
        read: reads its encoding.

    Raises:
        CdrError: it breaks its layout.
    """
    reader = read(payload)
    reader.header()
    count = reader.count(_SMALLEST_BYTES)
    stamps_ns = np.empty(count, dtype=np.int64)
    poses = np.empty((count, 7))
    start = reader.at
    for row in range(count):
        if row == _FIRST_SLOWLY and _all_alike(payload, reader, start, count - 1):
            stamps_ns[1:], poses[1:] = _at_once(payload, reader, start, count - 1)
            break
        start = reader.at
        stamps_ns[row], _ = reader.header()
        poses[row] = reader.float64s(7)
    return stamps_ns, poses


def _records(payload: memoryview, reader: CdrReader, start: int, count: int) -> NDArray[np.uint8]:
    """Return what would be the records, all as long as the one from ``start`` to the cursor."""
    stride = reader.at - start
    data = np.frombuffer(payload, dtype=np.uint8)[start : start + count * stride]
    return data[: len(data) // stride * stride].reshape(-1, stride)


def _heads(records: NDArray[np.uint8], reader: CdrReader) -> NDArray[np.uint32]:
    """Return seconds, nanoseconds and length of the frame id, (N, 3)."""
    at = reader.SECONDS_AT
    return np.ascontiguousarray(records[:, at : at + 12]).view(reader.order + "u4")


def _all_alike(payload: memoryview, reader: CdrReader, start: int, count: int) -> bool:
    """Tell whether frame ids are equally long: a path may have 10,000 poses, and grow."""
    records = _records(payload, reader, start, count)
    lengths = _heads(records, reader)[:, 2]
    return len(records) == count and bool((lengths == lengths[0]).all())


def _at_once(
    payload: memoryview, reader: CdrReader, start: int, count: int
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    records = _records(payload, reader, start, count)
    heads = _heads(records, reader).astype(np.int64)
    numbers = np.ascontiguousarray(records[:, -_POSE_BYTES:]).view(reader.order + "f8")
    return heads[:, 0] * NS_PER_S + heads[:, 1], numbers.astype(np.float64)


class PathPoses:
    """All poses of one topic's Paths, by stamp; where several messages say one, the latest does.

    SLAM corrects what it said before, so later is better; and some publishers send only the last
    few poses. Memory grows with the poses, not with the messages.

    Attributes:
        unordered: messages whose own stamps do not ascend; their poses are not among the others.
    """

    def __init__(self) -> None:
        self._stamps_ns = np.empty(0, dtype=np.int64)
        self._logs_ns = np.empty(0, dtype=np.int64)
        self._poses = np.empty((0, 7))
        self._count = 0
        self._unordered: tuple[NDArray[np.int64], NDArray[np.float64]] | None = None
        self.unordered = 0

    def add(
        self, log_time_ns: int, stamps_ns: NDArray[np.int64], poses: NDArray[np.float64]
    ) -> None:
        """Add one message.

        Args:
            log_time_ns: tells which message is later; of equals the one that is added later.
            stamps_ns: (P,).
            poses: (P, 7).
        """
        if (stamps_ns[1:] <= stamps_ns[:-1]).any():
            self._unordered = self._unordered or (stamps_ns, poses)
            self.unordered += 1
            return
        if not len(stamps_ns):
            return
        known = slice(
            int(np.searchsorted(self._stamps_ns[: self._count], stamps_ns[0])), self._count
        )
        columns = (stamps_ns, np.full(len(stamps_ns), log_time_ns, dtype=np.int64), poses)
        if not self._goes_on(known, stamps_ns, log_time_ns):
            columns = self._merged(known, columns)
        self._count = known.start + len(columns[0])
        self._make_room()
        written = slice(known.start, self._count)
        self._stamps_ns[written], self._logs_ns[written], self._poses[written] = columns

    def _goes_on(self, known: slice, stamps_ns: NDArray[np.int64], log_time_ns: int) -> bool:
        """Tell whether a later message says all that is known from its first stamp on, and more."""
        count = known.stop - known.start
        return not count or (
            int(self._logs_ns[known].max()) <= log_time_ns
            and np.array_equal(self._stamps_ns[known], stamps_ns[:count])
        )

    def _merged(
        self,
        known: slice,
        columns: tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]],
    ) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
        stamps_ns = np.concatenate([self._stamps_ns[known], columns[0]])
        logs_ns = np.concatenate([self._logs_ns[known], columns[1]])
        poses = np.concatenate([self._poses[known], columns[2]])
        order = np.lexsort((logs_ns, stamps_ns))
        last = np.append(np.diff(stamps_ns[order]) > 0, True)
        order = order[last]
        return stamps_ns[order], logs_ns[order], poses[order]

    def _make_room(self) -> None:
        if self._count <= len(self._stamps_ns):
            return
        room = 2 * self._count - len(self._stamps_ns)
        self._stamps_ns = np.concatenate([self._stamps_ns, np.zeros(room, dtype=np.int64)])
        self._logs_ns = np.concatenate([self._logs_ns, np.zeros(room, dtype=np.int64)])
        self._poses = np.concatenate([self._poses, np.zeros((room, 7))])

    @property
    def from_earlier_messages(self) -> int:
        """How many poses the latest message does not say."""
        logs_ns = self._logs_ns[: self._count]
        return int((logs_ns < logs_ns.max()).sum()) if self._count else 0

    def together(self, *, salvage: bool = False) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return stamps (P,) and poses (P, 7).

        They ascend, unless the stamps of some message do not: then only that message's, as it is.

        Args:
            salvage: leave such messages out, where there are others.
        """
        if self._unordered is not None and not (salvage and self._count):
            return self._unordered
        return self._stamps_ns[: self._count].copy(), self._poses[: self._count].copy()
