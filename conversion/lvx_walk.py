"""What a walk over an LVX file sees of each LiDAR, before one of them is chosen."""

from __future__ import annotations

from array import array
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.conversion.lvx_file import Device, LvxHeader, frames_of
from civil_rgbd.conversion.lvx_layout import IMU, IMU_LVX2, LVX2_TYPES, LVX_TYPES, DataType
from civil_rgbd.conversion.lvx_packets import Packets, walk_packets

_MEASURED_PACKETS: Final = 2000


def point_types(*, second: bool) -> Mapping[int, DataType]:
    """Return the data types with points of LVX 1.1, or of LVX2."""
    return LVX2_TYPES if second else LVX_TYPES


def with_points(packets: Packets, *, second: bool) -> Packets:
    """Return the packets that hold points."""
    return packets.among(np.isin(packets.kind, list(point_types(second=second))))


@dataclass(slots=True)
class Seen:
    """What was seen of one device.

    Attributes:
        places: start and end of the packets of each frame in which it has points.
        first_ns: stamp of each such frame's earliest packet.
        spans_ns: of each such frame, from its first packet to its last.
        stamp_types: which kinds of stamps the packets of each such frame have.
        kinds: data types of its points.
        packet_ns: stamps of its first packets.
        packet_points: points of the fullest packet, not counting further returns.
        imu_ns: stamps of its IMU's readings, in the file's order.
    """

    places: list[tuple[int, int]] = field(default_factory=list)
    first_ns: list[int] = field(default_factory=list)
    spans_ns: list[int] = field(default_factory=list)
    stamp_types: list[frozenset[int]] = field(default_factory=list)
    kinds: set[int] = field(default_factory=set)
    packet_ns: list[int] = field(default_factory=list)
    packet_points: int = 0
    imu_ns: array[int] = field(default_factory=lambda: array("q"))

    @property
    def stamps_ns(self) -> NDArray[np.int64]:
        """(S,) of its frames."""
        return np.array(self.first_ns, dtype=np.int64)

    @property
    def on_one_clock(self) -> NDArray[np.bool_]:
        """(S,) whether all packets of a frame have the kind of stamps that most frames have."""
        pure = Counter(types for types in self.stamp_types if len(types) == 1)
        usual = pure.most_common(1)[0][0] if pure else frozenset()
        return np.array([types == usual for types in self.stamp_types], dtype=np.bool_)

    def note(
        self,
        pointed: Packets,
        imu: Packets,
        *,
        key: int,
        place: tuple[int, int],
        types: Mapping[int, DataType],
    ) -> None:
        """Take what one frame holds of this device.

        Args:
            pointed: the frame's packets with points, of all devices.
            imu: those of IMUs.
            key: of this device.
            place: of the frame.
            types: data types with points.

        Raises:
            ValueError: a stamp is none.
        """
        packets = pointed.among(pointed.device == key)
        if len(packets.kind):
            self._note_points(packets, place, types)
        self.imu_ns.extend(imu.among(imu.device == key).stamps_ns().tolist())

    def _note_points(
        self, packets: Packets, place: tuple[int, int], types: Mapping[int, DataType]
    ) -> None:
        stamps_ns = packets.stamps_ns()
        self.places.append(place)
        self.first_ns.append(int(stamps_ns.min()))
        self.spans_ns.append(int(stamps_ns.max() - stamps_ns.min()))
        self.stamp_types.append(frozenset(packets.stamp_type.tolist()))
        if len(self.packet_ns) < _MEASURED_PACKETS:
            self.packet_ns += stamps_ns.tolist()
        for kind, length in {*zip(packets.kind.tolist(), packets.length.tolist(), strict=True)}:
            self.kinds.add(kind)
            self.packet_points = max(self.packet_points, length // types[kind].point_bytes)

    def interval_ns(self, device: Device) -> float:
        """From point to point: the product's, else what lies between most packets, shared."""
        if device.interval_ns:
            return device.interval_ns
        steps = np.diff(np.array(sorted(self.packet_ns), dtype=np.int64))
        return float(np.median(steps)) / max(1, self.packet_points) if len(steps) else 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Walk:
    """What a file holds.

    Attributes:
        path: the file.
        header: of it.
        seen: of each device, by its key.
        damage: what is broken, in words, in order.
        counts: what is left out, by name.
    """

    path: Path
    header: LvxHeader
    seen: dict[int, Seen]
    damage: tuple[str, ...]
    counts: dict[str, int]

    @property
    def with_points(self) -> list[Device]:
        """The devices that have points."""
        return [device for device in self.header.devices if self.seen[device.key].places]

    @property
    def frames(self) -> int:
        """How many frames are readable, of all devices together."""
        return sum(len(seen.places) for seen in self.seen.values())


def walk_file(path: Path, header: LvxHeader) -> Walk:
    """Walk a file once: keep places and stamps.

    Args:
        path: the file.
        header: of it.

    Raises:
        OSError: it cannot be read.
    """
    data = np.memmap(path, dtype=np.uint8, mode="r")
    damage: list[str] = []
    counts: Counter[str] = Counter()
    seen = {device.key: Seen() for device in header.devices}
    types, imu_kind = point_types(second=header.second), IMU_LVX2 if header.second else IMU
    for number, (start, end) in enumerate(frames_of(data, header, damage)):
        packets = walk_packets(data[start:end], second=header.second, devices=header.keys)
        cut = bool(damage) and damage[-1].startswith(f"frame {number} ")
        if not packets.whole and not cut:
            at = start + packets.end
            damage.append(f"a packet of frame {number} at byte {at} is broken or cut")
        imu = packets.among(packets.kind == imu_kind)
        pointed = with_points(packets, second=header.second)
        counts["packet-of-unknown-type"] += len(packets.kind) - len(pointed.kind) - len(imu.kind)
        counts["frame-without-points"] += not len(pointed.kind)
        for key in np.unique(packets.device).tolist():
            try:
                seen[key].note(pointed, imu, key=key, place=(start, end), types=types)
            except ValueError as error:
                damage.append(f"frame {number} at byte {start}: {error}")
    kept = {name: count for name, count in counts.items() if count}
    return Walk(path, header, seen, tuple(damage), kept)
