"""Take a rendered set over as a bridge folder: whole or absent, everything counted."""

from __future__ import annotations

import shutil
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from civil_rgbd.domain.bridge import BridgeInfo, Software
from civil_rgbd.domain.frame import FrameRow
from civil_rgbd.domain.recipe import ImageStage
from civil_rgbd.errors import BuildError, RecordingError
from civil_rgbd.format.atomic import folder_lock, recover_folder, writing
from civil_rgbd.format.datasets import refresh_dataset
from civil_rgbd.format.layout import BRIDGES, DEFECTS, PARTIAL
from civil_rgbd.format.writer import finish_bridge, write_frame
from civil_rgbd.importers.frame_reader import FrameReader, OtherSizeError
from civil_rgbd.importers.provenance import imported_manifest
from civil_rgbd.importers.rendered_set import ImportOptions, RenderedSet
from civil_rgbd.importers.report import ConvertReport
from civil_rgbd.importers.scale_check import SCALES, ScaleEvidence, weigh_scales

_BUILD_IDENTITY = "build.json"  # of an unfinished build, which is somebody's work


@dataclass(frozen=True, slots=True)
class ConvertOptions:
    """How to write.

    Attributes:
        software: what the manifest says made the frames.
        codec: ``png`` keeps the set's pixels; ``jpeg`` is smaller and changes them.
        overwrite: replace a bridge of the same id.
        on_progress: called with the frames just finished and the frames in all.
    """

    software: Software
    codec: str = "png"
    overwrite: bool = False
    on_progress: Callable[[int, int], object] = lambda _done, _total: None


def convert_set(
    opened: RenderedSet,
    dataset: Path,
    info: BridgeInfo,
    importing: ImportOptions,
    options: ConvertOptions,
) -> ConvertReport:
    """Write one rendered set as a bridge of a dataset.

    Args:
        opened: the set.
        dataset: the dataset folder; it is made if need be.
        info: identity and what people say about the bridge.
        importing: how the set was opened, and how its images are read.
        options: how to write.

    Returns:
        what was done; the bridge folder is whole.

    Raises:
        RecordingError: the images, poses and camera contradict each other.
        BuildError: a bridge lies there already, or no frame came out.
        OutputError: the folder cannot be written.
    """
    started = time.monotonic()
    folder, partial = dataset / BRIDGES / info.bridge_id, dataset / PARTIAL / info.bridge_id
    reader = FrameReader(opened, importing)
    evidence = weigh_scales(opened, reader, (opened.declared_scale, *SCALES, *_given(importing)))
    scale, scale_warnings = choose_scale(opened, importing, evidence)
    with writing(dataset):
        partial.parent.mkdir(parents=True, exist_ok=True)
    with folder_lock(partial):
        recover_folder(folder)
        _refuse_what_is_there(folder, partial, overwrite=options.overwrite)
        try:
            rows, dropped = _write_frames(opened, reader, partial, scale, options)
            manifest = imported_manifest(
                opened,
                info,
                options.software,
                rows=rows,
                dropped=dropped,
                reader=reader,
                importing=importing,
                scale=scale,
                warnings=scale_warnings,
            )
            finish_bridge(
                partial,
                folder,
                manifest=manifest,
                camera=reader.camera,
                rows=rows,
                replace=options.overwrite,
            )
        finally:
            shutil.rmtree(partial, ignore_errors=True)
        refresh_dataset(dataset)
    if not any(partial.parent.iterdir()):
        partial.parent.rmdir()
    return ConvertReport(
        bridge_id=info.bridge_id,
        folder=folder,
        importer=opened.importer,
        counts=manifest.counts,
        depth_scale=scale,
        evidence=evidence.words(),
        warnings=manifest.warnings,
        licence=info.licence,
        seconds=time.monotonic() - started,
    )


def _given(importing: ImportOptions) -> tuple[float, ...]:
    return () if importing.depth_scale is None else (importing.depth_scale,)


def choose_scale(
    opened: RenderedSet, importing: ImportOptions, evidence: ScaleEvidence
) -> tuple[float, tuple[str, ...]]:
    """Decide how many stored units make a metre.

    What the user says counts; else what the poses prove; else what the layout says. Where these
    differ, or nothing is proven, a warning says so.

    Returns:
        units a metre; warnings.

    Raises:
        RecordingError: the poses explain the depth only when they are turned round, or contradict
            the layout's scale without proving another.
    """
    if evidence.poses_are_inverted:
        other = {"camera-to-map": "map-to-camera"}.get(importing.direction, "camera-to-map")
        best = evidence.differences[evidence.best or 0.0]
        raise RecordingError(
            f"read as {importing.direction}, the poses carry one frame's depth {best:.1%} off "
            f"another's; the other way round {evidence.inverse_difference:.1%}",
            where=opened.root,
            fix=f"give --direction {other}",
        )
    declared = importing.depth_scale or opened.declared_scale
    who = "--depth-scale" if importing.depth_scale else f"the layout {opened.importer}"
    if evidence.proven is None:
        best = evidence.best or 0.0
        if not importing.depth_scale and evidence.contradicts(declared):
            raise RecordingError(
                f"the poses contradict the depth scale {declared:g}, which {who} says, and prove "
                f"no other: {evidence.words()}",
                where=opened.root,
                fix="give the set's own camera with --intrinsics, for under a wrong one no scale "
                f"fits; or the scale: --depth-scale {best:g} fits best",
            )
        said = f"depth scale {declared:g} is what {who} says; the poses do not prove it"
        return declared, (f"{said}: {evidence.words()}",)
    if evidence.proven == declared:
        return declared, ()
    if importing.depth_scale:
        return declared, (f"depth scale {declared:g} was given, but {evidence.words()}",)
    said = f"depth scale {evidence.proven:g} instead of {declared:g}, which {who} says"
    return evidence.proven, (f"{said}: {evidence.words()}",)


def _refuse_what_is_there(folder: Path, partial: Path, *, overwrite: bool) -> None:
    if folder.exists() and not overwrite:
        raise BuildError(
            "a bridge of this id lies here already",
            where=folder,
            fix="give --overwrite to replace it, or another --bridge or --out",
        )
    if (folder / DEFECTS).exists():
        raise BuildError(
            "the bridge to be replaced holds measured defects, which cannot be made again",
            where=folder / DEFECTS,
            fix="move the file away, and look afterwards whether its pixels still fit",
        )
    if (partial / _BUILD_IDENTITY).exists() and not overwrite:
        raise BuildError(
            "an unfinished build of this id lies here",
            where=partial,
            fix="finish it with its own command, or give --overwrite to throw it away",
        )
    with writing(partial):
        shutil.rmtree(partial, ignore_errors=True)
        partial.mkdir(parents=True)


def _write_frames(
    opened: RenderedSet, reader: FrameReader, partial: Path, scale: float, options: ConvertOptions
) -> tuple[list[FrameRow], Counter[str]]:
    rows: list[FrameRow] = []
    dropped: Counter[str] = Counter(opened.dropped)
    stage = ImageStage(codec=options.codec)
    options.on_progress(0, len(opened.frames))
    last: RecordingError | None = None
    for frame in opened.frames:
        try:
            rows.append(write_frame(partial, reader.read(frame, scale=scale), stage=stage))
        except OtherSizeError as error:
            dropped["other_size"] += 1
            last = error
        except RecordingError as error:
            dropped["unreadable_image"] += 1
            last = error
        options.on_progress(1, len(opened.frames))
    if not rows:
        raise BuildError(
            f"no frame came out of {opened.images_seen} images: {dict(dropped)}",
            where=opened.root,
            fix=last.fix if last else "compare the names of images, depth and poses",
        )
    return rows, dropped
