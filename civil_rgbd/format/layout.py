"""Which file lies where, and which folders are bridges."""

from __future__ import annotations

import re
from typing import Final

from civil_rgbd.constants import BRIDGE_ID_PATTERN
from civil_rgbd.errors import FormatError
from civil_rgbd.resources import nearest
from civil_rgbd.storage.places import Place, entries_of, is_remote, place_of

MANIFEST: Final = "manifest.json"
INTRINSICS: Final = "intrinsics.json"
POSES: Final = "poses.json"
FRAMES: Final = "frames.parquet"
DEFECTS: Final = "defects.json"
DATASET: Final = "dataset.json"
BRIDGES: Final = "bridges"
"""Folder of the bridge folders in a dataset."""
PARTIAL: Final = ".partial"
"""Folder of unfinished bridges in a dataset."""

IMAGE_SUFFIXES: Final = {"jpeg": ".jpg", "png": ".png"}
"""Ending of a colour image's file, by codec."""


def rgb_path(frame_id: str, codec: str) -> str:
    """Return where a frame's colour image lies, relative to its bridge.

    >>> rgb_path("000042", "jpeg")
    'rgb/000042.jpg'
    """
    return f"rgb/{frame_id}{IMAGE_SUFFIXES[codec]}"


def depth_path(frame_id: str) -> str:
    """Return where a frame's depth lies, relative to its bridge.

    >>> depth_path("000042")
    'depth/000042.exr'
    """
    return f"depth/{frame_id}.exr"


def quality_path(frame_id: str) -> str:
    """Return where a frame's quality planes lie, relative to its bridge.

    >>> quality_path("000042")
    'quality/000042.exr'
    """
    return f"quality/{frame_id}.exr"


def is_bridge(folder: Place) -> bool:
    """Tell whether a folder is a whole bridge: its manifest is written last."""
    return (folder / MANIFEST).is_file()


def is_dataset(folder: Place) -> bool:
    """Tell whether a folder is a dataset, with or without bridges in it."""
    return (folder / DATASET).is_file() or (folder / BRIDGES).is_dir()


def dataset_bridges(dataset: Place) -> dict[str, Place]:
    """Return the whole bridges of a dataset folder by id, sorted; {} when there are none."""
    return {
        folder.name: folder
        for folder in entries_of(dataset / BRIDGES)
        if re.fullmatch(BRIDGE_ID_PATTERN, folder.name) and is_bridge(folder)
    }


def bridge_folders(location: str | Place) -> dict[str, Place]:
    """Find the whole bridges of a dataset folder, or the one bridge that a folder is.

    Args:
        location: a dataset folder or one bridge folder.

    Returns:
        folders by bridge id (a folder's name), sorted; {} for a dataset without a whole bridge.

    Raises:
        FormatError: the folder is missing, or neither a dataset nor a bridge.
    """
    return _bridge_folders(place_of(location))


def _bridge_folders(location: Place) -> dict[str, Place]:
    if not location.exists():
        raise FormatError("there is no such folder", where=location, fix=_where_else(location))
    if not location.is_dir():
        raise FormatError(
            "this is a file; a dataset and a bridge are folders",
            where=location,
            fix=f"give the folder that holds {BRIDGES}/ or {MANIFEST}",
        )
    if is_bridge(location):
        return {location.resolve().name: location}
    if is_dataset(location):
        return dataset_bridges(location)
    inside = [entry.name for entry in entries_of(location) if _holds_bridges(entry)]
    raise FormatError(
        f"this is neither a dataset (it has no {BRIDGES}/ and no {DATASET}) "
        f"nor a whole bridge (it has no {MANIFEST})",
        where=location,
        fix=f"did you mean {location / inside[0]}?"
        if inside
        else "give the folder that was the `--out` of a build, or one folder of its bridges/",
    )


def _holds_bridges(entry: Place) -> bool:
    return entry.is_dir() and (is_bridge(entry) or is_dataset(entry))


def _where_else(location: Place) -> str:
    parent = location.parent
    if is_remote(location):
        return "check bucket and key; a folder is there once something is in it"
    if not parent.is_dir():
        return f"{parent} does not exist either: check the path"
    names = [entry.name for entry in parent.iterdir() if entry.is_dir() and entry.name[0] != "."]
    return nearest(location.name, names) if names else f"{parent} holds no folder"
