"""LAS and LAZ files, through laspy: coordinates in float64, as maps of a country need them."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.conversion.las_header import LasHeader, checked_las_header
from civil_rgbd.conversion.point_table import LayoutError, PointTable
from civil_rgbd.errors import MissingExtraError

GPS_TIME: Final = "gps_time"

_CHUNK_POINTS: Final = 1_000_000
_LEAST_POINTS: Final = 1_000


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
    header = checked_las_header(path)
    parts: list[NDArray[np.float64]] = []
    times: list[NDArray[np.float64]] = []
    try:
        # One thread: builds run a process a core already.
        backend = laspy.LazBackend.Lazrs
        with (
            laspy.open(path, read_evlrs=False, laz_backend=backend) as reader,
            np.errstate(all="ignore"),  # a broken scale makes no number: filtered like any NaN
        ):
            timed = GPS_TIME in reader.header.point_format.dimension_names
            for chunk in reader.chunk_iterator(_points_at_once(header)):
                parts.append(np.stack([chunk.x, chunk.y, chunk.z], axis=1))
                if timed:
                    times.append(np.array(chunk[GPS_TIME], dtype=np.float64))
    except OSError:
        raise
    except Exception as error:  # laspy and lazrs raise whatever a broken file leads them to
        raise LayoutError(f"laspy cannot read it: {error}") from error
    points = np.concatenate(parts) if parts else np.zeros((0, 3))
    if len(points) != header.count:
        raise LayoutError(f"its header claims {header.count} points, {len(points)} follow")
    columns: dict[str, NDArray[np.generic]] = {
        name: points[:, axis] for axis, name in enumerate("xyz")
    }
    if times and any(part.any() for part in times):  # all zero: the exporter had none
        columns[GPS_TIME] = np.concatenate(times)
    return PointTable(header.count, columns)


def _points_at_once(header: LasHeader) -> int:
    # What a lying header claims beyond the data is never allocated.
    fitting = 8 * header.size_bytes // header.point_bytes
    return max(_LEAST_POINTS, min(_CHUNK_POINTS, fitting))
