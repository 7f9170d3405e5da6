"""Every layout that a bridge can be written in, and the one way to write it."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

from civil_rgbd.errors import OutputError, UsageError
from civil_rgbd.exporters import colmap, kitti, las, nerfstudio, ply, tum
from civil_rgbd.exporters.files import write_lines
from civil_rgbd.exporters.report import ExportOptions, ExportReport, Losses
from civil_rgbd.exporters.selection import Chosen
from civil_rgbd.format.atomic import folder_lock, publish_folder, recover_folder, sync_tree, writing
from civil_rgbd.format.bridge_info import info_to_document
from civil_rgbd.resources import nearest

MARKER: Final = "export.json"
"""Says that a folder is an export, what of, under which licence, and what was lost."""

OneByOne = Callable[[Path, Chosen, ExportOptions], Losses]
AllAtOnce = Callable[[Path, Sequence[Chosen], ExportOptions], Losses]

ONE_BY_ONE: Final[dict[str, OneByOne]] = {
    "colmap": colmap.write,
    "las": las.write,
    "nerfstudio": nerfstudio.write,
    "ply": ply.write,
    "tum": tum.write,
}
"""Layouts of one map: a bridge goes to the folder itself, several to one folder each."""

ALL_AT_ONCE: Final[dict[str, AllAtOnce]] = {"kitti": kitti.write}
"""Layouts that hold many bridges."""

EXPORTERS: Final = tuple(sorted([*ONE_BY_ONE, *ALL_AT_ONCE]))
"""What `civil-rgbd export --to` takes."""


def require_exporter(name: str) -> None:
    """Refuse a name that is no exporter's.

    Raises:
        UsageError: it is none.
    """
    if name not in EXPORTERS:
        raise UsageError(
            f"there is no exporter {name!r}", where="--to", fix=nearest(name, EXPORTERS)
        )


def export(
    chosen: Sequence[Chosen],
    name: str,
    folder: Path,
    options: ExportOptions,
    *,
    overwrite: bool = False,
) -> ExportReport:
    """Write bridges in another layout: the folder is whole, or it is not there.

    Args:
        chosen: bridges and frames.
        name: one of :data:`EXPORTERS`.
        folder: what to make.
        options: how.
        overwrite: replace an older export; never any other folder.

    Raises:
        UsageError: there is no such exporter, or its depth would mostly be lost.
        OutputError: the folder exists, or cannot be written.
        FormatError: a frame is damaged.
        MissingExtraError: the layout needs a package that is not installed.
    """
    require_exporter(name)
    folder = folder.absolute() if folder.name else folder.resolve()
    _refuse_what_is_there(folder, overwrite=overwrite)
    partial = folder.with_name(f".{folder.name}.partial")
    with folder_lock(folder):
        recover_folder(folder)
        try:
            with writing(folder):
                shutil.rmtree(partial, ignore_errors=True)
                partial.mkdir(parents=True)
                losses = _write(chosen, name, partial, options)
                report = ExportReport(
                    exporter=name,
                    folder=folder,
                    frames={one.bridge_id: len(one.rows) for one in chosen},
                    losses=losses,
                )
                _write_marker(partial / MARKER, chosen, report)
            sync_tree(partial)
            publish_folder(partial, folder, replace=True)
        finally:
            shutil.rmtree(partial, ignore_errors=True)
    return report


def _refuse_what_is_there(folder: Path, *, overwrite: bool) -> None:
    if not folder.exists() or (folder.is_dir() and not any(folder.iterdir())):
        return
    if not overwrite:
        raise OutputError(
            "something lies here already", where=folder, fix="give --overwrite, or another --out"
        )
    if not (folder / MARKER).is_file():
        raise OutputError(
            f"this is no export (it has no {MARKER}), so it is not replaced",
            where=folder,
            fix="give another --out, or take it away yourself",
        )


def _write(chosen: Sequence[Chosen], name: str, folder: Path, options: ExportOptions) -> list[str]:
    if name in ALL_AT_ONCE:
        losses = ALL_AT_ONCE[name](folder, chosen, options)
        _refuse_lost_depth([losses], options)
        return losses.to_lines()
    write = ONE_BY_ONE[name]
    if len(chosen) == 1:
        losses = write(folder, chosen[0], options)
        _refuse_lost_depth([losses], options)
        return losses.to_lines()
    every = [write(folder / one.bridge_id, one, options) for one in chosen]
    _refuse_lost_depth(every, options)
    pairs = zip(chosen, every, strict=True)
    return [f"{one.bridge_id}: {line}" for one, losses in pairs for line in losses.to_lines()]


def _refuse_lost_depth(every: Sequence[Losses], options: ExportOptions) -> None:
    """Refuse an export without depth, and one that loses most of it by what the user asked for."""
    kept = sum(losses.kept_pixels for losses in every)
    lost = sum(losses.beyond_pixels + losses.below_pixels for losses in every)
    if lost and (not kept or (options.depth_scale and lost > kept)):
        raise UsageError(
            f"{lost:,} of {kept + lost:,} depths do not fit into 16 bits and would be lost",
            where=f"--depth-scale {options.depth_scale:g}" if options.depth_scale else "--to",
            fix="give another --depth-scale: 65534 divided by the furthest depth in metres, or "
            "less; it is for tum alone",
        )


def _write_marker(path: Path, chosen: Sequence[Chosen], report: ExportReport) -> None:
    document = {
        "exporter": report.exporter,
        "losses": report.losses,
        "bridges": [
            {
                **info_to_document(one.bridge.manifest.info),
                "origin": one.bridge.manifest.origin,
                "frames": len(one.rows),
            }
            for one in chosen
        ],
    }
    write_lines(path, [json.dumps(document, indent=2)])
