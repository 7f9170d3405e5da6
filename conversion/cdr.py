"""Common Data Representation: the byte layout of ROS 2 messages."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from contextlib import contextmanager
from typing import ClassVar, Final

from civil_rgbd.constants import NS_PER_S
from civil_rgbd.errors import RecordingError

ENCAPSULATION_BYTES: Final = 4
"""A payload starts with two bytes of representation and two of options; alignment counts after."""

_ORDERS: Final = {0: ">", 1: "<"}  # OMG DDSI-RTPS 2.5, 10.5: CDR_BE, CDR_LE
_OTHER_REPRESENTATIONS: Final = {
    2: "parameter-list CDR, big endian",
    3: "parameter-list CDR, little endian",
    6: "XCDR2, big endian",
    7: "XCDR2, little endian",
    8: "delimited XCDR2, big endian",
    9: "delimited XCDR2, little endian",
    10: "parameter-list XCDR2, big endian",
    11: "parameter-list XCDR2, little endian",
}


class CdrError(ValueError):
    """A payload breaks its layout; the caller knows which message it is."""


class ContentError(CdrError):
    """A payload keeps its layout, but what it says cannot be used; its remedy is known.

    Attributes:
        fix: what the reader can do next.
    """

    def __init__(self, what: str, fix: str) -> None:
        super().__init__(what)
        self.fix = fix


LAYOUT_FIX: Final = "record it again, or choose another topic; a damaged file may also do this"
"""What to do about a message that a recording cannot do without."""

SALVAGE_FIX: Final = "go on without it: --salvage; or record it again, if there are many"
"""What to do about one message of many."""


@contextmanager
def decoding(what: str, *, where: object, fix: str = LAYOUT_FIX) -> Iterator[None]:
    """Turn layout faults inside the block into one :class:`RecordingError`.

    Args:
        what: the message, for the reader: ``"PointCloud2 message 12"``.
        where: the file and topic.
        fix: what to do about a broken layout.

    Raises:
        RecordingError: the payload breaks its layout, or says what cannot be used.
    """
    try:
        yield
    except ContentError as error:
        raise RecordingError(f"{what}: {error}", where=where, fix=error.fix) from error
    except CdrError as error:
        raise RecordingError(
            f"{what} breaks its own layout: {error}",
            where=where,
            fix=fix,
        ) from error


def byte_order(payload: memoryview) -> str:
    """Return ``<`` or ``>`` as the encapsulation says.

    Args:
        payload: one message.

    Raises:
        CdrError: it is shorter than its header, or of another representation.

    >>> byte_order(memoryview(bytes([0, 1, 0, 0])))
    '<'
    """
    if len(payload) < ENCAPSULATION_BYTES:
        raise CdrError(f"it has {len(payload)} bytes, less than a CDR header")
    kind = payload[0] << 8 | payload[1]
    if kind not in _ORDERS:
        name = _OTHER_REPRESENTATIONS.get(kind, "unknown")
        raise CdrError(f"its representation is {kind:#06x} ({name}); only plain CDR is read")
    return _ORDERS[kind]


def read_stamp_and_frame(payload: memoryview) -> tuple[int, bytes, int]:
    """Read the ``std_msgs/Header`` at the start of a payload, and nothing else.

    Args:
        payload: one message, or the first bytes of it.

    Returns:
        stamp in nanoseconds, frame id without NUL, and where the header ends.

    Raises:
        CdrError: the payload ends before.
    """
    order = byte_order(payload)
    try:
        sec, nanosec, length = _HEADERS[order].unpack_from(payload, ENCAPSULATION_BYTES)
    except struct.error as error:
        raise CdrError(f"it ends inside its header: {len(payload)} bytes") from error
    start = ENCAPSULATION_BYTES + _HEADERS[order].size
    if start + length > len(payload):
        raise CdrError(f"its frame id claims {length} bytes of {len(payload) - start}")
    frame = bytes(payload[start : start + length]).rstrip(b"\0")
    return sec * NS_PER_S + nanosec, frame, start + length


_HEADERS: Final = {order: struct.Struct(order + "iII") for order in "<>"}
_SCALARS: Final = {(order, code): struct.Struct(order + code) for order in "<>" for code in "BIiQd"}


class CdrReader:
    """A cursor over one payload; every read aligns itself as CDR demands.

    Messages of another encoding are read through a class of the same methods: see
    :mod:`civil_rgbd.conversion.encodings`.
    """

    START: ClassVar[int] = ENCAPSULATION_BYTES
    """Where a message's first field lies."""

    SECONDS_AT: ClassVar[int] = 0
    """Where, in a header, the seconds of its stamp lie; nanoseconds and frame id follow."""

    def __init__(self, payload: memoryview | bytes) -> None:
        self._data = memoryview(payload)
        self.order = self.order_of(self._data)
        self.at = self.START

    @staticmethod
    def order_of(payload: memoryview) -> str:
        """Return ``<`` or ``>``.

        Raises:
            CdrError: the payload does not say it in a way that is known.
        """
        return byte_order(payload)

    @staticmethod
    def stamp_and_frame(payload: memoryview) -> tuple[int, bytes, int]:
        """Read the ``std_msgs/Header`` at the start: stamp in ns, frame id, where it ends.

        Raises:
            CdrError: the payload ends before.
        """
        return read_stamp_and_frame(payload)

    @staticmethod
    def aligned(at: int, size: int) -> int:
        """Return where a field of ``size`` bytes lies that may begin at ``at``."""
        return at + -(at - ENCAPSULATION_BYTES) % size

    @staticmethod
    def stride(item_bytes: int, size: int) -> int:
        """Return the bytes from item to item of a sequence whose largest field has ``size``."""
        return item_bytes + -item_bytes % size

    @property
    def left(self) -> int:
        """Bytes not read yet."""
        return len(self._data) - self.at

    def align(self, size: int) -> None:
        """Skip padding up to a multiple of ``size``, counted after the encapsulation."""
        self.at = self.aligned(self.at, size)

    def _scalar(self, code: str) -> int | float:
        layout = _SCALARS[self.order, code]
        self.align(layout.size)
        if self.left < layout.size:
            raise CdrError(f"it ends at byte {len(self._data)}, inside a field")
        value: int | float = layout.unpack_from(self._data, self.at)[0]
        self.at += layout.size
        return value

    def uint8(self) -> int:
        """Read a uint8 or bool."""
        return int(self._scalar("B"))

    def int32(self) -> int:
        """Read an int32."""
        return int(self._scalar("i"))

    def uint32(self) -> int:
        """Read a uint32."""
        return int(self._scalar("I"))

    def uint64(self) -> int:
        """Read a uint64."""
        return int(self._scalar("Q"))

    def float64s(self, count: int) -> tuple[float, ...]:
        """Read ``count`` float64 in a row."""
        if not count:
            return ()
        self.align(8)
        if self.left < 8 * count:
            raise CdrError(f"{count} float64 are claimed, {self.left} bytes are left")
        values: tuple[float, ...] = struct.unpack_from(f"{self.order}{count}d", self._data, self.at)
        self.at += 8 * count
        return values

    def octets(self) -> memoryview:
        """Read a sequence of uint8 without copying it."""
        length = self.uint32()
        if length > self.left:
            raise CdrError(f"a sequence of {length} bytes is claimed, {self.left} are left")
        view = self._data[self.at : self.at + length]
        self.at += length
        return view

    def text(self) -> str:
        """Read a string."""
        return bytes(self.octets()).rstrip(b"\0").decode("utf-8", errors="replace")

    def count(self, smallest_bytes: int) -> int:
        """Read the length of a sequence whose items take at least ``smallest_bytes`` each."""
        length = self.uint32()
        if length * smallest_bytes > self.left:
            raise CdrError(f"a sequence of {length} items is claimed, {self.left} bytes are left")
        return length

    def header(self) -> tuple[int, str]:
        """Read a ``std_msgs/Header``: stamp in nanoseconds and frame id."""
        stamp_ns = self.int32() * NS_PER_S + self.uint32()
        return stamp_ns, frame_name(self.text())


def frame_name(frame_id: str) -> str:
    """Return a frame id as it is compared: without a leading slash.

    >>> frame_name("/velodyne")
    'velodyne'
    """
    return frame_id.lstrip("/")
