"""Build a bridge: plan, check, make what is missing, publish."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from civil_rgbd.builder.bridge import (
    find_whole,
    manifest_before,
    prepare_partial,
    remove_if_empty,
    remove_partial,
    require_free_id,
    with_counts,
)
from civil_rgbd.builder.checks import check_before_start, require_images_fit
from civil_rgbd.builder.chunks import BRIDGE, ChunkRecord, Job, finished_chunks
from civil_rgbd.builder.executors import EXECUTORS, use_one_thread
from civil_rgbd.builder.plan import Plan, chunks_of, in_words, plan_frames
from civil_rgbd.builder.provenance import build_identity
from civil_rgbd.builder.report import BuildReport
from civil_rgbd.domain.bridge import BridgeInfo, Manifest
from civil_rgbd.domain.recipe import Recipe
from civil_rgbd.domain.recording import Recording
from civil_rgbd.errors import BridgeFailedError
from civil_rgbd.format.atomic import folder_lock, recover_folder, writing
from civil_rgbd.format.datasets import refresh_dataset
from civil_rgbd.format.layout import BRIDGES, PARTIAL
from civil_rgbd.format.writer import finish_bridge
from civil_rgbd.pipeline.frames import FrameMaker

Progress = Callable[[int, int], object]
"""Called with the frames just finished and the frames in all."""


@dataclass(frozen=True, slots=True)
class BuildOptions:
    """How to build, beside the recipe; nothing here changes a pixel.

    Attributes:
        workers: processes; 1 runs in this one.
        overwrite: replace a bridge or an unfinished build that was made otherwise.
        overrides: recipe keys that were set by hand, for the manifest.
        on_progress: called as frames are finished.
    """

    workers: int = 1
    overwrite: bool = False
    overrides: Mapping[str, object] = field(default_factory=dict)
    on_progress: Progress = lambda _done, _total: None


def build_bridge(
    recording: Recording, recipe: Recipe, dataset: Path, info: BridgeInfo, options: BuildOptions
) -> BuildReport:
    """Build one bridge into a dataset folder; a build that was stopped is gone on with.

    Args:
        recording: an opened recording.
        recipe: how frames are made.
        dataset: the dataset folder; it is made if need be.
        info: identity and what people say about the bridge.
        options: how to run.

    Returns:
        what was done; the bridge folder is whole.

    Raises:
        UsageError: the bridge's id does not fit.
        RecordingError: the recording lacks something.
        BuildError: nothing came out, or something else lies where the bridge should.
        OutputError: the folder cannot be written.
    """
    started = time.monotonic()
    require_free_id(dataset, info.bridge_id)
    require_images_fit(recording, undistort=recipe.image.undistort)
    plan = plan_frames(recording, recipe)
    wanted = manifest_before(recording, recipe, info, options.overrides)
    folder, partial = dataset / BRIDGES / info.bridge_id, dataset / PARTIAL / info.bridge_id
    job = Job(recording=recording, recipe=recipe, frames=plan.frames, partial=partial)
    with writing(dataset):
        partial.parent.mkdir(parents=True, exist_ok=True)
    try:
        with folder_lock(partial):
            recover_folder(folder)
            whole = find_whole(folder, wanted, overwrite=options.overwrite)
            made = _Made(whole, 0) if whole else _make(job, plan, wanted, folder, options)
            refresh_dataset(dataset)
    finally:
        remove_if_empty(partial.parent)
    return BuildReport(
        bridge_id=info.bridge_id,
        folder=folder,
        recipe=recipe.name,
        counts=made.manifest.counts,
        notes=recording.notes,
        licence=info.licence,
        seconds=time.monotonic() - started,
        frames_found=made.frames_found,
        already_whole=whole is not None,
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Made:
    """The manifest of a bridge that is whole, and how much of it was found half-made."""

    manifest: Manifest
    frames_found: int


def _make(job: Job, plan: Plan, wanted: Manifest, folder: Path, options: BuildOptions) -> _Made:
    """Check, go on where an earlier build was stopped, publish."""
    use_one_thread()
    maker = FrameMaker(job.recording, job.recipe)
    check_before_start(maker, plan)
    identity = build_identity(wanted, job.recording)
    prepare_partial(job.partial, identity, overwrite=options.overwrite)
    found = finished_chunks(job.partial)
    records = found + _make_missing(job, found, options)
    manifest = with_counts(
        wanted, plan, records, job.recording, pixels_without_source=maker.images.missing_pixels
    )
    _publish(job, folder, manifest, maker, records)
    return _Made(manifest, sum(len(record.frames) for record in found))


def _make_missing(job: Job, found: list[ChunkRecord], options: BuildOptions) -> list[ChunkRecord]:
    done = {frame.source_index for record in found for frame in record.frames}
    todo = [i for i, frame in enumerate(job.frames) if frame.source_index not in done]
    chunks = chunks_of(todo, workers=options.workers)
    options.on_progress(len(job.frames) - len(todo), len(job.frames))
    run = EXECUTORS["serial" if options.workers == 1 or len(chunks) < 2 else "processes"]
    return list(
        run(
            job,
            chunks,
            workers=options.workers,
            on_frames=lambda count: options.on_progress(count, len(job.frames)),
        )
    )


def _publish(
    job: Job, folder: Path, manifest: Manifest, maker: FrameMaker, records: list[ChunkRecord]
) -> None:
    frames = sorted(
        (frame for record in records for frame in record.frames),
        key=lambda frame: frame.source_index,
    )
    if [frame.source_index for frame in frames] != [frame.source_index for frame in job.frames]:
        raise RuntimeError(
            f"{len(job.frames)} frames were planned, {len(frames)} came back: an executor lost some"
        )
    rows = [frame.row for frame in frames if frame.row is not None]
    if not rows:
        remove_partial(job.partial)
        raise BridgeFailedError(
            f"no frame came out of {manifest.counts.images_seen} images: "
            f"{in_words(manifest.counts.dropped)}",
            where=job.recording.name,
            fix="look at the images of the recording: none that was chosen could be decoded",
        )
    finish_bridge(
        job.partial / BRIDGE,
        folder,
        manifest=manifest,
        camera=maker.images.camera,
        rows=rows,
        replace=folder.exists(),
    )
    remove_partial(job.partial)
