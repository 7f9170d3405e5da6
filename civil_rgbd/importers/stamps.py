"""Time stamps of a set's images."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from civil_rgbd.errors import RecordingError
from civil_rgbd.importers.folders import Pair
from civil_rgbd.importers.numbers import is_number, read_table, read_text, stamp_ns

STAMP_FILES: Final = (
    *("timestamps.txt", "timestamps.csv", "times.txt", "stamps.txt", "time.txt", "timestamp.txt"),
    *("images/timestamps.txt", "rgb/timestamps.txt", "image_timestamps.txt"),
)
"""Where the stamps of a set's images are looked for, in this order."""

_EPOCH_S: Final = 10**8  # a file name above this is a stamp since 1970, not a place in a list


def find_stamps(root: Path) -> Path | None:
    """Return the first of :data:`STAMP_FILES` in a folder; None where there is none."""
    return next((root / name for name in STAMP_FILES if (root / name).is_file()), None)


def stamps_of(pairs: Sequence[Pair], path: Path | None) -> list[int] | None:
    """Return the images' stamps, nanoseconds: from a file, else from their names.

    The file has one stamp a line, as many as images or more with the image's name beside each.

    Args:
        pairs: the images, in order.
        path: the file; None looks at the names alone.

    Returns:
        one an image; None where neither says any.

    Raises:
        RecordingError: the file does not fit the images.
    """
    if path is None:
        return _from_names(pairs)
    lines = [line.strip() for line in read_text(path).splitlines()]
    lines = [line for line in lines if line and not line.startswith("#")]
    if lines and not lines[0][0].isdigit() and not is_number(lines[0].split(",")[0].split()[0]):
        lines = lines[1:]  # a header
    dated = [line for line in lines if "-" in line[1:10] and ":" in line]
    if len(dated) == len(lines) == len(pairs):  # KITTI writes dates, with a blank inside
        return [stamp_ns(line, where=path) for line in lines]
    rows = [row for row in read_table(path).rows if is_number(row[0])]
    if len(rows) == len(pairs) and all(len(row) == 1 for row in rows):
        return [stamp_ns(row[0], where=path) for row in rows]
    named = _by_name(rows, path)
    missing = [pair.rgb.name for pair in pairs if pair.key not in named]
    if missing or not pairs:
        raise RecordingError(
            f"{len(rows)} stamps do not fit {len(pairs)} images"
            + (f": {missing[0]} has none" if missing and named else ""),
            where=path,
            fix="write one stamp a line, one for each image, or `id stamp`",
        )
    return [named[pair.key] for pair in pairs]


def _by_name(rows: Sequence[tuple[str, ...]], path: Path) -> dict[int | str, int]:
    """Stamps by image where a row has both: ``id stamp``, ``stamp file``."""
    found: dict[int | str, int] = {}
    for row in rows:
        if len(row) < 2:
            return {}
        if is_number(row[1]):
            name, word = row[0], row[1]
        else:
            name, word = Path(row[1]).stem, row[0]
        number = float(name) if is_number(name) else 0.5
        found[int(number) if number.is_integer() else name] = stamp_ns(word, where=path)
    return found


def _from_names(pairs: Sequence[Pair]) -> list[int] | None:
    words = [pair.rgb.stem for pair in pairs]
    if all(is_number(word) and float(word) > _EPOCH_S for word in words):
        return [stamp_ns(word, where=pair.rgb) for word, pair in zip(words, pairs, strict=True)]
    return None
