"""Are the files of finished frames still what was written? On a disk they are read and hashed.

On object storage one listing tells size and ETag of every object. Where both are what the upload
was answered with, the object is that upload. Only the others travel, to be hashed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

from civil_rgbd.domain.frame import FrameRow
from civil_rgbd.format.hashes import bytes_sha256, file_sha256
from civil_rgbd.storage.client import Version
from civil_rgbd.storage.places import Place
from civil_rgbd.storage.remote_path import RemotePath, each_at_once


def files_unlike(
    folder: Place, rows: Iterable[FrameRow], versions: Mapping[str, Version]
) -> set[str]:
    """Return which files of some frames are missing, or have other bytes than were written.

    Args:
        folder: the unfinished bridge.
        rows: of the frames; they have the hashes.
        versions: receipts of uploads, by path; what has none is read.

    Returns:
        paths relative to the folder.

    Raises:
        StorageError: the storage cannot be reached, or refuses.
    """
    hashes = _hashes(rows)
    if isinstance(folder, Path):
        return {path for path, sha256 in hashes.items() if not _is(folder / path, sha256)}
    there = folder.versions_below() if hashes else {}
    unlike = {path for path in hashes if path not in there}
    unsure = [
        path for path in hashes.keys() - unlike if not _proves(versions.get(path), there[path])
    ]
    each_at_once(_look(folder / path, hashes[path], path, unlike) for path in sorted(unsure))
    return unlike


def _hashes(rows: Iterable[FrameRow]) -> dict[str, str]:
    hashes = {}
    for row in rows:
        hashes[row.rgb_path] = row.rgb_file_sha256
        hashes[row.depth_path] = row.depth_file_sha256
        if row.quality_path is not None:
            hashes[row.quality_path] = row.quality_file_sha256 or ""
    return hashes


def _is(path: Path, sha256: str) -> bool:
    try:
        return file_sha256(path) == sha256
    except OSError:
        return False


def _proves(receipt: Version | None, there: Version) -> bool:
    """Tell whether an object is the upload that its receipt speaks of; without ETag none is.

    >>> _proves((3, '"ab"'), (3, "ab")), _proves((3, "ab"), (4, "ab")), _proves((3, "b"), (3, "ab"))
    (True, False, False)
    >>> _proves((3, None), (3, None)), _proves(None, (3, "ab"))
    (False, False)
    """
    if receipt is None or not (receipt[1] and there[1]):
        return False
    # Some services quote ETags in one answer and not in another.
    return receipt[0] == there[0] and receipt[1].strip('"') == there[1].strip('"')


def _look(path: RemotePath, sha256: str, name: str, unlike: set[str]) -> Callable[[], None]:
    def look() -> None:
        try:
            same = bytes_sha256(path.read_bytes()) == sha256
        except FileNotFoundError:
            same = False
        if not same:
            unlike.add(name)

    return look
