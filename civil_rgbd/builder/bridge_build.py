"""One bridge under way: opened, planned, locked; then made chunk by chunk, and published."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path

from civil_rgbd.builder.bridge import (
    find_whole,
    manifest_before,
    prepare_partial,
    remove_left_over,
    remove_partial,
    require_fit_for_schema,
    require_free_id,
)
from civil_rgbd.builder.checks import check_before_start, require_images_fit
from civil_rgbd.builder.chunks import ChunkRecord, Job, finished_chunks
from civil_rgbd.builder.facts import Facts, facts_of, write_facts
from civil_rgbd.builder.originals import (
    fingerprints,
    refuse_changed,
    refuse_other_hashes,
)
from civil_rgbd.builder.plan import Chunk, chunks_of, plan_frames
from civil_rgbd.builder.provenance import build_identity
from civil_rgbd.builder.publish import publish
from civil_rgbd.builder.report import BuildReport, ShareReport
from civil_rgbd.builder.shares import BEGIN_WAIT_S, Division, Share, gate_of, write_division
from civil_rgbd.domain.bridge import BridgeInfo, Manifest
from civil_rgbd.domain.recipe import Recipe
from civil_rgbd.domain.recording import Recording
from civil_rgbd.errors import BridgeFailedError, OutputError
from civil_rgbd.format.atomic import folder_lock, recover_folder, writing
from civil_rgbd.format.datasets import refresh_dataset
from civil_rgbd.format.layout import BRIDGES, PARTIAL
from civil_rgbd.pipeline.frames import FrameMaker
from civil_rgbd.storage.places import Place


@dataclass(frozen=True, slots=True, eq=False)
class Order:
    """A bridge that is asked for.

    Attributes:
        info: identity and what people say about it.
        open: opens its recording.
        files: what the recording is read from, as far as it lies in files of this machine.
        sha256: of the recording's files, where somebody wrote them down.
        said_in: the file that says all this, if any.
    """

    info: BridgeInfo
    open: Callable[[], Recording]
    files: tuple[Path, ...] = ()
    sha256: tuple[str, ...] = ()
    said_in: Path | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Manner:
    """What all bridges of a build have in common.

    Attributes:
        recipe: how frames are made.
        dataset: the dataset folder.
        overrides: recipe keys that were set by hand, for the manifest.
        overwrite: replace a bridge or an unfinished build that was made otherwise.
        share: make this part only, and publish nothing; None makes all.
        remote: workers on other machines write into the dataset folder.
    """

    recipe: Recipe
    dataset: Place
    overrides: Mapping[str, object] = field(default_factory=dict)
    overwrite: bool = False
    share: Share | None = None
    remote: bool = False


@dataclass(slots=True, eq=False)
class BridgeBuild:
    """A bridge between its order and its folder. Made by :func:`begin`; `close` lets go of it.

    Attributes:
        job: what its chunks have in common.
        facts: what publishing needs.
        folder: where the bridge will be.
        whole: the manifest of a bridge that was there already, as wanted.
        place: the bridge's place among all, from 0, and how many there are.
        part: which frames are to be made here, as indices of the plan: first, and after the last.
        records: chunks that are made.
        frames_found: frames that an earlier build had made.
    """

    job: Job
    facts: Facts
    folder: Place
    manner: Manner
    recording: Recording
    whole: Manifest | None
    place: tuple[int, int]
    part: tuple[int, int]
    records: list[ChunkRecord]
    frames_found: int
    started: float
    locks: ExitStack

    @property
    def frames(self) -> int:
        """How many frames are to be made here, found ones included."""
        return 0 if self.whole else self.part[1] - self.part[0]

    @property
    def frames_made(self) -> int:
        """How many of them are made."""
        wanted = self.job.frames.source_indices[slice(*self.part)].tolist()
        if not wanted:
            return 0
        first, last = wanted[0], wanted[-1]  # records hold frames of the plan only, as this does
        return sum(first <= frame.source_index <= last for r in self.records for frame in r.frames)

    def chunks(self, *, workers: int) -> list[Chunk]:
        """Cut what is still to be made."""
        if self.whole:
            return []
        done = {frame.source_index for record in self.records for frame in record.frames}
        planned = self.job.frames.source_indices.tolist()
        todo = [i for i in range(*self.part) if planned[i] not in done]
        return chunks_of(todo, workers=workers)

    def finish(self) -> BuildReport | ShareReport:
        """Publish what is made; of a share nothing.

        Raises:
            BridgeFailedError: no frame came out, or the source changed meanwhile.
            OutputError: something cannot be written.
        """
        if self.whole is None:
            try:
                refuse_changed(self.job.files, self.recording.sources)
            except BridgeFailedError:
                if self.manner.share is None:
                    remove_partial(self.job.partial)  # nobody knows which frames are good
                raise
        if self.manner.share and self.whole is None:
            return ShareReport(
                bridge_id=self.folder.name,
                share=str(self.manner.share),
                frames=self.frames,
                frames_found=self.frames_found,
                frames_planned=len(self.job.frames),
                seconds=time.monotonic() - self.started,
            )
        manifest = self.whole
        if manifest is None:
            if self.manner.remote:
                # What another machine wrote is read back: its word is not enough.
                self.records = finished_chunks(self.job.partial)
            manifest = publish(self.job.partial, self.folder, self.facts, self.records)
        refresh_dataset(self.manner.dataset)
        return BuildReport(
            bridge_id=self.folder.name,
            folder=self.folder,
            recipe=self.manner.recipe.name,
            counts=manifest.counts,
            notes=replace(self.recording.notes, salvage=manifest.salvage),
            licence=manifest.info.licence,
            seconds=time.monotonic() - self.started,
            frames_found=self.frames_found,
            already_whole=self.whole is not None,
        )

    def close(self) -> None:
        """Let others at the folder."""
        self.locks.close()


def begin(order: Order, manner: Manner, *, place: tuple[int, int]) -> BridgeBuild:
    """Open a recording, plan its bridge, check it, and hold its folder.

    Args:
        order: the bridge.
        manner: how.
        place: the bridge's place among all, from 0, and how many there are.

    Raises:
        UsageError: the bridge's id does not fit.
        RecordingError: the recording lacks something.
        BuildError: nothing would come out, its manifest would break the schema, or something else
            lies where the bridge should.
        OutputError: the folder cannot be written, or somebody else writes there.
    """
    started = time.monotonic()
    dataset, bridge_id = manner.dataset, order.info.bridge_id
    require_free_id(dataset, bridge_id)
    files = fingerprints(order.files)
    recording = order.open()
    said_in = f"{order.said_in}, " if order.said_in else ""
    refuse_other_hashes(order.sha256, recording.sources, where=f"{said_in}bridge {bridge_id!r}")
    require_images_fit(recording, undistort=manner.recipe.image.undistort)
    plan = plan_frames(recording, manner.recipe)
    wanted = manifest_before(recording, manner.recipe, order.info, manner.overrides)
    require_fit_for_schema(wanted)
    maker = FrameMaker(recording, manner.recipe)
    partial = dataset / PARTIAL / bridge_id
    build = BridgeBuild(
        job=Job(
            recording=recording,
            recipe=manner.recipe,
            frames=plan.frames,
            partial=partial,
            durable=manner.remote or manner.share is not None,
            files=files,
        ),
        facts=facts_of(wanted, plan, recording, maker.images),
        folder=dataset / BRIDGES / bridge_id,
        manner=manner,
        recording=recording,
        whole=None,
        place=place,
        part=_part(manner.share, len(plan.frames), place),
        records=[],
        frames_found=0,
        started=started,
        locks=ExitStack(),
    )
    with writing(dataset):
        partial.parent.mkdir(parents=True, exist_ok=True)
    with build.locks as until_it_works:
        _take(build, lambda: check_before_start(maker, plan))
        build.locks = until_it_works.pop_all()
    return build


def _part(share: Share | None, frames: int, place: tuple[int, int]) -> tuple[int, int]:
    if share is None:
        return 0, frames
    return share.frames_of(frames, bridge=place[0], bridges=place[1])


def _take(build: BridgeBuild, check: Callable[[], None]) -> None:
    """Hold the folder, and look at what is in it."""
    partial, manner = build.job.partial, build.manner
    identity = build_identity(build.facts.manifest, build.recording)
    beginning = ExitStack()
    with beginning:
        if manner.share is None:
            build.locks.enter_context(folder_lock(partial))
        else:
            # Parts of one build begin one after the other, and go on together.
            beginning.enter_context(folder_lock(gate_of(partial), wait_s=BEGIN_WAIT_S))
        recover_folder(build.folder)
        build.whole = find_whole(build.folder, build.facts.manifest, overwrite=manner.overwrite)
        if build.whole is None:
            check()
            if manner.share is not None:
                if manner.overwrite:
                    with folder_lock(partial):  # only where no other part is at work
                        prepare_partial(partial, identity, overwrite=True)
                build.locks.enter_context(folder_lock(partial, shared=True))
            prepare_partial(partial, identity, overwrite=manner.overwrite and manner.share is None)
            write_facts(partial, build.facts)
            if manner.share is not None:
                write_division(partial, Division(manner.share.of, *build.place))
        else:
            _clear(partial, identity, alone=manner.share is None)
    if build.whole is None:
        _find(build)


def _clear(partial: Place, identity: Mapping[str, object], *, alone: bool) -> None:
    """Take away what a kill left behind after the bridge had appeared."""
    with ExitStack() as lock:
        if not alone:
            try:
                lock.enter_context(folder_lock(partial))
            except OutputError:
                return  # others are at work there: it is no left-over
        remove_left_over(partial, identity)


def _find(build: BridgeBuild) -> None:
    """Look up what an earlier build, or another part of this one, has made already."""
    first, stop = build.part
    wanted = build.job.frames.source_indices[first:stop].tolist()
    if wanted:
        share = build.manner.share
        within = None if share is None else (wanted[0], wanted[-1])
        build.records = finished_chunks(build.job.partial, within=within)
        build.frames_found = build.frames_made
