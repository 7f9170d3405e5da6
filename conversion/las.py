"""LAS and LAZ files, through laspy: coordinates in float64, as maps of a country need them."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.conversion.point_table import LayoutError, PointTable
from civil_rgbd.errors import MissingExtraError

GPS_TIME: Final = "gps_time"
_SIGNATURE: Final = b"LASF"
_HEADER: Final = struct.Struct("<HIIBHI")  # at byte 94: header, data, VLRs, format, record, points
_HEADER_AT: Final = 94
_POINTS_14_AT: Final = 247
_HEADER_14_BYTES: Final = 375
_VLR_BYTES: Final = 54
_LAZ_BIT: Final = 0x80
_CHUNK_POINTS: Final = 1_000_000


def read_las(path: Path) -> PointTable:
    """Read x, y, z and, where it says anything, gps_time.

    Raises:
        LayoutError: it breaks the format.
        OSError: it cannot be read.
        MissingExtraError: laspy is not installed.
    """
    try:
        import laspy
    except ImportError as error:
        raise MissingExtraError(
            "LAS and LAZ files need laspy", where=path, fix='pip install "civil-rgbd[las]"'
        ) from error
    count = _checked_count(path)
    parts: list[NDArray[np.float64]] = []
    times: list[NDArray[np.float64]] = []
    try:
        with laspy.open(path, read_evlrs=False) as reader:
            timed = GPS_TIME in reader.header.point_format.dimension_names
            # In chunks: what a lying header claims beyond the data is never allocated.
            for chunk in reader.chunk_iterator(_CHUNK_POINTS):
                parts.append(np.stack([chunk.x, chunk.y, chunk.z], axis=1))
                if timed:
                    times.append(np.array(chunk[GPS_TIME], dtype=np.float64))
    except OSError:
        raise
    except Exception as error:  # laspy and lazrs raise whatever a broken file leads them to
        raise LayoutError(f"laspy cannot read it: {error}") from error
    points = np.concatenate(parts) if parts else np.zeros((0, 3))
    if len(points) != count:
        raise LayoutError(f"its header claims {count} points, {len(points)} follow")
    columns: dict[str, NDArray[np.generic]] = {
        name: points[:, axis] for axis, name in enumerate("xyz")
    }
    if times and any(part.any() for part in times):  # all zero: the exporter had none
        columns[GPS_TIME] = np.concatenate(times)
    return PointTable(count, columns)


def _checked_count(path: Path) -> int:
    """Return how many points the header claims, after checking that they can be there."""
    size = path.stat().st_size
    with path.open("rb") as file:
        start = file.read(_HEADER_14_BYTES)
    if not start.startswith(_SIGNATURE) or len(start) < _HEADER_AT + _HEADER.size:
        raise LayoutError("it is no LAS file: it does not begin with 'LASF', or ends in its header")
    header, data_at, vlrs, kind, record, count = _HEADER.unpack_from(start, _HEADER_AT)
    if start[24:26] >= b"\x01\x04" and header >= _HEADER_14_BYTES <= len(start):
        (count,) = struct.unpack_from("<Q", start, _POINTS_14_AT)
    if data_at > size or header > data_at or vlrs * _VLR_BYTES > data_at - header:
        raise LayoutError(
            f"its header of {header} bytes with {vlrs} records before the data at byte {data_at} "
            f"does not fit the file of {size} bytes"
        )
    if not kind & _LAZ_BIT and count * record > size - data_at:
        raise LayoutError(
            f"{count} points of {record} bytes need {count * record} bytes, {size - data_at} follow"
        )
    return int(count)
