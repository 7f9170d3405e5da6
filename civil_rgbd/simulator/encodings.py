"""How ROS writes a message: aligned and headed in ROS 2 (CDR), packed in ROS 1; little endian."""

from __future__ import annotations

import struct
from abc import ABC, abstractmethod
from typing import Self

from civil_rgbd.constants import NS_PER_S


class Encoding(ABC):
    """A message as it grows.

    Attributes:
        point_bytes: from one Livox point to the next, of which 19 are its own.
    """

    point_bytes: int

    def __init__(self) -> None:
        self._bytes = bytearray()

    @abstractmethod
    def numbers(self, kind: str, *values: float) -> Self:
        """Append numbers of one :mod:`struct` kind, such as ``I`` or ``d``."""

    @abstractmethod
    def text(self, value: str) -> Self:
        """Append a string."""

    @abstractmethod
    def header(self, stamp_ns: int, frame_id: str) -> Self:
        """Append a ``std_msgs/Header``."""

    def raw(self, values: bytes) -> Self:
        """Append bytes as they are."""
        self._bytes += values
        return self

    def finished(self) -> bytes:
        """Return the message."""
        return bytes(self._bytes)


class CdrMessage(Encoding):
    """ROS 2: numbers are aligned to their size, counted after the four bytes in front."""

    point_bytes = 20

    def __init__(self) -> None:
        self._bytes = bytearray(b"\x00\x01\x00\x00")

    def numbers(self, kind: str, *values: float) -> Self:
        """Append numbers of one :mod:`struct` kind, such as ``I`` or ``d``."""
        size = struct.calcsize(kind)
        self._bytes += bytes(-(len(self._bytes) - 4) % size)
        self._bytes += struct.pack(f"<{len(values)}{kind}", *values)
        return self

    def text(self, value: str) -> Self:
        """Append a string, its length and a NUL."""
        encoded = value.encode() + b"\x00"
        return self.numbers("I", len(encoded)).raw(encoded)

    def header(self, stamp_ns: int, frame_id: str) -> Self:
        """Append a ``std_msgs/Header``: stamp and frame."""
        seconds, nanoseconds = divmod(stamp_ns, NS_PER_S)
        return self.numbers("i", seconds).numbers("I", nanoseconds).text(frame_id)


class Ros1Message(Encoding):
    """ROS 1: nothing is aligned; a header begins with a count that nobody reads."""

    point_bytes = 19

    def numbers(self, kind: str, *values: float) -> Self:
        """Append numbers of one :mod:`struct` kind, such as ``I`` or ``d``."""
        return self.raw(struct.pack(f"<{len(values)}{kind}", *values))

    def text(self, value: str) -> Self:
        """Append a string behind its length."""
        encoded = value.encode()
        return self.numbers("I", len(encoded)).raw(encoded)

    def header(self, stamp_ns: int, frame_id: str) -> Self:
        """Append a ``std_msgs/Header``: count, stamp and frame."""
        return self.numbers("I", 0, *divmod(stamp_ns, NS_PER_S)).text(frame_id)
