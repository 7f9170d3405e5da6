"""Is every file of a bridge there, and nothing else?"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from civil_rgbd.domain.frame import FrameRow
from civil_rgbd.format.layout import DEFECTS, FRAMES, INTRINSICS, MANIFEST, POSES
from civil_rgbd.format.writer import row_paths
from civil_rgbd.storage.places import Place, files_below
from civil_rgbd.validation.report import Finding

_DOCUMENTS: Final = {MANIFEST, INTRINSICS, POSES, FRAMES, DEFECTS}
_LITTER: Final = {".DS_Store", "Thumbs.db", "desktop.ini"}


def check_files(folder: Place, rows: tuple[FrameRow, ...] | None, bridge: str) -> Iterator[Finding]:
    """Compare the files that are there with those that the index names.

    Args:
        folder: the bridge folder.
        rows: of the index; None when it cannot be read, and then only documents are known.
        bridge: its name in findings.
    """
    # A link to a folder is no folder of the bridge: it counts as a file that is unknown.
    there = set(files_below(folder))
    named = {path for row in rows or () for path in row_paths(row)}
    for path in sorted(named - there):
        yield Finding("file-missing", f"{FRAMES} names it", path, bridge)
    for path in sorted(there - named - _DOCUMENTS):
        name = path.rsplit("/", 1)[-1]
        if name in _LITTER or name.startswith("._"):
            yield Finding("file-litter", "a file manager's file", path, bridge)
        elif rows is not None:
            yield Finding("file-unknown", "no document names it", path, bridge)
