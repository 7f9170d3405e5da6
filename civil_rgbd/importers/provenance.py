"""What a taken-over bridge was made from, and what its manifest says."""

from __future__ import annotations

import hashlib
import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path

from civil_rgbd.domain.bridge import BridgeInfo, Counts, Manifest, Software
from civil_rgbd.domain.frame import FrameRow
from civil_rgbd.domain.recording import SourceFile
from civil_rgbd.format.hashes import file_sha256
from civil_rgbd.importers.frame_reader import FrameReader
from civil_rgbd.importers.rendered_set import ImportOptions, RenderedSet


def set_source(opened: RenderedSet) -> SourceFile:
    """Return the one entry that stands for all files of a set.

    Its hash is that of a list, one line a file, sorted by name: ``<sha256>  <name>``, as
    ``sha256sum`` prints it. So `sha256sum FILES | LC_ALL=C sort -k 2 | sha256sum` gives it again. A
    line an image would make a manifest of thousands.

    Args:
        opened: the set; the files are those it was read from, named from its root with forward
            slashes; files from elsewhere by their bare name.
    """
    files = {_name(path, opened.root): path for path in opened.files}
    lines = [f"{file_sha256(path)}  {name}\n" for name, path in sorted(files.items())]
    return SourceFile(
        name=opened.root.resolve().name or "set",
        size_bytes=sum(path.stat().st_size for path in files.values()),
        sha256=hashlib.sha256("".join(lines).encode("utf-8")).hexdigest(),
        converter=opened.importer,
    )


def _name(path: Path, root: Path) -> str:
    relative = os.path.relpath(path.resolve(), root.resolve()) if path.is_relative_to(root) else ""
    return relative.replace(os.sep, "/") if relative and ".." not in relative else path.name


def imported_manifest(
    opened: RenderedSet,
    info: BridgeInfo,
    software: Software,
    *,
    rows: Sequence[FrameRow],
    dropped: Mapping[str, int],
    reader: FrameReader,
    importing: ImportOptions,
    scale: float,
    warnings: tuple[str, ...],
) -> Manifest:
    """Return the manifest of a bridge whose frames are written.

    Args:
        opened: the set.
        info: identity and what people say about the bridge.
        software: what made the frames.
        rows: the frames; at least one.
        dropped: images that became no frame, by reason.
        reader: has read them all.
        importing: how the set was opened, and how its images were read.
        scale: stored depth units a metre.
        warnings: what is known already, in words; what the set and the reader say is added.
    """
    return Manifest(
        info=info,
        origin="imported",
        sources=(set_source(opened),),
        reading=_reading(importing, scale),
        software=software,
        counts=Counts(
            images_seen=opened.images_seen,
            frames_kept=len(rows),
            dropped=dict(dropped),
            skipped=dict(opened.skipped),
            mean_valid_share=math.fsum(row.valid_share for row in rows) / len(rows),
            pixels_without_source=reader.missing_pixels,
        ),
        warnings=(*warnings, *_warnings(opened, reader, dropped)),
    )


def _reading(importing: ImportOptions, scale: float) -> dict[str, str]:
    """What could have been read otherwise: what the same import again would have to be told."""
    said = {
        "depth_scale": f"{scale:g}",
        "depth_along": importing.depth_along,
        "direction": importing.direction,
    }
    return said if importing.lens is None else said | {"lens": importing.lens}


def _warnings(
    opened: RenderedSet, reader: FrameReader, dropped: Mapping[str, int]
) -> tuple[str, ...]:
    said = [*opened.warnings, *reader.warnings]
    if reader.missing_pixels:
        said.append(f"{reader.missing_pixels} pixels of every frame have no source: 0 there")
    if dropped.get("unreadable_image"):
        said.append(f"{dropped['unreadable_image']} images or depths were damaged and left out")
    if reader.saturated_pixels:
        said.append(
            f"{reader.saturated_pixels} depths were at the 16-bit limit, no measurement: 0 there"
        )
    return tuple(said)
