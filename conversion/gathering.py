"""What is kept of each message while a recording is walked once: stamps, places, poses, links.

Payloads are not kept: memory grows with the number of messages, not with their size.
"""

from __future__ import annotations

import struct
from array import array
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.conversion.cdr import CdrError, CdrReader, frame_name
from civil_rgbd.conversion.path_poses import PathPoses, poses_of_path

Place = tuple[int, int, int]
"""Chunk start (or -1), offset of the payload, its length.

Where a recording has several files, places count on from one file to the next.
"""

_UINT32: Final = {order: struct.Struct(order + "I") for order in "<>"}
_UINT64: Final = {order: struct.Struct(order + "Q") for order in "<>"}
_POSE: Final = {order: struct.Struct(order + "7d") for order in "<>"}


@dataclass(frozen=True, slots=True, eq=False)
class MessageIndex:
    """Where the messages of one topic lie, in message order.

    Attributes:
        places: (M, 3) int64: chunk start (or -1), offset, length.
        stamps_ns: (M,) int64 header stamps.
    """

    places: NDArray[np.int64]
    stamps_ns: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.stamps_ns)

    def place(self, index: int) -> Place:
        """Return where one message lies."""
        chunk_start, offset, length = self.places[index].tolist()
        return chunk_start, offset, length


class Gathered:
    """Messages of one topic: where they lie, when they were logged, what their headers say.

    ``fault`` is the first thing that broke a message's layout, ``faults`` how many messages did; it
    matters only if the topic is chosen. ``frames`` counts the messages of each frame id. ``read``
    reads their encoding.
    """

    head_only = False
    read: type[CdrReader] = CdrReader

    def __init__(self) -> None:
        self._rows = array("q")  # log time, chunk start, offset, length, stamp
        self.frames: dict[str, int] = {}
        self.fault: str | None = None
        self.faults = 0
        self.first: bytes = b""
        self.count = 0

    def take(self, log_time_ns: int, place: Place, payload: memoryview) -> None:
        """Keep what is needed of one message."""
        try:
            self._take(log_time_ns, place, payload)
        except CdrError as error:
            self.fault = self.fault or f"message {self.count}: {error}"
            self.faults += 1
        self.count += 1

    def _take(self, log_time_ns: int, place: Place, payload: memoryview) -> None:
        stamp_ns, frame, end = self.read.stamp_and_frame(payload)
        self._keep(log_time_ns, place, stamp_ns, frame)
        if self.count == 0:
            self.first = bytes(payload[:4096])
        self._look(payload, stamp_ns, end)

    def _keep(self, log_time_ns: int, place: Place, stamp_ns: int, frame: bytes) -> None:
        name = frame_name(frame.decode("utf-8", errors="replace"))
        self.frames[name] = self.frames.get(name, 0) + 1
        self._rows.extend((log_time_ns % (1 << 63), *place, stamp_ns))

    def _look(self, payload: memoryview, stamp_ns: int, header_end: int) -> None:
        """Keep more than the header; kinds of messages differ here."""

    @property
    def frame(self) -> str:
        """The frame id of most messages; empty when there are none."""
        return max(self.frames, key=lambda name: self.frames[name], default="")

    def _order(self) -> tuple[NDArray[np.int64], NDArray[np.intp]]:
        rows = np.frombuffer(self._rows, dtype=np.int64).reshape(-1, 5)
        in_file = np.where(rows[:, 1] >= 0, rows[:, 1], rows[:, 2])
        return rows, np.lexsort((rows[:, 2], in_file, rows[:, 0]))

    def index(self) -> MessageIndex:
        """Return the messages in order of log time, ties by place in the file."""
        rows, order = self._order()
        return MessageIndex(rows[order, 1:4].copy(), rows[order, 4].copy())


class GatheredSensor(Gathered):
    """Clouds and images: headers only."""

    head_only = True


class GatheredLivox(Gathered):
    """Livox CustomMsg; watches how far ``timebase`` is off the header's stamp."""

    head_only = True

    def __init__(self) -> None:
        super().__init__()
        self.timebase_off_ns = 0

    def _look(self, payload: memoryview, stamp_ns: int, header_end: int) -> None:
        at = self.read.aligned(header_end, 8)
        if at + 8 <= len(payload):
            (timebase_ns,) = _UINT64[self.read.order_of(payload)].unpack_from(payload, at)
            off_ns = timebase_ns - stamp_ns
            if abs(off_ns) > abs(self.timebase_off_ns):
                self.timebase_off_ns = off_ns


class GatheredPaths(Gathered):
    """nav_msgs/Path: the poses of all messages together."""

    def __init__(self) -> None:
        super().__init__()
        self.path = PathPoses()

    def _look(self, payload: memoryview, stamp_ns: int, header_end: int) -> None:
        del stamp_ns, header_end
        self.path.add(self._rows[-5], *poses_of_path(payload, self.read))


class GatheredPoses(Gathered):
    """Odometry, PoseStamped, PoseWithCovarianceStamped: every pose is kept."""

    def __init__(self, *, has_child_frame: bool) -> None:
        super().__init__()
        self._has_child_frame = has_child_frame
        self._poses = array("d")
        self.children: dict[str, int] = {}

    def _look(self, payload: memoryview, stamp_ns: int, header_end: int) -> None:
        del stamp_ns
        order, at = self.read.order_of(payload), header_end
        try:
            if self._has_child_frame:
                at = self.read.aligned(at, 4)
                (length,) = _UINT32[order].unpack_from(payload, at)
                child = bytes(payload[at + 4 : at + 4 + length]).rstrip(b"\0")
                name = frame_name(child.decode("utf-8", errors="replace"))
                self.children[name] = self.children.get(name, 0) + 1
                at += 4 + length
            at = self.read.aligned(at, 8)
            pose = _POSE[order].unpack_from(payload, at)
        except struct.error as error:
            del self._rows[-5:]
            raise CdrError("it ends before its pose does") from error
        self._poses.extend(pose)

    def poses(self) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return stamps (P,) int64 and poses (P, 7) float64, tx ty tz qx qy qz qw."""
        rows, order = self._order()
        return rows[order, 4].copy(), np.frombuffer(self._poses).reshape(-1, 7)[order]


class GatheredCameraInfo(Gathered):
    """CameraInfo: the first message whole, and how many others say something else."""

    def __init__(self) -> None:
        super().__init__()
        self.message: bytes = b""
        self._earliest = (1 << 63, 0, 0)
        self._contents: dict[bytes, int] = {}

    def _look(self, payload: memoryview, stamp_ns: int, header_end: int) -> None:
        del stamp_ns
        content = bytes(payload[header_end:])
        self._contents[content] = self._contents.get(content, 0) + 1
        log_time_ns, chunk_start, offset = self._rows[-5:-2]
        if (log_time_ns, max(chunk_start, 0), offset) < self._earliest:
            self._earliest = (log_time_ns, max(chunk_start, 0), offset)
            self.message = bytes(payload)

    @property
    def differing(self) -> int:
        """How many messages differ from the first, headers aside."""
        _, _, end = self.read.stamp_and_frame(memoryview(self.message))
        return sum(self._contents.values()) - self._contents.get(self.message[end:], 0)


class GatheredFrame(Gathered):
    """Imu: only the frame of the first whole message is of interest."""

    head_only = True

    def take(self, log_time_ns: int, place: Place, payload: memoryview) -> None:
        """Look at the first message that is whole only: there are hundreds a second."""
        if not self.frames:
            super().take(log_time_ns, place, payload)
        else:
            self.count += 1


@dataclass(slots=True)
class LinkHistory:
    """Transforms of one (parent, child) over time: log times, stamps, seven numbers each."""

    log_times_ns: array[int]
    stamps_ns: array[int]
    poses: array[float]

    def in_order(self) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return stamps (P,) and poses (P, 7) in order of log time, ties by place in the file."""
        order = np.argsort(np.array(self.log_times_ns, dtype=np.int64), kind="stable")
        poses = np.array(self.poses, dtype=np.float64).reshape(-1, 7)
        return np.array(self.stamps_ns, dtype=np.int64)[order], poses[order]


class GatheredTransforms(Gathered):
    """tf and tf_static: for each (parent, child) its transforms over time."""

    def __init__(self) -> None:
        super().__init__()
        self.links: dict[tuple[str, str], LinkHistory] = {}

    def _take(self, log_time_ns: int, place: Place, payload: memoryview) -> None:
        del place
        reader = self.read(payload)
        for _ in range(reader.count(smallest_bytes=72)):
            stamp_ns, parent = reader.header()
            link = parent, frame_name(reader.text())
            pose = reader.float64s(7)
            if link not in self.links:
                self.links[link] = LinkHistory(array("q"), array("q"), array("d"))
            history = self.links[link]
            history.log_times_ns.append(log_time_ns % (1 << 63))
            history.stamps_ns.append(stamp_ns)
            history.poses.extend(pose)
