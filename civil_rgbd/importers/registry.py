"""Every layout that can be taken over."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Final

from civil_rgbd.errors import UsageError
from civil_rgbd.importers import bridge_rgbd, icl, kitti_depth, lab, redwood, scannet, tum
from civil_rgbd.importers.rendered_set import ImportOptions, RenderedSet
from civil_rgbd.resources import nearest

IMPORTERS: Final[dict[str, Callable[[Path, ImportOptions], RenderedSet]]] = {
    "bridge-rgbd": bridge_rgbd.open_set,
    "icl": icl.open_set,
    "kitti-depth": kitti_depth.open_set,
    "lab": lab.open_set,
    "redwood": redwood.open_set,
    "scannet": scannet.open_set,
    "tum": tum.open_set,
}
"""Importers by the name that `civil-rgbd convert --from` takes."""


def open_rendered_set(source: Path, name: str, options: ImportOptions) -> RenderedSet:
    """Open a set that others rendered; its images are not read yet.

    Args:
        source: its folder.
        name: a key of :data:`IMPORTERS`.
        options: what the set does not say itself.

    Raises:
        UsageError: there is no such importer.
        RecordingError: the set lacks something, or its parts do not fit each other.
    """
    if name not in IMPORTERS:
        raise UsageError(
            f"there is no importer {name!r}", where="--from", fix=nearest(name, IMPORTERS)
        )
    return IMPORTERS[name](source, options)
