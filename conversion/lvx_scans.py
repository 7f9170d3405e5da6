"""The scans of one LiDAR in an LVX file: a frame each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.constants import MAX_POINT_TIME_OFFSET_NS, NS_PER_S
from civil_rgbd.conversion.clocks import ascending
from civil_rgbd.conversion.lvx_file import Device
from civil_rgbd.conversion.lvx_packets import points_of_packets, walk_packets
from civil_rgbd.conversion.lvx_walk import Seen, Walk, with_points
from civil_rgbd.domain.scan import LidarScan
from civil_rgbd.errors import RecordingError, UsageError
from civil_rgbd.geometry.transforms import transform_points
from civil_rgbd.resources import nearest

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
        salvage: go on without frames that cannot be decoded; they are counted.
    """

    path: Path
    second: bool
    keys: NDArray[np.int64]
    device: Device
    interval_ns: float
    places: NDArray[np.int64]
    stamps_ns: NDArray[np.int64]
    reach_ns: tuple[int, int]
    salvage: bool = False

    def read(self, index: int) -> LidarScan:
        """Decode one frame.

        Raises:
            RecordingError: it breaks its own layout and is not to be left out, or cannot be read
                any more.
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
        packets = with_points(packets, second=self.second)
        packets = packets.among(packets.device == self.device.key)
        try:
            found = points_of_packets(packets, second=self.second, interval_ns=self.interval_ns)
        except ValueError as error:
            if self.salvage:
                return LidarScan.lost(int(self.stamps_ns[index]))
            raise RecordingError(
                f"frame {index} breaks its own layout: {error}",
                where=self.path,
                fix="record or copy it again, or go on without it: --salvage",
            ) from error
        points = found.points
        if self.device.T_file_device is not None:
            returned = (points != 0).any(axis=1)
            moved = transform_points(self.device.T_file_device, points).astype(np.float32)
            points = np.where(returned[:, np.newaxis], moved, np.float32(0))
        return LidarScan(int(self.stamps_ns[index]), points, found.stamps_ns, found.noise)


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


def index_scans(walk: Walk, wanted: str | None, *, salvage: bool) -> Index:
    """Choose a device and make its scans.

    Args:
        walk: over the file.
        wanted: serial number of the device; None takes the only one.
        salvage: go on with what is readable of a damaged file.

    Raises:
        RecordingError: it is damaged, holds no points, or its stamps do not ascend.
        UsageError: several devices recorded, or none goes by the wanted number.
    """
    lost = _judge(walk, salvage=salvage)
    device = _chosen(walk, wanted)
    scans, astray = _scans(walk, device, salvage=salvage)
    counts = dict(walk.counts)
    if astray:
        counts["scan-stamp-astray"] = astray
        frames = "1 frame is" if astray == 1 else f"{astray} frames are"
        said = f"{frames} left out, whose stamps do not fit those of the others"
        lost = f"{lost}; {said}" if lost else said
    return Index(scans, lost, counts, _warnings(device))


def _judge(walk: Walk, *, salvage: bool) -> str | None:
    """Return what was lost, in words; None when nothing was."""
    if not walk.damage:
        return None
    said = "; ".join(walk.damage[:_SAID_AT_MOST])
    if len(walk.damage) > _SAID_AT_MOST:
        said += f"; and {len(walk.damage) - _SAID_AT_MOST} more"
    said = f"{said}; {walk.frames} frames are readable"
    if not salvage:
        raise RecordingError(
            f"the recording is damaged: {said}",
            where=walk.path,
            fix="record or copy it again, or go on with what is readable: --salvage",
        )
    return said


def _chosen(walk: Walk, wanted: str | None) -> Device:
    found, path = walk.with_points, walk.path
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


def _scans(walk: Walk, device: Device, *, salvage: bool) -> tuple[LvxScans, int]:
    """Return the scans whose stamps ascend, and how many do not; without ``salvage`` none may.

    Raises:
        RecordingError: the clock changed.
    """
    seen = walk.seen[device.key]
    short = np.array(seen.spans_ns) <= MAX_POINT_TIME_OFFSET_NS
    kept = np.flatnonzero(short & seen.on_one_clock)
    kept = kept[ascending(seen.stamps_ns[kept])]
    lost = len(short) - len(kept)
    if not len(kept) or (lost and not salvage):
        raise _clock_changed(walk, seen)
    return replace(scans_of(walk, device, kept.tolist()), salvage=salvage), lost


def scans_of(walk: Walk, device: Device, kept: Sequence[int]) -> LvxScans:
    """Return scans of a device.

    Args:
        walk: over the file.
        device: whose.
        kept: which of its frames.
    """
    seen = walk.seen[device.key]
    interval_ns = seen.interval_ns(device)
    span_ns = max((seen.spans_ns[at] for at in kept), default=0)
    return LvxScans(
        path=walk.path.absolute(),
        second=walk.header.second,
        keys=walk.header.keys,
        device=device,
        interval_ns=interval_ns,
        places=np.array([seen.places[at] for at in kept], dtype=np.int64).reshape(-1, 2),
        stamps_ns=seen.stamps_ns[list(kept)],
        reach_ns=(0, span_ns + round(seen.packet_points * interval_ns)),
    )


def _clock_changed(walk: Walk, seen: Seen) -> RecordingError:
    types = sorted(frozenset().union(*seen.stamp_types))
    stamps_ns, span_ns = seen.stamps_ns, max(seen.spans_ns)
    steps = np.diff(stamps_ns)
    what = "the LiDAR's clock changed while it recorded"
    if (steps <= 0).any():
        at = int(np.argmax(steps <= 0))
        what += (
            f": frame {at} begins at {stamps_ns[at] / NS_PER_S:.6f} s, the next at "
            f"{stamps_ns[at + 1] / NS_PER_S:.6f} s"
        )
    elif span_ns > MAX_POINT_TIME_OFFSET_NS:
        what = f"one frame spans {span_ns / NS_PER_S:.3f} s"
    odd = np.flatnonzero(~seen.on_one_clock)
    if len(types) > 1 and len(odd):
        what += f"; frame {odd[0]} has stamps of another type than most: {len(odd)} frames have"
    fix = (
        "record again with the clock settled before the start (PTP or GPS), or none at all; type 0 "
        "counts from power-on, 1 is PTP, 3 GPS, 4 a pulse a second; or go on without the frames "
        "that do not fit: --salvage"
    )
    said = f"stamp types: {', '.join(map(str, types))}"
    return RecordingError(f"{what} ({said})", where=walk.path, fix=fix)


def _warnings(device: Device) -> tuple[str, ...]:
    if device.T_file_device is None:
        return ()
    x, y, z = device.T_file_device[:3, 3]
    moved = f"the points of {device.code or device.name} by x {x:.3f}, y {y:.3f}, z {z:.3f} m"
    done = "this is done, and the rig's LiDAR frame is the moved one"
    return (f"the file says to move {moved} and a rotation: {done}",)
