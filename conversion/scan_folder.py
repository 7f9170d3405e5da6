"""A folder of scans, one PCD, PLY, LAS or LAZ file each, with their stamps in a list."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.conversion.beside import refuse_topics
from civil_rgbd.conversion.image_folder import find_times, match_stamps
from civil_rgbd.conversion.las import read_las
from civil_rgbd.conversion.lidar_only import (
    NO_POINT_TIMES,
    LidarSource,
    assemble_lidar_only,
)
from civil_rgbd.conversion.pcd import read_pcd
from civil_rgbd.conversion.ply import read_ply
from civil_rgbd.conversion.point_table import PointTable, reading_cloud, scan_from_table
from civil_rgbd.conversion.point_time import IGNORE, PointTime, point_time_of
from civil_rgbd.domain.folders import file_source, files_in_order, folder_source
from civil_rgbd.domain.recording import Recording, RecordingNotes, RecordingOptions
from civil_rgbd.domain.scan import LidarScan
from civil_rgbd.domain.stamps import read_stamp_list
from civil_rgbd.errors import RecordingError, UsageError

READERS: Final[dict[str, Callable[[Path], PointTable]]] = {
    ".pcd": read_pcd,
    ".ply": read_ply,
    ".las": read_las,
    ".laz": read_las,
}
"""What reads each kind of file."""

_FRAMES: Final = ("map", "lidar")
_NO_REACH: Final = (0, 0)


@dataclass(frozen=True, slots=True, eq=False)
class ScanFiles:
    """Scans, a file each; fits :class:`civil_rgbd.conversion.lidar_only.Scans`.

    Attributes:
        paths: the files.
        stamps_ns: (S,) int64, LiDAR clock.
        point_time: how their time column is to be read; None = the points have none.
        in_map: the points are in the map frame already.
    """

    paths: tuple[Path, ...]
    stamps_ns: NDArray[np.int64]
    point_time: PointTime | None
    in_map: bool

    @property
    def reach_ns(self) -> tuple[int, int]:
        """How far point stamps may lie from their scan's."""
        return self.point_time.reach_ns if self.point_time else _NO_REACH

    def read(self, index: int) -> LidarScan:
        """Decode one scan.

        Raises:
            RecordingError: the file breaks its layout or cannot be read.
        """
        path = self.paths[index]
        with reading_cloud(path):
            table = READERS[path.suffix.lower()](path)
            stamp_ns = int(self.stamps_ns[index])
            return scan_from_table(table, stamp_ns, self.point_time, in_map=self.in_map)


def open_recording(location: str | Path, options: RecordingOptions | None = None) -> Recording:
    """Open a folder of scans; what a camera and poses need comes from files beside it.

    Args:
        location: the folder, or one file of it for a recording of one scan.
        options: what the user says about it.

    Raises:
        RecordingError: files are missing, damaged, or do not belong to each other.
        UsageError: an option does not fit, or one is needed.
    """
    given, options = Path(location), options or RecordingOptions()
    refuse_topics(options, "lidar_topic", where=given)
    in_map = _in_map(options, given)
    folder, files = _files(given)
    times = options.scan_times or find_times(folder, "--scan-times")
    paths, stamps_ns = match_stamps(files, read_stamp_list(times))
    point_time, remarks = _settle(paths, options)
    deskew = "registered" if in_map else "per_point" if point_time else "unavailable"
    if deskew == "unavailable":
        remarks = (*remarks, NO_POINT_TIMES)
    left_out = len(files) - len(paths)
    source = LidarSource(
        name=given.stem if given.is_file() else folder.resolve().name,
        scans=ScanFiles(tuple(path.absolute() for path in paths), stamps_ns, point_time, in_map),
        sources=(folder_source(folder, paths, "scans"), file_source(times, "times")),
        in_map=in_map,
        lidar_name="",
        notes=RecordingNotes(
            deskew=deskew,
            reading={"point_time": point_time.words if point_time else IGNORE},
            warnings=remarks,
            counts={"scan-file-without-stamp": left_out} if left_out else {},
        ),
        where=given,
    )
    return assemble_lidar_only(source, options)


def _in_map(options: RecordingOptions, where: Path) -> bool:
    if options.scans_in not in _FRAMES:
        raise UsageError(
            "files do not say which frame their points are in",
            where=where,
            fix="say so: --scans-in lidar for scans as measured, map for registered ones",
        )
    return options.scans_in == "map"


def _files(given: Path) -> tuple[Path, tuple[Path, ...]]:
    """Return the folder and its scans."""
    if given.is_file() and given.suffix.lower() in READERS:
        return given.parent, (given,)
    files = files_in_order(given, tuple(READERS))
    kinds = {path.suffix.lower() for path in files}
    if not files:
        raise RecordingError(
            "the folder holds no scans",
            where=given,
            fix=f"give the folder with the {', '.join(READERS)} files themselves",
        )
    if len(kinds) > 1:
        raise RecordingError(
            f"the folder holds scans of several kinds: {', '.join(sorted(kinds))}",
            where=given,
            fix="keep each kind in a folder of its own",
        )
    return given, files


def _settle(
    paths: tuple[Path, ...], options: RecordingOptions
) -> tuple[PointTime | None, tuple[str, ...]]:
    """Settle how point times are read, by the first scan that has points."""
    table = PointTable(0, {})
    for path in paths:
        with reading_cloud(path):
            table = READERS[path.suffix.lower()](path)
        if table.count:
            break
    point_time = point_time_of(table.types, options.point_time, where=path)
    return point_time, table.remarks
