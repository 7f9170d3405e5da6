"""Files of ROS messages, of one kind and in order: opened, inspected, or opened for odometry."""

from __future__ import annotations

from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path

from civil_rgbd.conversion.container import Container
from civil_rgbd.conversion.inspection import Walked, WatchedTable, summarise
from civil_rgbd.conversion.ros_assembly import Opened, assemble
from civil_rgbd.conversion.ros_motion import MotionTable, assemble_motion
from civil_rgbd.conversion.several_files import judge, opened_files, walk_files
from civil_rgbd.conversion.topics import TopicTable
from civil_rgbd.domain.inspection import RecordingSummary
from civil_rgbd.domain.motion import MotionRecording
from civil_rgbd.domain.recording import Recording, RecordingNotes, RecordingOptions
from civil_rgbd.errors import RecordingError
from civil_rgbd.storage.places import Place, place_of


@dataclass(frozen=True, slots=True)
class RosFiles:
    """A recording before it is opened.

    Attributes:
        container: the kind of its files.
        paths: in order.
        name: of the recording.
        where: what the user gave, for errors.
    """

    container: Container
    paths: tuple[Place, ...]
    name: str
    where: object


def files_of(container: Container, location: str | Place, options: RecordingOptions) -> RosFiles:
    """Return the file at a location and those that go on from it.

    A location may be a folder of files that the recorder left without its metadata.yaml.
    """
    first = place_of(location)
    paths: tuple[Place, ...] = (first,)
    if isinstance(first, Path) and first.is_dir():
        paths = files_inside(container, first)
    more = tuple(place_of(path) for path in options.more_files)
    return RosFiles(container, paths + more, stem_of(first), first)


def stem_of(path: Place) -> str:
    """Return a recording's name: the file's, without what says how it is stored.

    >>> stem_of(Path("scan.bag.active")), stem_of(Path("scan_0.db3.zstd")), stem_of(Path("a.b.bag"))
    ('scan', 'scan_0', 'a.b')
    """
    name = path.name
    for suffix in (".active", ".zstd", ".zst", ".bag", ".db3", ".mcap"):
        if name.lower().endswith(suffix) and len(name) > len(suffix):
            name = name[: -len(suffix)]
    return name


def files_inside(container: Container, folder: Path) -> tuple[Path, ...]:
    """Return the files of one recording in a folder, in the order in which they were split.

    Raises:
        RecordingError: there are none, or those of several recordings.
    """
    suffixes = [f".{container.name}{packed}" for packed in ("", ".zstd", ".zst")]
    found = [path for path in folder.iterdir() if path.name.lower().endswith(tuple(suffixes))]
    if not found:
        raise RecordingError(
            f"the folder holds no .{container.name} file",
            where=folder,
            fix="name the recording itself",
        )
    splits = sorted((_split(path), path) for path in found)
    if len({name for (name, _), _ in splits}) > 1:
        raise RecordingError(
            "the folder holds several recordings: " + ", ".join(path.name for _, path in splits),
            where=folder,
            fix="name one of them",
        )
    return tuple(path for _, path in splits)


def _split(path: Path) -> tuple[str, int]:
    """Return name and number of a file as recorders split them: scan_0, scan_1, ..."""
    name, underscore, number = stem_of(path).rpartition("_")
    if underscore and number.isascii() and number.isdigit():
        return name, int(number)
    return stem_of(path), 0


def open_files(files: RosFiles, options: RecordingOptions) -> Recording:
    """Open a recording: read it once, keep stamps, places and poses.

    Raises:
        RecordingError: it is not there, damaged, or lacks what a build needs.
        UsageError: an option does not fit, or one is needed to choose.
    """
    with _opened(files, options, TopicTable()) as opened:
        return assemble(opened, options)


def open_files_for_motion(files: RosFiles, options: RecordingOptions) -> MotionRecording:
    """Open LiDAR and IMU, for odometry; errors as :func:`open_files`."""
    with _opened(files, options, MotionTable()) as opened:
        return assemble_motion(opened, options)


def _opened(
    files: RosFiles, options: RecordingOptions, table: TopicTable
) -> AbstractContextManager[Opened]:
    return opened_files(
        files.container, files.paths, options, table, name=files.name, where=files.where
    )


def inspect_files(files: RosFiles, options: RecordingOptions) -> RecordingSummary:
    """Say what a recording holds, whether a build can use it or not.

    Raises:
        RecordingError: it is not there, of another kind, or cannot be read at all.
    """
    watched = WatchedTable()
    found = walk_files(files.container, files.paths, watched.sink_for)
    extent, refused = found.extent, None
    try:
        judge(extent, files.container, options, where=files.where)
    except RecordingError as error:
        refused = error
    opened = Opened(
        watched.table, found.payloads, found.sources, files.name, files.where, RecordingNotes()
    )
    walked = Walked(
        files.container.name,
        place_of(str(files.where)).name,
        sum(source.size_bytes for source in found.sources),
        extent.messages,
        tuple(extent.damage),
        tuple(extent.remarks),
        refused,
    )
    try:
        return summarise(watched, opened, walked, options)
    finally:
        found.payloads.close()
