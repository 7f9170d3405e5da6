"""A cloud from a file of its own: named columns, whatever the file's format, to a scan."""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.conversion.cdr import ContentError
from civil_rgbd.conversion.point_clouds import NOISE_BITS
from civil_rgbd.conversion.point_time import PointTime, point_stamps_ns
from civil_rgbd.domain.scan import LidarScan
from civil_rgbd.errors import RecordingError

_TAG: Final = ("tag", "u1")


class LayoutError(ValueError):
    """A cloud file breaks its layout; the caller knows which file it is."""


@dataclass(frozen=True, slots=True, eq=False)
class PointTable:
    """The points of one file.

    Attributes:
        count: how many there are.
        columns: (N,) each, as recorded, by name; the first of equal names.
        remarks: what is odd about the file, in words.
    """

    count: int
    columns: dict[str, NDArray[np.generic]]
    remarks: tuple[str, ...] = ()

    @property
    def types(self) -> dict[str, str]:
        """Column name to numpy type without byte order."""
        return {name: values.dtype.str[1:] for name, values in self.columns.items()}


@contextmanager
def reading_cloud(path: Path) -> Iterator[None]:
    """Turn faults of a cloud file inside the block into one :class:`RecordingError`.

    Raises:
        RecordingError: the file breaks its layout or cannot be read.
    """
    try:
        yield
    except ContentError as error:
        raise RecordingError(
            f"the scan cannot be used: {error}", where=path, fix=error.fix
        ) from error
    except LayoutError as error:
        raise RecordingError(
            f"the scan breaks its own layout: {error}",
            where=path,
            fix="export or copy the file again, or go on without it: --salvage",
        ) from error
    except OSError as error:
        raise RecordingError(
            f"the scan cannot be read: {error.strerror or error}",
            where=path,
            fix="check the disk and the file's permissions, or go on without it: --salvage",
        ) from error


def read_ascii_columns(text: bytes, codes: Sequence[str], rows: int) -> list[NDArray[np.generic]]:
    """Read columns of numbers separated by spaces.

    Args:
        text: the lines, of which blank ones do not count.
        codes: numpy type of each column.
        rows: how many lines are to be read.

    Returns:
        (rows,) each. All are float64 when some number does not fit its type: writers differ.

    Raises:
        LayoutError: there are fewer lines, or something in them is no number.
    """
    if not rows or not codes:
        return [np.zeros(0, dtype=code) for code in codes]
    if rows * 2 * len(codes) > len(text) + 1:  # a digit and what separates it from the next
        raise LayoutError(f"{rows} lines of {len(codes)} numbers do not fit {len(text)} bytes")
    last_fault: ValueError | None = None
    for types in (codes, ["f8"] * len(codes)):
        dtype = np.dtype([(f"c{at}", code) for at, code in enumerate(types)])
        try:
            table = np.loadtxt(
                io.BytesIO(text),
                dtype=dtype,
                comments=None,
                usecols=range(len(codes)),
                encoding="latin-1",
                max_rows=rows,
                ndmin=1,
            )
        except (ValueError, OverflowError) as error:
            last_fault = ValueError(str(error))
            continue
        if len(table) < rows:
            raise LayoutError(f"{rows} points are claimed, {len(table)} lines follow")
        return [table[name] for name in dtype.names or ()]
    raise LayoutError(f"its points are no numbers: {last_fault}")


def scan_from_table(
    table: PointTable, stamp_ns: int, point_time: PointTime | None, *, in_map: bool
) -> LidarScan:
    """Make a scan of a file's points.

    Args:
        table: needs columns x, y and z; ``tag`` (Livox) tells noise.
        stamp_ns: of the scan, LiDAR clock.
        point_time: how its time column is to be read; None = its points have none.
        in_map: the points are in the map frame already.

    Raises:
        LayoutError: a column is missing.
        ContentError: point times are not near the scan's stamp.
    """
    wanted = ["x", "y", "z", *([point_time.field] if point_time else [])]
    for name in wanted:
        if name not in table.columns and table.count:
            known = ", ".join(map(repr, table.columns)) or "none"
            raise LayoutError(f"it has no column {name!r}; its columns are {known}")
    if not table.count:
        stamps = np.zeros(0, dtype=np.int64) if point_time else None
        return LidarScan(stamp_ns, np.zeros((0, 3), np.float32), stamps, in_map=in_map)
    columns = [table.columns[name] for name in "xyz"]
    points = np.empty((table.count, 3), dtype=np.result_type(np.float32, *columns))
    with np.errstate(invalid="ignore"):  # a signalling NaN is as good as any
        for axis, values in enumerate(columns):
            points[:, axis] = values
    stamps_ns = noise = None
    if point_time is not None:
        values = table.columns[point_time.field]
        stamps_ns = point_stamps_ns(values, point_time, header_ns=stamp_ns, points=points)
    if table.types.get(_TAG[0]) == _TAG[1]:
        noise = (table.columns[_TAG[0]].astype(np.uint8) & NOISE_BITS) != 0
    return LidarScan(stamp_ns, points, stamps_ns, noise, in_map)
