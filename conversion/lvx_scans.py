"""The scans of one LiDAR in an LVX file: a frame each."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.constants import MAX_POINT_TIME_OFFSET_NS, NS_PER_S
from civil_rgbd.conversion.lvx_file import Device, LvxHeader, frames_of
from civil_rgbd.conversion.lvx_layout import IMU, IMU_LVX2, LVX2_TYPES, LVX_TYPES, DataType
from civil_rgbd.conversion.lvx_packets import Packets, points_of_packets, walk_packets
from civil_rgbd.domain.scan import LidarScan
from civil_rgbd.errors import RecordingError, UsageError
from civil_rgbd.geometry.transforms import transform_points
from civil_rgbd.resources import nearest

_MEASURED_PACKETS: Final = 2000
_SAID_AT_MOST: Final = 5


@dataclass(frozen=True, slots=True, eq=False)
class LvxScans:
    """Frames of a file; fits :class:`civil_rgbd.conversion.lidar_only.Scans`.

    Attributes:
        path: the file.
        second: it is an LVX2 file.
        keys: (D,) int64, what packets call the file's devices.
        device: whose points are read.
        interval_ns: from point to point.
        places: (S, 2) int64, start and end of each frame's packets.
        stamps_ns: (S,) int64, of each frame's earliest packet.
        reach_ns: how far point stamps may lie from their frame's.
    """

    path: Path
    second: bool
    keys: NDArray[np.int64]
    device: Device
    interval_ns: float
    places: NDArray[np.int64]
    stamps_ns: NDArray[np.int64]
    reach_ns: tuple[int, int]

    def read(self, index: int) -> LidarScan:
        """Decode one frame.

        Raises:
            RecordingError: it cannot be read any more.
        """
        start, end = self.places[index].tolist()
        try:
            data = np.fromfile(self.path, dtype=np.uint8, count=end - start, offset=start)
        except OSError as error:
            raise RecordingError(
                f"the recording cannot be read: {error.strerror or error}",
                where=self.path,
                fix="check the disk and the file's permissions",
            ) from error
        packets = walk_packets(data, second=self.second, devices=self.keys)
        packets = _with_points(packets, self.second)
        packets = packets.among(packets.device == self.device.key)
        try:
            found = points_of_packets(packets, second=self.second, interval_ns=self.interval_ns)
        except ValueError as error:
            raise RecordingError(
                f"frame {index} breaks its own layout: {error}",
                where=self.path,
                fix="record or copy it again",
            ) from error
        points = found.points
        if self.device.T_file_device is not None:
            returned = (points != 0).any(axis=1)
            moved = transform_points(self.device.T_file_device, points).astype(np.float32)
            points = np.where(returned[:, np.newaxis], moved, np.float32(0))
        return LidarScan(int(self.stamps_ns[index]), points, found.stamps_ns, found.noise)


def _types(second: bool) -> Mapping[int, DataType]:  # noqa: FBT001  # which of two layouts
    return LVX2_TYPES if second else LVX_TYPES


def _with_points(packets: Packets, second: bool) -> Packets:  # noqa: FBT001  # same
    return packets.among(np.isin(packets.kind, list(_types(second))))


@dataclass(slots=True)
class _Walked:
    """What was seen of one device while the frames were walked."""

    places: list[tuple[int, int]] = field(default_factory=list)
    first_ns: list[int] = field(default_factory=list)
    span_ns: int = 0
    stamp_types: set[int] = field(default_factory=set)
    packet_ns: list[int] = field(default_factory=list)
    packet_points: int = 0  # points of the fullest packet, not counting further returns


@dataclass(frozen=True, slots=True, eq=False)
class Index:
    """All scans of a file, of the chosen device.

    Attributes:
        scans: them.
        salvage: what was lost, in words; None for a whole file.
        counts: what is left out, by name.
        warnings: what is odd.
    """

    scans: LvxScans
    salvage: str | None
    counts: dict[str, int]
    warnings: tuple[str, ...]


def index_scans(path: Path, header: LvxHeader, wanted: str | None, *, salvage: bool) -> Index:
    """Walk a file once: keep places and stamps.

    Args:
        path: the file.
        header: of it.
        wanted: serial number of the device; None takes the only one.
        salvage: go on with what is readable of a damaged file.

    Raises:
        RecordingError: it is damaged, holds no points, or its stamps do not ascend.
        UsageError: several devices recorded, or none goes by the wanted number.
    """
    data = np.memmap(path, dtype=np.uint8, mode="r")
    damage: list[str] = []
    counts: Counter[str] = Counter()
    walked = {device.key: _Walked() for device in header.devices}
    for number, (start, end) in enumerate(frames_of(data, header, damage)):
        packets = walk_packets(data[start:end], second=header.second, devices=header.keys)
        cut = bool(damage) and damage[-1].startswith(f"frame {number} ")
        if not packets.whole and not cut:
            at = start + packets.end
            damage.append(f"a packet of frame {number} at byte {at} is broken or cut")
        imu = packets.kind == (IMU_LVX2 if header.second else IMU)
        pointed = _with_points(packets, header.second)
        counts["packet-of-unknown-type"] += len(packets.kind) - len(pointed.kind) - int(imu.sum())
        counts["frame-without-points"] += not len(pointed.kind)
        for key in np.unique(pointed.device).tolist():
            try:
                _note(
                    walked[key], pointed, key=key, place=(start, end), types=_types(header.second)
                )
            except ValueError as error:
                damage.append(f"frame {number} at byte {start}: {error}")
    lost = _judge(damage, sum(len(seen.places) for seen in walked.values()), path, salvage=salvage)
    device = _chosen(header, walked, wanted, path)
    scans = _scans(path, header, device, walked[device.key])
    kept = {name: count for name, count in counts.items() if count}
    return Index(scans, lost, kept, _warnings(device))


def _judge(damage: list[str], frames: int, path: Path, *, salvage: bool) -> str | None:
    """Return what was lost, in words; None when nothing was."""
    if not damage:
        return None
    said = "; ".join(damage[:_SAID_AT_MOST])
    if len(damage) > _SAID_AT_MOST:
        said += f"; and {len(damage) - _SAID_AT_MOST} more"
    said = f"{said}; {frames} frames are readable"
    if not salvage:
        raise RecordingError(
            f"the recording is damaged: {said}",
            where=path,
            fix="record or copy it again, or go on with what is readable: --salvage",
        )
    return said


def _note(
    walked: _Walked,
    packets: Packets,
    *,
    key: int,
    place: tuple[int, int],
    types: Mapping[int, DataType],
) -> None:
    packets = packets.among(packets.device == key)
    stamps_ns = packets.stamps_ns()
    walked.places.append(place)
    walked.first_ns.append(int(stamps_ns.min()))
    walked.span_ns = max(walked.span_ns, int(stamps_ns.max() - stamps_ns.min()))
    walked.stamp_types |= set(packets.stamp_type.tolist())
    if len(walked.packet_ns) < _MEASURED_PACKETS:
        walked.packet_ns += stamps_ns.tolist()
    for kind, length in {*zip(packets.kind.tolist(), packets.length.tolist(), strict=True)}:
        walked.packet_points = max(walked.packet_points, length // types[kind].point_bytes)


def _chosen(
    header: LvxHeader, walked: dict[int, _Walked], wanted: str | None, path: Path
) -> Device:
    found = [device for device in header.devices if walked[device.key].places]
    if not found:
        raise RecordingError(
            "the file holds no points",
            where=path,
            fix="record it again; look at it in Livox Viewer",
        )
    codes = [device.code for device in found]
    if wanted is not None:
        if wanted not in codes:
            raise UsageError(
                f"--lidar-topic {wanted!r} names no device of the file",
                where=path,
                fix=nearest(wanted, codes),
            )
        return found[codes.index(wanted)]
    if len(found) > 1:
        raise UsageError(
            "several LiDARs are in the file: "
            + ", ".join(f"{device.code} ({device.name})" for device in found),
            where=path,
            fix=f"choose one by its number: --lidar-topic {codes[0]}",
        )
    return found[0]


def _scans(path: Path, header: LvxHeader, device: Device, walked: _Walked) -> LvxScans:
    stamps_ns = np.array(walked.first_ns, dtype=np.int64)
    steps = np.diff(stamps_ns)
    types = f"stamp types: {', '.join(map(str, sorted(walked.stamp_types)))}"
    fix = (
        "record again with the clock settled before the start (PTP or GPS), or none at all; type 0 "
        "counts from power-on, 1 is PTP, 3 GPS, 4 a pulse a second"
    )
    if (steps <= 0).any() or len(walked.stamp_types) > 1:
        at = int(np.argmax(steps <= 0)) if (steps <= 0).any() else 0
        raise RecordingError(
            f"the LiDAR's clock changed while it recorded: frame {at} begins at "
            f"{stamps_ns[at] / NS_PER_S:.6f} s, the next at {stamps_ns[at + 1] / NS_PER_S:.6f} s "
            f"({types})"
            if len(steps)
            else f"the LiDAR's clock changed while it recorded ({types})",
            where=path,
            fix=fix,
        )
    interval_ns = device.interval_ns or _measured_interval_ns(walked)
    reach_ns = walked.span_ns + round(walked.packet_points * interval_ns)
    if walked.span_ns > MAX_POINT_TIME_OFFSET_NS:
        raise RecordingError(
            f"one frame spans {walked.span_ns / NS_PER_S:.3f} s ({types})", where=path, fix=fix
        )
    return LvxScans(
        path=path.absolute(),
        second=header.second,
        keys=header.keys,
        device=device,
        interval_ns=interval_ns,
        places=np.array(walked.places, dtype=np.int64).reshape(-1, 2),
        stamps_ns=stamps_ns,
        reach_ns=(0, reach_ns),
    )


def _measured_interval_ns(walked: _Walked) -> float:
    """Where the product's is not known: what lies between most packets, shared by their points."""
    steps = np.diff(np.array(sorted(walked.packet_ns), dtype=np.int64))
    return float(np.median(steps)) / max(1, walked.packet_points) if len(steps) else 0.0


def _warnings(device: Device) -> tuple[str, ...]:
    if device.T_file_device is None:
        return ()
    x, y, z = device.T_file_device[:3, 3]
    moved = f"the points of {device.code or device.name} by x {x:.3f}, y {y:.3f}, z {z:.3f} m"
    done = "this is done, and the rig's LiDAR frame is the moved one"
    return (f"the file says to move {moved} and a rotation: {done}",)
