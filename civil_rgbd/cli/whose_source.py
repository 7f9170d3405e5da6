"""Whose recording a source is: found by what the manifests of the bridges keep of their sources."""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from civil_rgbd.errors import UsageError

if TYPE_CHECKING:
    from civil_rgbd.domain.bridge import Manifest
    from civil_rgbd.domain.recording import SourceFile


@dataclass(frozen=True, slots=True)
class _Given:
    """What is known of a source without opening it; None is not known."""

    name: str
    size_bytes: int | None = None
    sha256: str | None = None
    etag: str | None = None

    def is_that(self, known: SourceFile) -> bool:
        """Tell whether a manifest speaks of it, by the surest thing that both know."""
        if self.sha256 and known.sha256:
            return self.sha256 == known.sha256
        same_size = self.size_bytes in {None, known.size_bytes}
        same_etag = None in {self.etag, known.etag} or self.etag == known.etag
        return self.name == known.name and same_size and same_etag


def sources_of(manifests: Mapping[str, Manifest], sources: Sequence[str]) -> dict[str, list[str]]:
    """Tell whose recordings some sources are, where there are several bridges.

    Args:
        manifests: of the bridges, by id.
        sources: paths or addresses; of a folder what lies in it counts.

    Returns:
        the sources of each bridge that has some, in the manifest's order.

    Raises:
        UsageError: a source is not there, or is no bridge's.
        StorageError: the object storage cannot be reached, or refuses.
    """
    if not sources:
        return {}
    if len(manifests) == 1:
        return {name: list(sources) for name in manifests}
    sizes = {known.size_bytes for manifest in manifests.values() for known in manifest.sources}
    found: dict[str, dict[str, int]] = {}  # by bridge and source: the place of its first file
    for source in sources:
        given = _look_at(source, sizes)
        places = [
            (name, place)
            for name, manifest in manifests.items()
            for place, known in enumerate(manifest.sources)
            if any(one.is_that(known) for one in given)
        ]
        if not places:
            hashes = [one.sha256 for one in given if one.sha256]
            raise UsageError(
                "no bridge was built from this source"
                + (f", sha256 {', '.join(hashes)}" if hashes else ""),
                where=source,
                fix="compare with `sources` in the manifests: was the file changed or replaced?",
            )
        for name, place in places:
            found.setdefault(name, {}).setdefault(source, place)
    return {name: sorted(some, key=some.__getitem__) for name, some in found.items()}


def _look_at(source: str, sizes: Container[int]) -> list[_Given]:
    """Look at a source, or at what lies in it as far as it has one of some sizes."""
    from civil_rgbd.builder.survey import is_address
    from civil_rgbd.format.hashes import file_sha256
    from civil_rgbd.storage.places import place_of
    from civil_rgbd.storage.remote_path import RemotePath

    place = place_of(source)
    if isinstance(place, RemotePath):
        try:
            stat = place.stat()
        except FileNotFoundError:  # perhaps a folder; what opens it says more
            return [_Given(place.name)]
        etag = stat.etag.strip('"') if stat.etag else None
        return [_Given(place.name, stat.st_size, etag=etag)]
    path = Path(source)
    if not path.exists() and not is_address(source):
        raise UsageError("there is no such file or folder", where=source, fix="check the path")
    # The file of a ROS 2 folder that stands for all of it is the source of nothing.
    within = path.parent if path.name == "metadata.yaml" else path
    files = [path] if within.is_file() else sorted(within.rglob("*"))
    given = [
        _Given(file.name, file.stat().st_size, file_sha256(file))
        for file in files
        if file.is_file() and (file == path or file.stat().st_size in sizes)
    ]
    return given or [_Given(path.name)]
