"""The byte layout of ROS 1 messages: that of CDR without encapsulation, padding and NUL."""

from __future__ import annotations

import struct
from typing import ClassVar, Final

from civil_rgbd.constants import NS_PER_S
from civil_rgbd.conversion.cdr import CdrError, CdrReader, frame_name

_HEADER: Final = struct.Struct("<IIII")
"""seq, seconds, nanoseconds, length of the frame id."""


class Ros1Reader(CdrReader):
    """A cursor over one payload: little endian, every field right behind the last one."""

    START: ClassVar[int] = 0
    SECONDS_AT: ClassVar[int] = 4

    @staticmethod
    def order_of(payload: memoryview) -> str:
        """Return ``<``: ROS 1 knows no other order."""
        del payload
        return "<"

    @staticmethod
    def stamp_and_frame(payload: memoryview) -> tuple[int, bytes, int]:
        """Read the ``std_msgs/Header`` at the start: stamp in ns, frame id, where it ends.

        Raises:
            CdrError: the payload ends before.
        """
        try:
            _, sec, nanosec, length = _HEADER.unpack_from(payload)
        except struct.error as error:
            raise CdrError(f"it ends inside its header: {len(payload)} bytes") from error
        end = _HEADER.size + length
        if end > len(payload):
            left = len(payload) - _HEADER.size
            raise CdrError(f"its frame id claims {length} bytes of {left}")
        frame = bytes(payload[_HEADER.size : end]).rstrip(b"\0")
        return sec * NS_PER_S + nanosec, frame, end

    @staticmethod
    def aligned(at: int, size: int) -> int:
        """Return ``at``: nothing is padded."""
        del size
        return at

    @staticmethod
    def stride(item_bytes: int, size: int) -> int:
        """Return ``item_bytes``: nothing is padded."""
        del size
        return item_bytes

    def header(self) -> tuple[int, str]:
        """Read a ``std_msgs/Header``: stamp in nanoseconds and frame id."""
        self.uint32()  # seq: ROS 2 dropped it
        stamp_ns = self.uint32() * NS_PER_S + self.uint32()
        return stamp_ns, frame_name(self.text())
