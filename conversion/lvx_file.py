"""LVX and LVX2 files: which devices recorded, and where each frame lies."""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.conversion.lvx_packets import is_frame, next_frame, walk_packets
from civil_rgbd.errors import RecordingError
from civil_rgbd.geometry.angles import rotation_from_roll_pitch_yaw
from civil_rgbd.geometry.transforms import transform_from

_SIGNATURE: Final = b"livox_tech"
_PUBLIC: Final = struct.Struct("<16s4BI")
_PRIVATE: Final = struct.Struct("<IB")
_DEVICE: Final = struct.Struct("<16s16sBBB6f")
_DEVICE_LVX2: Final = struct.Struct("<16s16sIBBB6f")
_FRAME: Final = struct.Struct("<QQQ")

# Livox's ROS driver (lds.h, product_type_info_pair_table) and the two specifications.
_NAMES: Final = {
    0: "Livox Hub",
    1: "Livox Mid-40",
    2: "Livox Tele-15",
    3: "Livox Horizon",
    6: "Livox Mid-70",
    7: "Livox Avia",
    9: "Livox Mid-360",
    10: "Livox HAP",
}
_INTERVALS_NS: Final = {1: 10_000.0, 2: 4_167.0, 3: 4_167.0, 6: 10_000.0, 7: 4_167.0}


@dataclass(frozen=True, slots=True, eq=False)
class Device:
    """One LiDAR of the file.

    Attributes:
        key: what packets call it.
        code: its serial number or broadcast code.
        name: its product.
        interval_ns: from point to point, where the product is known for it.
        T_file_device: (4, 4) as the file says to move its points; None = they stay.
    """

    key: int
    code: str
    name: str
    interval_ns: float | None
    T_file_device: NDArray[np.float64] | None


@dataclass(frozen=True, slots=True)
class LvxHeader:
    """What stands before the frames.

    Attributes:
        second: it is an LVX2 file.
        devices: the LiDARs.
        data_at: where the first frame begins.
    """

    second: bool
    devices: tuple[Device, ...]
    data_at: int

    @property
    def keys(self) -> NDArray[np.int64]:
        """(D,) what packets call the devices."""
        return np.array([device.key for device in self.devices], dtype=np.int64)


def read_lvx_header(start: bytes, *, where: Path) -> LvxHeader:
    """Read the headers of an LVX 1.1 or LVX2 file.

    Args:
        start: the first bytes of the file; 17 KiB hold any header.
        where: the file, for errors.

    Raises:
        RecordingError: it is no such file, or of a version that is not read.
    """
    if len(start) < _PUBLIC.size + _PRIVATE.size or not start.startswith(_SIGNATURE):
        raise RecordingError(
            f"this is no LVX file: it is empty or starts with {start[:10]!r}",
            where=where,
            fix="give a recording of Livox Viewer, or a bag of Livox's ROS driver",
        )
    _, major, minor, *_ = _PUBLIC.unpack_from(start)
    if (major, minor) not in ((1, 1), (2, 0)):
        raise RecordingError(
            f"this is an LVX file of version {major}.{minor}; 1.1 and 2.0 (LVX2) are read",
            where=where,
            fix="convert it with Livox Viewer or Livox's ROS driver (lvx_to_rosbag)",
        )
    second = major == 2
    layout = _DEVICE_LVX2 if second else _DEVICE
    _, count = _PRIVATE.unpack_from(start, _PUBLIC.size)
    first_at = _PUBLIC.size + _PRIVATE.size
    data_at = first_at + count * layout.size
    if not count or data_at > len(start):
        raise RecordingError(
            f"the file ends inside its header: {count} devices are claimed",
            where=where,
            fix="record or copy it again",
        )
    places = range(first_at, data_at, layout.size)
    devices = tuple(
        _device(layout.unpack_from(start, at), second=second, where=where) for at in places
    )
    return LvxHeader(second, devices, data_at)


def _device(values: tuple[Any, ...], *, second: bool, where: Path) -> Device:
    code = values[0].split(b"\0")[0].decode("latin-1").strip()
    key, kind = values[2], values[4 if second else 3]
    enabled, numbers = bool(values[-7]), list(values[-6:])
    T_file_device = None
    if enabled and any(numbers):
        if not all(map(math.isfinite, numbers)):
            raise RecordingError(
                f"the extrinsics of the device {code!r} are not finite: {numbers}",
                where=where,
                fix="record or copy it again",
            )
        T_file_device = transform_from(rotation_from_roll_pitch_yaw(*numbers[:3]), numbers[3:])
    name = _NAMES.get(kind, f"Livox device of type {kind}")
    return Device(key, code, name, None if second else _INTERVALS_NS.get(kind), T_file_device)


def frames_of(
    data: NDArray[np.uint8], header: LvxHeader, damage: list[str]
) -> Iterator[tuple[int, int]]:
    """Walk the frames: each says where it and the next one begin.

    Args:
        data: (B,) uint8, the file.
        header: of it.
        damage: what is broken is added, in words; behind it the walk goes on at the next frame.

    Yields:
        start and end of a frame's packets.
    """
    at, number, longest = header.data_at, 0, 0
    while at < len(data):
        if at + _FRAME.size > len(data):
            damage.append(f"it ends at byte {len(data)}, inside the header of frame {number}")
            return
        here, following, _ = _FRAME.unpack(data[at : at + _FRAME.size].tobytes())
        if here != at:
            damage.append(f"frame {number} at byte {at} says that it begins at {here}")
            at = next_frame(data, at + 1)
            continue
        end = following or len(data)  # some writers leave the last one 0
        if not (end == len(data) or (at < end < len(data) and is_frame(data, end))):
            # An end that lies, or a file that is cut, or the next frame's header that is broken.
            behind = next_frame(data, at + _FRAME.size)
            if not at + _FRAME.size <= end <= behind:
                place = "the file ends at" if behind == len(data) else "the next begins at"
                damage.append(f"frame {number} should end at byte {end}, {place} {behind}")
                end = behind
        elif end - at > 2 * longest:  # it may skip frames: do its packets reach so far?
            behind = _behind_packets(data, header, at + _FRAME.size, end)
            if behind < end:
                damage.append(
                    f"frame {number} should end at byte {end}, the next begins at {behind}"
                )
                end = behind
            longest = end - at
        yield at + _FRAME.size, end
        at, number = end, number + 1


def _behind_packets(data: NDArray[np.uint8], header: LvxHeader, start: int, end: int) -> int:
    """Return where the next frame begins behind the first packet that is none; else ``end``."""
    packets = walk_packets(data[start:end], second=header.second, devices=header.keys)
    return end if packets.whole else min(end, next_frame(data, start + packets.end))
