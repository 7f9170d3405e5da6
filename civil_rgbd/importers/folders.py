"""Where a set's images lie, and which image belongs to which depth."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from civil_rgbd.errors import RecordingError

IMAGE_SUFFIXES: Final = (".png", ".jpg", ".jpeg", ".pgm", ".ppm", ".tif", ".tiff", ".bmp")
COLOUR_FOLDERS: Final = ("rgb", "color", "colour", "images", "image")
DEPTH_FOLDERS: Final = ("depth", "depths", "depth_images")

_KIND: Final = re.compile(r"([._-]?)(rgb|colou?r|depth|image|img|frame)([._-]?)", re.IGNORECASE)
_LARGEST_ID: Final = 10**9  # larger numbers are stamps, not places in a list

Key = int | str
"""What an image and its depth have in common: a number, else a name."""


@dataclass(frozen=True, slots=True)
class Pair:
    """A colour image and, where there is one, its depth.

    Attributes:
        key: what names both.
        rgb: the colour image.
        depth: the depth image; None where it is missing.
    """

    key: Key
    rgb: Path
    depth: Path | None


def find_folders(
    source: Path, colour: Sequence[str] = COLOUR_FOLDERS, depth: Sequence[str] = DEPTH_FOLDERS
) -> tuple[Path, Path, Path]:
    """Find the folders of colour and depth images.

    Args:
        source: the set's folder, or one that holds just this set.
        colour: names to look for, the first that is there wins.
        depth: the same.

    Returns:
        the folder that holds both, the colour folder, the depth folder.

    Raises:
        RecordingError: they are not there, or several sets lie side by side.
    """
    require_folder(source)
    here = _both(source, colour, depth)
    if here is not None:
        return here
    inner = [_both(entry, colour, depth) for entry in sorted(source.iterdir()) if entry.is_dir()]
    found = [folders for folders in inner if folders is not None]
    if len(found) == 1:
        return found[0]
    if found:
        names = ", ".join(folders[0].name for folders in found)
        raise RecordingError(
            f"{len(found)} sets lie here: {names}",
            where=source,
            fix=f"convert them one by one, for example {source / found[0][0].name}",
        )
    raise RecordingError(
        f"no colour and depth images are found: looked for a folder {' or '.join(colour)} beside "
        f"a folder {' or '.join(depth)}",
        where=source,
        fix="give the folder that holds both, or another --from",
    )


def require_folder(source: Path) -> None:
    """Refuse what is no folder.

    Raises:
        RecordingError: it is none.
    """
    if not source.is_dir():
        raise RecordingError(
            "this is a file; a rendered set is a folder"
            if source.exists()
            else "there is no such folder",
            where=source,
            fix="check the path; an archive is unpacked first",
        )


def _both(
    folder: Path, colour: Sequence[str], depth: Sequence[str]
) -> tuple[Path, Path, Path] | None:
    rgb = next((folder / name for name in colour if (folder / name).is_dir()), None)
    raw = next((folder / name for name in depth if (folder / name).is_dir()), None)
    return None if rgb is None or raw is None else (folder, rgb, raw)


def list_images(folder: Path) -> list[Path]:
    """Return the image files of a folder; hidden files are none."""
    return [
        entry
        for entry in folder.iterdir()
        if entry.suffix.lower() in IMAGE_SUFFIXES and entry.name[0] != "." and entry.is_file()
    ]


def key_of(path: Path) -> Key:
    """Return what names a frame: its number where it has one, else its name without the kind.

    >>> key_of(Path("000012.png")), key_of(Path("frame-000012.color.jpg"))
    (12, 12)
    >>> key_of(Path("1305031102.175304.png"))
    '1305031102.175304'
    """
    stem = _KIND.sub("", path.stem)
    return int(stem) if re.fullmatch(r"[0-9]+", stem) else stem


def pair_images(rgb: Iterable[Path], depth: Iterable[Path]) -> tuple[list[Pair], int]:
    """Join colour and depth images by their names.

    Args:
        rgb: colour images.
        depth: depth images.

    Returns:
        one pair an image, numbers in numeric order (2 before 10), then names; and how many depth
        images have no colour image.

    Raises:
        RecordingError: two images have one name, or there are none.
    """
    colours, depths = _by_key(rgb), _by_key(depth)
    if not colours:
        raise RecordingError(
            "there is no colour image", where="the set", fix="give the folder of another set"
        )
    order = sorted(colours, key=lambda key: (isinstance(key, str), key))  # ints first
    pairs = [Pair(key, colours[key], depths.get(key)) for key in order]
    return pairs, len(depths.keys() - colours.keys())


def _by_key(paths: Iterable[Path]) -> dict[Key, Path]:
    found: dict[Key, Path] = {}
    for path in paths:
        other = found.setdefault(key_of(path), path)
        if other is not path:
            raise RecordingError(
                f"{other.name} and {path.name} are the same frame",
                where=path.parent,
                fix="keep one of them",
            )
    return found


def indices_of(pairs: Sequence[Pair]) -> list[int]:
    """Return the images' numbers: those of their names where all have one, else their places."""
    numbers = [pair.key for pair in pairs if isinstance(pair.key, int)]
    named = len(numbers) == len(pairs) and max(numbers, default=0) < _LARGEST_ID
    return numbers if named else list(range(len(pairs)))
