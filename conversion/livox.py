"""Livox CustomMsg to a scan: one layout under three package names."""

from __future__ import annotations

from typing import Final

import numpy as np

from civil_rgbd.conversion.cdr import CdrError, CdrReader
from civil_rgbd.conversion.point_clouds import NOISE_BITS
from civil_rgbd.conversion.point_time import PointTime, PointTimeError, point_stamps_ns
from civil_rgbd.domain.scan import LidarScan

POINT_BYTES: Final = 19
"""uint32 offset_time, float32 x y z, uint8 reflectivity tag line."""

POINT_ALIGNMENT: Final = 4
"""Of its largest field: CDR begins each point at a multiple of it; nothing follows the last one."""

LIVOX_TIME: Final = PointTime("offset_time", "ns", "header", unsigned=True)
"""Nanoseconds after the header's stamp."""


def scan_from_livox(
    payload: memoryview, *, in_map: bool, read: type[CdrReader] = CdrReader
) -> LidarScan:
    """Decode one CustomMsg; points without a return come through as (0, 0, 0).

    Args:
        payload: the message.
        in_map: the points are in the map frame already.
        read: reads its encoding.

    Raises:
        CdrError: its counts lie, or its point times are not near its header.
    """
    reader = read(payload)
    stamp_ns, _ = reader.header()
    reader.uint64()  # timebase: the header's stamp is the law
    claimed = reader.uint32()
    reader.uint32()  # lidar id and three reserved bytes
    count = reader.uint32()
    stride = reader.stride(POINT_BYTES, POINT_ALIGNMENT)
    _check_counts(claimed, count, reader.left, stride)

    def view(dtype: str, offset: int) -> np.ndarray[tuple[int, ...], np.dtype[np.generic]]:
        return np.ndarray((count,), reader.order + dtype, payload, reader.at + offset, (stride,))

    points = np.empty((count, 3), dtype=np.float32)
    if not count:
        return LidarScan(stamp_ns, points, np.zeros(0, np.int64), np.zeros(0, np.bool_), in_map)
    for axis in range(3):
        points[:, axis] = view("f4", 4 + 4 * axis)
    try:
        stamps_ns = point_stamps_ns(view("u4", 0), LIVOX_TIME, header_ns=stamp_ns, points=points)
    except PointTimeError as error:  # no option says it otherwise: the message is damaged
        raise CdrError(str(error)) from error
    noise = (view("u1", 17).view(np.uint8) & NOISE_BITS) != 0
    return LidarScan(stamp_ns, points, stamps_ns, noise, in_map)


def _check_counts(claimed: int, count: int, left: int, stride: int) -> None:
    if claimed != count:
        raise CdrError(f"point_num is {claimed}, but {count} points follow")
    needed = stride * (count - 1) + POINT_BYTES if count else 0
    if left < needed:
        raise CdrError(f"{count} points need {needed} bytes, {left} are left")
    if left - needed >= stride:
        raise CdrError(f"{count} points are claimed, but {left - needed} bytes follow them")
