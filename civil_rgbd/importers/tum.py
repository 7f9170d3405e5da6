"""TUM RGB-D: ``rgb.txt`` and ``depth.txt`` with stamps, ``groundtruth.txt``, depth x 5000.

Colour and depth have clocks of their own: each image gets the nearest depth within 20 ms, each
depth goes to one image only, as the benchmark's ``associate.py`` has it. The pose is interpolated
at the image's stamp. File formats: the benchmark's page, "File Formats".
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from civil_rgbd.errors import RecordingError
from civil_rgbd.importers.assembly import Parts, assemble
from civil_rgbd.importers.folder_set import Layout, camera_of, open_folder_set, poses_of
from civil_rgbd.importers.folders import Pair, key_of, require_folder
from civil_rgbd.importers.numbers import is_number, read_table, stamp_ns
from civil_rgbd.importers.rendered_set import ImportOptions, Intrinsics, RenderedSet

MAX_DIFFERENCE_NS: Final = 20_000_000
"""``associate.py``'s own: colour and depth further apart in time do not belong together."""

CAMERA: Final = Intrinsics(525.0, 525.0, 319.5, 239.5, width_px=640, height_px=480)
"""The set that the benchmark's page recommends for all its sequences, without undistortion."""

LAYOUT: Final = Layout("tum", scale=5000.0, usual_camera=CAMERA)
_LISTS: Final = ("rgb.txt", "depth.txt")
_ASSOCIATIONS: Final = ("associations.txt", "associate.txt", "association.txt", "assoc.txt")


@dataclass(frozen=True, slots=True)
class _Stamped:
    stamp_ns: int
    path: Path


def open_set(source: Path, options: ImportOptions) -> RenderedSet:
    """Open a sequence: by its lists, by an association file, else by equal file names.

    Raises:
        RecordingError: something is missing, or does not fit.
    """
    root = _root(source)
    lists = [root / name for name in _LISTS]
    joint = next((root / name for name in _ASSOCIATIONS if (root / name).is_file()), None)
    if all(path.is_file() for path in lists):
        rgb, depth = (_listed(path) for path in lists)
        matches = associate([image.stamp_ns for image in rgb], [image.stamp_ns for image in depth])
        pairs = [
            Pair(key_of(image.path), image.path, depth[match].path if match is not None else None)
            for image, match in zip(rgb, matches, strict=True)
        ]
        stamps = [image.stamp_ns for image in rgb]
        lonely = len(depth) - sum(match is not None for match in matches)
    elif joint is not None:
        lists, (pairs, stamps), lonely = [joint], _joined(joint), 0
    else:
        # Not the benchmark's files: its usual camera may be anybody's guess.
        words = (
            f"no {' and '.join(path.name for path in lists)}: images and depth go by their names"
        )
        opened = open_folder_set(root, options, replace(LAYOUT, usual_camera=None))
        return replace(opened, warnings=(words, *opened.warnings))
    _require_files(pairs, root)
    camera, camera_files, warnings = camera_of(root, pairs, options, LAYOUT)
    parts = Parts(
        root=root,
        importer="tum",
        pairs=pairs,
        stamps_ns=stamps,
        table=poses_of(root, options),
        intrinsics=camera,
        declared_scale=LAYOUT.scale,
        keys_are_stamps=True,
        documents=(*lists, *camera_files),
        skipped={"depth_without_image": lonely},
        warnings=warnings,
    )
    return assemble(parts, options)


def _root(source: Path) -> Path:
    require_folder(source)
    if _is_sequence(source):
        return source
    inner = [entry for entry in sorted(source.iterdir()) if _is_sequence(entry)]
    if len(inner) > 1:
        raise RecordingError(
            f"{len(inner)} sequences lie here: {', '.join(e.name for e in inner)}",
            where=source,
            fix=f"convert them one by one, for example {inner[0]}",
        )
    return inner[0] if inner else source


def _is_sequence(folder: Path) -> bool:
    """Whether the benchmark's lists lie there; X11 has an rgb.txt, too."""
    ways = (_LISTS, *((name,) for name in _ASSOCIATIONS))
    return any(all((folder / name).is_file() for name in names) for names in ways)


def associate(rgb_ns: Sequence[int], depth_ns: Sequence[int]) -> list[int | None]:
    """Give each image the nearest depth in time; the nearest pairs choose first.

    Args:
        rgb_ns: ascending stamps of the images.
        depth_ns: stamps of the depth images.

    Returns:
        the place of each image's depth; None where none is within :data:`MAX_DIFFERENCE_NS`.

    >>> associate([0, 33_000_000, 66_000_000], [1_000_000, 40_000_000])
    [0, 1, None]
    """
    order = sorted(range(len(depth_ns)), key=lambda place: depth_ns[place])
    near, first = [], 0
    for image, stamp in enumerate(rgb_ns):
        while first < len(order) and depth_ns[order[first]] <= stamp - MAX_DIFFERENCE_NS:
            first += 1
        for place in order[first:]:
            difference = abs(depth_ns[place] - stamp)
            if difference >= MAX_DIFFERENCE_NS:
                break
            near.append((difference, image, place))
    found: list[int | None] = [None] * len(rgb_ns)
    taken = set()
    for _, image, place in sorted(near):
        if found[image] is None and place not in taken:
            found[image] = place
            taken.add(place)
    return found


def _listed(path: Path) -> list[_Stamped]:
    """Rows ``stamp file``, by stamp."""
    found = []
    for row in read_table(path).rows:
        if len(row) < 2:
            raise RecordingError(
                f"a row is {' '.join(row)!r}", where=path, fix="write rows `stamp file`"
            )
        found.append(_Stamped(stamp_ns(row[0], where=path), path.parent / row[1]))
    return sorted(found, key=lambda image: image.stamp_ns)


def _joined(path: Path) -> tuple[list[Pair], list[int]]:
    """Rows ``stamp rgb stamp depth``, or depth first: told by the files' folders."""
    pairs, stamps = [], []
    for row in read_table(path).rows:
        if len(row) != 4 or not is_number(row[0]) or not is_number(row[2]):
            raise RecordingError(
                f"a row is {' '.join(row)!r}", where=path, fix="write rows `stamp rgb stamp depth`"
            )
        depth_first = row[1].startswith("depth")
        rgb, depth = (row[3], row[1]) if depth_first else (row[1], row[3])
        stamps.append(stamp_ns(row[2] if depth_first else row[0], where=path))
        pairs.append(Pair(key_of(Path(rgb)), path.parent / rgb, path.parent / depth))
    return pairs, stamps


def _require_files(pairs: Sequence[Pair], root: Path) -> None:
    missing = [
        path for pair in pairs for path in (pair.rgb, pair.depth) if path and not path.is_file()
    ]
    if missing or not pairs:
        raise RecordingError(
            f"{len(missing)} listed files are missing, the first is {missing[0].name}"
            if missing
            else "the lists name no image",
            where=missing[0] if missing else root,
            fix="fetch the sequence again, or take the missing files out of its lists",
        )
