"""The packets inside Livox's LVX and LVX2 files: where they lie, and their points."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Final

import numba
import numpy as np
from numpy.typing import NDArray

from civil_rgbd.constants import NS_PER_S
from civil_rgbd.conversion.lvx_layout import (
    IMU,
    IMU_BYTES,
    LVX2_TYPES,
    LVX_TYPES,
    DataType,
)
from civil_rgbd.conversion.point_clouds import NOISE_BITS
from civil_rgbd.geometry.angles import sine_and_cosine

GPS_UTC: Final = 3
"""Timestamp type of LVX 1.1 whose eight bytes are a date, an hour and microseconds."""

UNKNOWN: Final = -1

_LVX_HEADER_BYTES: Final = 19
_LVX2_HEADER_BYTES: Final = 27


def _payload_bytes() -> NDArray[np.int64]:
    """Bytes after the header of a packet of LVX 1.1, by data type; -1 = there is no such type."""
    table = np.full(256, UNKNOWN, dtype=np.int64)
    for number, kind in LVX_TYPES.items():
        table[number] = kind.points * kind.point_bytes
    table[IMU] = IMU_BYTES
    return table


_PAYLOAD_BYTES: Final = _payload_bytes()


@numba.njit(cache=True)
def _little(data, at, width):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202  # a kernel: numba infers
    value = 0
    for k in range(width - 1, -1, -1):
        value = (value << 8) | int(data[at + k])
    return value


@numba.njit(cache=True)
def _walk(data, second, devices, payload_bytes, rows, stamps):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202, PLR0917  # a kernel: numba infers
    """List packets: rows (R, 5) = device, stamp type, data type, where its points are, bytes."""
    at, count = 0, 0
    header = 27 if second else 19
    while at + header <= len(data) and count < len(rows):
        if second:
            device = _little(data, at + 1, 4)
            stamp_type, stamp_at, kind = int(data[at + 6]), at + 7, int(data[at + 17])
            length = _little(data, at + 18, 4)
        else:
            device = int(data[at])
            stamp_type, stamp_at, kind = int(data[at + 9]), at + 11, int(data[at + 10])
            length = payload_bytes[kind]
        if length < 0 or at + header + length > len(data) or not (devices == device).any():
            break
        rows[count, 0], rows[count, 1], rows[count, 2] = device, stamp_type, kind
        rows[count, 3], rows[count, 4] = at + header, length
        stamps[count] = _little(data, stamp_at, 8)
        at += header + length
        count += 1
    return count, at


@numba.njit(cache=True)
def _is_frame(data, at):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202  # a kernel: numba infers
    return at + 24 <= len(data) and _little(data, at, 8) == at


@numba.njit(cache=True)
def _next_frame(data, at):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202  # a kernel: numba infers
    while at + 24 <= len(data):
        if _is_frame(data, at):
            return at
        at += 1
    return len(data)


def is_frame(data: NDArray[np.uint8], at: int) -> bool:
    """Whether a frame begins at a byte of a file: its header begins with where it lies."""
    return bool(_is_frame(data, at))


def next_frame(data: NDArray[np.uint8], at: int) -> int:
    """Find the next frame.

    Args:
        data: (B,) uint8, the file.
        at: where to begin looking.

    Returns:
        where it begins; the length of data when there is none.
    """
    return int(_next_frame(data, at))


@numba.njit(cache=True)
def _gather(data, places, out):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202  # a kernel: numba infers
    """Copy equally long pieces of ``data`` into the rows of ``out``."""
    for row in range(len(places)):
        for k in range(out.shape[1]):
            out[row, k] = data[places[row] + k]


@dataclass(frozen=True, slots=True, eq=False)
class Packets:
    """The packets of one frame.

    Attributes:
        data: (B,) uint8, the frame without its header.
        device: (K,) int64, of each packet.
        stamp_type: (K,) int64.
        kind: (K,) int64, data type.
        place: (K,) int64, where its points begin in ``data``.
        length: (K,) int64, bytes of its points.
        stamps: (K,) uint64, as recorded.
        end: where the first packet that is broken or cut begins; the length of data without one.
    """

    data: NDArray[np.uint8]
    device: NDArray[np.int64]
    stamp_type: NDArray[np.int64]
    kind: NDArray[np.int64]
    place: NDArray[np.int64]
    length: NDArray[np.int64]
    stamps: NDArray[np.uint64]
    end: int

    @property
    def whole(self) -> bool:
        """Whether nothing is broken or cut."""
        return self.end == len(self.data)

    def among(self, chosen: NDArray[np.bool_]) -> Packets:
        """Return some of them."""
        return Packets(
            data=self.data,
            device=self.device[chosen],
            stamp_type=self.stamp_type[chosen],
            kind=self.kind[chosen],
            place=self.place[chosen],
            length=self.length[chosen],
            stamps=self.stamps[chosen],
            end=self.end,
        )

    def stamps_ns(self) -> NDArray[np.int64]:
        """(K,) nanoseconds, LiDAR clock.

        Raises:
            ValueError: a stamp is no date, or beyond the year 2096.
        """
        if len(self.stamps) and bool((self.stamp_type == GPS_UTC).all()):
            return _utc_ns(self.stamps)
        if (self.stamps > np.uint64(4_000_000_000 * NS_PER_S)).any():
            raise ValueError(f"a packet is stamped {int(self.stamps.max())} ns, after 2096")
        return self.stamps.astype(np.int64)


def walk_packets(data: NDArray[np.uint8], *, second: bool, devices: NDArray[np.int64]) -> Packets:
    """List the packets of one frame.

    Args:
        data: (B,) uint8, the frame without its header.
        second: it is of an LVX2 file.
        devices: (D,) those that the header lists; a packet of another one is none.

    Returns:
        the whole packets at its start.
    """
    header = _LVX2_HEADER_BYTES if second else _LVX_HEADER_BYTES
    rows = np.empty((len(data) // header + 1, 5), dtype=np.int64)
    stamps = np.empty(len(rows), dtype=np.int64)  # their bits; unsigned when they leave here
    count, end = _walk(data, second, devices, _PAYLOAD_BYTES, rows, stamps)
    device, stamp_type, kind, place, length = (rows[:count, at].copy() for at in range(5))
    return Packets(
        data,
        device,
        stamp_type,
        kind,
        place,
        length,
        stamps[:count].view(np.uint64).copy(),
        int(end),
    )


def _utc_ns(stamps: NDArray[np.uint64]) -> NDArray[np.int64]:
    """Eight bytes: year since 2000, month, day, hour, then uint32 microseconds of the hour."""
    result = np.empty(len(stamps), dtype=np.int64)
    hours: dict[int, int] = {}
    for at, stamp in enumerate(stamps.tolist()):
        date, microseconds = stamp & 0xFFFFFFFF, stamp >> 32
        if date not in hours:
            year, month, day, hour = date.to_bytes(4, "little")
            hours[date] = int(datetime(2000 + year, month, day, hour, tzinfo=UTC).timestamp())
        result[at] = hours[date] * NS_PER_S + microseconds * 1000
    return result


@dataclass(frozen=True, slots=True, eq=False)
class PacketPoints:
    """Points of packets, in the order of the file but for their data types.

    Attributes:
        points: (N, 3) float32 metres, device frame; (0, 0, 0) = no return.
        stamps_ns: (N,) int64.
        noise: (N,) bool; None when no packet has tags.
    """

    points: NDArray[np.float32]
    stamps_ns: NDArray[np.int64]
    noise: NDArray[np.bool_] | None


def points_of_packets(packets: Packets, *, second: bool, interval_ns: float) -> PacketPoints:
    """Decode the points of packets.

    Args:
        packets: of one device, with points.
        second: they are of an LVX2 file.
        interval_ns: from point to point.

    Raises:
        ValueError: a stamp is none, or a packet's length is not that of whole points.
    """
    types = LVX2_TYPES if second else LVX_TYPES
    packet_ns = packets.stamps_ns()
    parts: list[PacketPoints] = []
    groups = np.unique(np.stack([packets.kind, packets.length], axis=1), axis=0)
    for kind_number, length in groups.tolist():
        kind = types[kind_number]
        chosen = np.flatnonzero((packets.kind == kind_number) & (packets.length == length))
        count, rest = divmod(length, kind.point_bytes)
        if rest:
            raise ValueError(f"a packet has {length} bytes, points take {kind.point_bytes} each")
        raw = np.empty((len(chosen), length), dtype=np.uint8)
        _gather(packets.data, packets.place[chosen], raw)
        offsets_ns = np.floor(np.arange(count) * interval_ns + 0.5).astype(np.int64)
        stamps_ns = packet_ns[chosen, np.newaxis] + np.repeat(offsets_ns, kind.returns)
        points, tags = _decoded(raw.reshape(-1, kind.point_bytes), kind)
        noise = None if tags is None else (tags & NOISE_BITS) != 0
        parts.append(PacketPoints(points, stamps_ns.reshape(-1), noise))
    if not parts:
        return PacketPoints(np.zeros((0, 3), np.float32), np.zeros(0, np.int64), None)
    noise = None
    if any(part.noise is not None for part in parts):
        noise = np.concatenate(
            [np.zeros(len(p.points), np.bool_) if p.noise is None else p.noise for p in parts]
        )
    return PacketPoints(
        np.concatenate([part.points for part in parts]),
        np.concatenate([part.stamps_ns for part in parts]),
        noise,
    )


def _decoded(
    raw: NDArray[np.uint8], kind: DataType
) -> tuple[NDArray[np.float32], NDArray[np.uint8] | None]:
    """Points (N, 3) and tags (N,) of (points, bytes) raw packets; N counts returns."""
    if kind.spherical:
        return _decoded_spherical(raw, kind)
    items = raw.reshape(-1).view(kind.item)
    points = np.empty((len(items), 3), dtype=np.float32)
    for axis, name in enumerate("xyz"):
        np.divide(items[name].astype(np.float32), kind.unit, out=points[:, axis])
    return points, items["tag"] if "tag" in (kind.item.names or ()) else None


def _decoded_spherical(
    raw: NDArray[np.uint8], kind: DataType
) -> tuple[NDArray[np.float32], NDArray[np.uint8] | None]:
    """Zenith and azimuth in hundredths of a degree, distance in millimetres."""
    if kind.returns == 1:
        items = raw.reshape(-1).view(kind.item)
        theta, phi = items["theta"], items["phi"]
    else:  # the angles come first, once for all returns
        angles = np.ascontiguousarray(raw[:, :4]).view("<u2")
        theta, phi = (np.repeat(angles[:, at], kind.returns) for at in range(2))
        items = np.ascontiguousarray(raw[:, 4:]).reshape(-1).view(kind.item)
    hundredth = np.pi / 18000
    sin_theta, cos_theta = sine_and_cosine(theta * hundredth)
    sin_phi, cos_phi = sine_and_cosine(phi * hundredth)
    depth_m = items["depth"].astype(np.float64) / float(kind.unit)
    points = np.stack(
        [depth_m * sin_theta * cos_phi, depth_m * sin_theta * sin_phi, depth_m * cos_theta], axis=1
    ).astype(np.float32)
    return points, items["tag"] if "tag" in (kind.item.names or ()) else None
