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
from civil_rgbd.builder.plan import chunks_of, plan_frames
from civil_rgbd.builder.provenance import build_identity
from civil_rgbd.builder.report import BuildReport
from civil_rgbd.domain.bridge import BridgeInfo, Manifest
from civil_rgbd.domain.recipe import Recipe
from civil_rgbd.domain.recording import Recording
from civil_rgbd.errors import BuildError
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
    use_one_thread()
    maker = FrameMaker(recording, recipe)
    folder, partial = dataset / BRIDGES / info.bridge_id, dataset / PARTIAL / info.bridge_id
    manifest = manifest_before(recording, recipe, info, options.overrides)
    found: list[ChunkRecord] = []
    with writing(dataset):
        partial.parent.mkdir(parents=True, exist_ok=True)
    with folder_lock(partial):
        recover_folder(folder)
        whole = find_whole(folder, manifest, overwrite=options.overwrite)
        if whole is None:
            check_before_start(maker, plan)
            identity = build_identity(recording, recipe)
            prepare_partial(partial, identity, overwrite=options.overwrite)
            found = finished_chunks(partial)
            job = Job(recording=recording, recipe=recipe, frames=plan.frames, partial=partial)
            records = found + _make_missing(job, found, options)
            manifest = with_counts(manifest, plan, records, recording)
            _publish(job, folder, manifest, maker, records)
        refresh_dataset(dataset)
    remove_if_empty(partial.parent)
    return BuildReport(
        bridge_id=info.bridge_id,
        folder=folder,
        recipe=recipe.name,
        counts=(whole or manifest).counts,
        missing_pixels=maker.images.missing_pixels,
        notes=recording.notes,
        licence=info.licence,
        seconds=time.monotonic() - started,
        frames_found=sum(len(record.frames) for record in found),
        already_whole=whole is not None,
    )


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
        raise BuildError(
            f"no frame came out of {manifest.counts.images_seen} images: "
            f"{dict(manifest.counts.dropped)}",
            where=job.recording.name,
            fix="civil-rgbd info names the recipe's keys; look at the images of the recording",
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
