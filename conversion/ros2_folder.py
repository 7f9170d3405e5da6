"""ROS 2 recordings as rosbag2 leaves them: a folder whose metadata.yaml lists its files."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import takewhile
from pathlib import Path, PurePosixPath
from typing import Final

from civil_rgbd.conversion.container import Container
from civil_rgbd.conversion.db3 import DB3
from civil_rgbd.conversion.mcap import MCAP
from civil_rgbd.conversion.ros_files import (
    RosFiles,
    files_inside,
    inspect_files,
    open_files,
    open_files_for_motion,
)
from civil_rgbd.conversion.several_files import unreadable
from civil_rgbd.conversion.topic_listing import list_files
from civil_rgbd.domain.inspection import RecordingSummary, TopicListing
from civil_rgbd.domain.motion import MotionRecording
from civil_rgbd.domain.recording import Recording, RecordingOptions
from civil_rgbd.errors import RecordingError

METADATA: Final = "metadata.yaml"
NAME: Final = "ros2-folder"
"""What a manifest calls this converter."""

_STORAGES: Final[dict[str, Container]] = {"sqlite3": DB3, "mcap": MCAP}


def open_recording(location: str | Path, options: RecordingOptions | None = None) -> Recording:
    """Open a ROS 2 folder: read its files once, keep stamps, places and poses.

    Args:
        location: the folder, or the metadata.yaml in it.
        options: what the user says about it; further folders of the same recording.

    Returns:
        an indexed recording; payloads are read when asked for.

    Raises:
        RecordingError: it or a file of it is not there, damaged, or lacks what a build needs.
        UsageError: an option does not fit, or one is needed to choose.
    """
    options = options or RecordingOptions()
    return open_files(_files(location, options), options)


def open_motion(location: str | Path, options: RecordingOptions | None = None) -> MotionRecording:
    """Open LiDAR and IMU of a folder, for odometry; errors as :func:`open_recording`."""
    options = options or RecordingOptions()
    return open_files_for_motion(_files(location, options), options)


def inspect_recording(
    location: str | Path, options: RecordingOptions | None = None
) -> RecordingSummary:
    """Say what a folder holds, whether a build can use it or not; errors as of a missing file."""
    options = options or RecordingOptions()
    return inspect_files(_files(location, options), options)


def list_topics(location: str | Path, options: RecordingOptions | None = None) -> TopicListing:
    """List the topics, by the index of its files where they have one."""
    return list_files(_files(location, options or RecordingOptions()))


@dataclass(frozen=True, slots=True)
class Metadata:
    """What is read of a metadata.yaml.

    Attributes:
        storage: ``storage_identifier``: sqlite3 or mcap.
        files: ``relative_file_paths``, in order.
    """

    storage: str
    files: tuple[str, ...]


def metadata_of(text: str) -> Metadata:
    r"""Read the two keys that matter; the recorder writes one key a line.

    >>> metadata_of("a:\n  storage_identifier: mcap\n  relative_file_paths:\n    - s_0.mcap\n")
    Metadata(storage='mcap', files=('s_0.mcap',))
    """
    storage = re.search(r"^\s*storage_identifier:\s*(\S+)", text, re.MULTILINE)
    listed = re.search(r"^\s*relative_file_paths:[ \t]*(.*)$", text, re.MULTILINE)
    files: tuple[str, ...] = ()
    if listed and listed[1].startswith("["):
        inner = text[listed.start(1) + 1 :].partition("]")[0]
        files = tuple(_scalar(item) for item in inner.split(",") if item.strip())
    elif listed:
        lines = takewhile(_is_item, text[listed.end() :].splitlines()[1:])
        files = tuple(_scalar(line.strip()[1:]) for line in lines)
    return Metadata(_scalar(storage[1]) if storage else "", files)


def _is_item(line: str) -> bool:
    return line.lstrip().startswith("- ")


def _scalar(text: str) -> str:
    text = text.strip()
    if len(text) > 1 and text[0] == text[-1] == '"':
        try:
            return str(json.loads(text))
        except ValueError:
            return text[1:-1]
    if len(text) > 1 and text[0] == text[-1] == "'":
        return text[1:-1].replace("''", "'")
    return text


def _files(location: str | Path, options: RecordingOptions) -> RosFiles:
    folders = [_folder(Path(str(path))) for path in (location, *options.more_files)]
    metadata = [_read_metadata(folder) for folder in folders]
    storages = {one.storage for one in metadata}
    if len(storages) > 1 or not storages <= set(_STORAGES):
        raise RecordingError(
            f"storage_identifier is {' and '.join(map(repr, sorted(storages)))}, not one of "
            f"{', '.join(_STORAGES)}",
            where=folders[0] / METADATA,
            fix="convert the recording: `ros2 bag convert` with storage_id mcap",
        )
    container = _STORAGES[storages.pop()]
    paths = tuple(
        path
        for folder, one in zip(folders, metadata, strict=True)
        for path in _paths(folder, one, container)
    )
    return RosFiles(replace(container, name=NAME), paths, folders[0].resolve().name, folders[0])


def _folder(path: Path) -> Path:
    return path.parent if path.name == METADATA else path


def _read_metadata(folder: Path) -> Metadata:
    path = folder / METADATA
    try:
        return metadata_of(path.read_text("utf-8", errors="replace"))
    except FileNotFoundError as error:
        raise RecordingError(
            f"there is no such recording: {str(folder)!r} holds no {METADATA}",
            where=folder,
            fix="check the path; without metadata.yaml name the .db3 or .mcap file itself",
        ) from error
    except OSError as error:
        raise unreadable(path, error) from error


def _paths(folder: Path, metadata: Metadata, container: Container) -> Iterator[Path]:
    if not metadata.files:  # the recorder was killed before it wrote the list
        yield from files_inside(container, folder)
    for name in metadata.files:
        # Early recorders put the folder's own name, or a whole path, before the file's.
        path = folder / PurePosixPath(name.replace("\\", "/")).name
        packed = [path.with_name(path.name + suffix) for suffix in (".zstd", ".zst")]
        there = [candidate for candidate in (path, *packed) if candidate.is_file()]
        if not there:
            raise RecordingError(
                f"{METADATA} lists {name!r}, which is not there",
                where=folder,
                fix="copy the whole folder again; or name the files that are there themselves",
            )
        yield there[0]
