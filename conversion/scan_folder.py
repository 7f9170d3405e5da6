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
    tried,
)
from civil_rgbd.conversion.pcd import read_pcd
from civil_rgbd.conversion.ply import read_ply
from civil_rgbd.conversion.point_table import PointTable, reading_cloud, scan_from_table
from civil_rgbd.conversion.point_time import IGNORE, PointTime, point_time_of
from civil_rgbd.domain.folders import file_source, files_in_order, folder_source
from civil_rgbd.domain.inspection import CloudFacts, RecordingSummary, TopicSummary, timing_of
from civil_rgbd.domain.recording import Recording, RecordingNotes, RecordingOptions
from civil_rgbd.domain.scan import LidarScan
from civil_rgbd.domain.stamps import read_stamp_list
from civil_rgbd.errors import CivilRgbdError, RecordingError, UsageError

READERS: Final[dict[str, Callable[[Path], PointTable]]] = {
    ".pcd": read_pcd,
    ".ply": read_ply,
    ".las": read_las,
    ".laz": read_las,
}
"""What reads each kind of file."""

_FRAMES: Final = ("map", "lidar")
_NO_REACH: Final = (0, 0)
_TRIED: Final = 10  # files that are looked at for one that is whole


@dataclass(frozen=True, slots=True, eq=False)
class ScanFiles:
    """Scans, a file each; fits :class:`civil_rgbd.conversion.lidar_only.Scans`.

    Attributes:
        paths: the files.
        stamps_ns: (S,) int64, LiDAR clock.
        point_time: how their time column is to be read; None = the points have none.
        in_map: the points are in the map frame already.
        salvage: go on without files that cannot be read; they are counted.
    """

    paths: tuple[Path, ...]
    stamps_ns: NDArray[np.int64]
    point_time: PointTime | None
    in_map: bool
    salvage: bool = False

    @property
    def reach_ns(self) -> tuple[int, int]:
        """How far point stamps may lie from their scan's."""
        return self.point_time.reach_ns if self.point_time else _NO_REACH

    def read(self, index: int) -> LidarScan:
        """Decode one scan.

        Raises:
            RecordingError: the file breaks its layout or cannot be read, and is not to be left out.
        """
        path, stamp_ns = self.paths[index], int(self.stamps_ns[index])
        try:
            with reading_cloud(path):
                table = READERS[path.suffix.lower()](path)
                return scan_from_table(table, stamp_ns, self.point_time, in_map=self.in_map)
        except RecordingError:
            if not self.salvage:
                raise
        return LidarScan.lost(stamp_ns, in_map=self.in_map)


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
    times, paths, stamps_ns = _stamped(folder, files, options)
    first = _first_scan(paths, salvage=options.salvage)
    point_time = _point_time(first, options, int(stamps_ns[paths.index(first.path)]))
    remarks = first.table.remarks
    deskew = "registered" if in_map else "per_point" if point_time else "unavailable"
    if deskew == "unavailable":
        remarks = (*remarks, NO_POINT_TIMES)
    left_out = len(files) - len(paths)
    whole = tuple(path.absolute() for path in paths)
    source = LidarSource(
        name=given.stem if given.is_file() else folder.resolve().name,
        scans=ScanFiles(whole, stamps_ns, point_time, in_map, options.salvage),
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


def inspect_recording(
    location: str | Path, options: RecordingOptions | None = None
) -> RecordingSummary:
    """Say what a folder of scans holds, whether a build can use it or not.

    Args:
        location: the folder, or one file of it.
        options: what the user says about it.

    Raises:
        RecordingError: there are no scans, or several kinds of them.
    """
    given, options = Path(location), options or RecordingOptions()
    folder, files = _files(given)
    stamps_ns, unstamped = np.zeros(0, dtype=np.int64), None
    try:
        _, files, stamps_ns = _stamped(folder, files, options)
    except CivilRgbdError as error:
        unstamped = error.what
    name, timing = folder.resolve().name, timing_of(stamps_ns)
    cloud, fault = _cloud_facts(files, options)
    topic = TopicSummary(
        name,
        f"{files[0].suffix.removeprefix('.').upper()} files",
        "lidar",
        messages=len(files),
        encoding="files",
        stamped=timing,
        frames=(options.scans_in,) if options.scans_in else (),
        fault=fault,
        unstamped=unstamped,
        cloud=cloud,
    )
    summary = RecordingSummary(
        name=given.name or name,
        converter="scans",
        size_bytes=sum(path.stat().st_size for path in files),
        messages=len(files),
        logged=timing,
        topics=(topic,),
        lidar_only=True,
    )
    return tried(summary, lambda: open_recording(given, options))


def _stamped(
    folder: Path, files: tuple[Path, ...], options: RecordingOptions
) -> tuple[Path, tuple[Path, ...], NDArray[np.int64]]:
    """Return the time list, the scans that it stamps in order of time, and their stamps."""
    times = options.scan_times or find_times(folder, "--scan-times")
    return times, *match_stamps(files, read_stamp_list(times))


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


@dataclass(frozen=True, slots=True, eq=False)
class _Read:
    """A scan file, read whole."""

    path: Path
    table: PointTable


def _first_scan(paths: tuple[Path, ...], *, salvage: bool) -> _Read:
    """Read the first scan that has points; a scan without any where none has.

    Raises:
        RecordingError: it cannot be read; under ``salvage``, a few others neither.
    """
    faults: list[RecordingError] = []
    empty: _Read | None = None
    for path in paths:
        try:
            with reading_cloud(path):
                read = _Read(path, READERS[path.suffix.lower()](path))
        except RecordingError as error:
            faults.append(error)
            if not salvage or len(faults) == _TRIED:
                raise faults[0] from error.__cause__
            continue
        if read.table.count:
            return read
        empty = empty or read
    if empty is None:
        raise faults[0]
    return empty


def _point_time(first: _Read, options: RecordingOptions, stamp_ns: int) -> PointTime | None:
    """Settle how point times are read: a wrong unit shows now, not after an hour."""
    point_time = point_time_of(first.table.types, options.point_time, where=first.path)
    with reading_cloud(first.path):
        scan_from_table(first.table, stamp_ns, point_time, in_map=False)
    return point_time


def _cloud_facts(
    files: tuple[Path, ...], options: RecordingOptions
) -> tuple[CloudFacts | None, str | None]:
    """Say what the first scan with points shows, or why none can be read."""
    try:
        first = _first_scan(files, salvage=options.salvage)
    except RecordingError as error:
        return None, f"{Path(error.where).name}: {error.what}"
    count, fields = first.table.count, tuple(first.table.types.items())
    try:
        point_time = point_time_of(first.table.types, options.point_time, where=first.path)
    except CivilRgbdError as error:
        return CloudFacts(count, fields, unclear_time=error.what), None
    return CloudFacts(count, fields, point_time.meaning if point_time else None), None
