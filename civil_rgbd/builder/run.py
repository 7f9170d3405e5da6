"""Build bridges: plan and check them, make what is missing, publish each when it is whole."""

from __future__ import annotations

import logging
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass, field

from civil_rgbd.builder.attempts import Failed, run_tasks
from civil_rgbd.builder.bridge import remove_if_empty
from civil_rgbd.builder.bridge_build import BridgeBuild, Manner, Order, begin
from civil_rgbd.builder.executors import (
    EXECUTORS,
    Executor,
    Finished,
    Placement,
    Task,
    processors,
    require_dask,
    use_one_thread,
)
from civil_rgbd.builder.report import BuildReport, Outcome, ShareReport, SurveyReport
from civil_rgbd.builder.shares import Share
from civil_rgbd.domain.bridge import BridgeInfo
from civil_rgbd.domain.recipe import Recipe
from civil_rgbd.domain.recording import Recording
from civil_rgbd.errors import BridgeFailedError, CivilRgbdError
from civil_rgbd.format.layout import PARTIAL
from civil_rgbd.storage.places import Place, is_remote

Progress = Callable[[int, int], object]
"""Called with the frames just finished (fewer than 0 where some are lost) and the frames in all."""

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class BuildOptions:
    """How to build, beside the recipe; nothing here changes a pixel.

    Attributes:
        workers: chunks at once; None = one a processor, or what a cluster has.
        executor: ``serial``, ``processes`` or ``dask``; None = one of the first two.
        scheduler: address of a running Dask scheduler; None = a local cluster.
        share: make this part only, and publish nothing.
        overwrite: replace a bridge or an unfinished build that was made otherwise.
        overrides: recipe keys that were set by hand, for the manifest.
        on_progress: called as frames are finished.
    """

    workers: int | None = 1
    executor: str | None = None
    scheduler: str | None = None
    share: Share | None = None
    overwrite: bool = False
    overrides: Mapping[str, object] = field(default_factory=dict)
    on_progress: Progress = lambda _done, _total: None


def build_bridge(
    recording: Recording, recipe: Recipe, dataset: Place, info: BridgeInfo, options: BuildOptions
) -> BuildReport:
    """Build one bridge into a dataset folder; a build that was stopped is gone on with.

    Args:
        recording: an opened recording.
        recipe: how frames are made.
        dataset: the dataset folder; it is made if need be.
        info: identity and what people say about the bridge.
        options: how to run; a share is none of a whole bridge: see :func:`build_bridges`.

    Returns:
        what was done; the bridge folder is whole.

    Raises:
        ValueError: the options ask for a share.
        UsageError: the bridge's id does not fit.
        RecordingError: the recording lacks something.
        BuildError: nothing came out, or something else lies where the bridge should.
        OutputError: the folder cannot be written.
    """
    if options.share is not None:
        raise ValueError("one share makes no whole bridge: call build_bridges")
    order = Order(info, open=lambda: recording)
    report = only_report(build_bridges([order], recipe, dataset, options))
    assert isinstance(report, BuildReport)  # noqa: S101  # without a share there is no other
    return report


def only_report(report: SurveyReport) -> BuildReport | ShareReport:
    """Return the report of the only bridge, or raise what it failed with."""
    (outcome,) = report.outcomes
    if outcome.error is not None:
        raise outcome.error
    if outcome.report is None:
        raise RuntimeError("a bridge neither came out nor failed")
    return outcome.report


def build_bridges(
    orders: Sequence[Order], recipe: Recipe, dataset: Place, options: BuildOptions
) -> SurveyReport:
    """Build many bridges; one that fails does not stop the others.

    Args:
        orders: the bridges, each with another id.
        recipe: how frames are made.
        dataset: the dataset folder; it is made if need be.
        options: how to run.

    Returns:
        what became of each.

    Raises:
        UsageError, BuildError: a cluster cannot be used.
    """
    return _Run(orders, recipe, dataset, options).report()


class _Run:
    """Bridges under way, what became of the others, and how far all of it is."""

    def __init__(
        self, orders: Sequence[Order], recipe: Recipe, dataset: Place, options: BuildOptions
    ) -> None:
        self._orders, self._options = orders, options
        self._name = "dask" if options.scheduler else options.executor  # None: not chosen yet
        if self._name == "dask" and not is_remote(dataset):
            dataset = dataset.absolute()  # workers run in folders of their own
        self._manner = Manner(
            recipe=recipe,
            dataset=dataset,
            overrides=options.overrides,
            overwrite=options.overwrite,
            share=options.share,
            remote=self._name == "dask",
        )
        self._outcomes: dict[str, Outcome] = {}
        self._builds: list[BridgeBuild] = []
        self._seen: Counter[Task] = Counter()  # frames of unfinished tasks that were told of

    def report(self) -> SurveyReport:
        """Do all of it."""
        started = time.monotonic()
        use_one_thread()
        if self._name == "dask":
            require_dask()
        if self._options.scheduler is not None:
            # Hashing the recordings of a survey may take minutes: say it before.
            from civil_rgbd.builder.cluster import refuse_unreachable

            refuse_unreachable(self._options.scheduler)
        with ExitStack() as stack:
            stack.callback(remove_if_empty, self._manner.dataset / PARTIAL)
            for place, order in enumerate(self._orders):
                self._begin(order, (place, len(self._orders)), stack)
            self._make()
        ids = [order.info.bridge_id for order in self._orders]
        return SurveyReport(
            outcomes=tuple(self._outcomes[i] for i in ids if i in self._outcomes),
            seconds=time.monotonic() - started,
        )

    def _begin(self, order: Order, place: tuple[int, int], stack: ExitStack) -> None:
        share = self._options.share
        if share and not share.touches(bridge=place[0], bridges=place[1]):
            return
        try:
            build = begin(order, self._manner, place=place)
        except Exception as error:  # noqa: BLE001  # whatever it is, other bridges go on
            self._fail(order.info.bridge_id, error)
            return
        self._builds.append(build)
        stack.callback(build.close)

    def _make(self) -> None:
        options = self._options
        total = sum(build.frames for build in self._builds)
        options.on_progress(sum(b.frames_made for b in self._builds if not b.whole), total)
        for build in self._builds:
            if build.whole or build.frames_made == build.frames:
                self._finish(build)
        if all(build.folder.name in self._outcomes for build in self._builds):
            return
        with closing(self._executor()) as executor:
            tasks = [
                Task(number, chunk)
                for number, build in enumerate(self._builds)
                if self._is_wanted(number)
                for chunk in build.chunks(workers=executor.slots)
            ]
            jobs = [build.job for build in self._builds]
            for event in run_tasks(
                executor, tasks, jobs, wanted=lambda task: self._is_wanted(task.job)
            ):
                build = self._builds[event.task.job]
                if isinstance(event, Failed):
                    self._fail(build.folder.name, event.error)
                elif isinstance(event, Finished):
                    self._made(event, build)
                else:
                    _log.info("%s, chunk %s: %s", build.folder.name, event.task.chunk, event.cause)
                    self._tell(event.task, -self._seen[event.task])

    def _executor(self) -> Executor:
        options = self._options
        name = self._name or self._usual_executor()
        return EXECUTORS[name](
            [build.job for build in self._builds],
            Placement(name, options.workers, options.scheduler),
            self._tell,
        )

    def _usual_executor(self) -> str:
        workers = self._options.workers or processors()
        unmade = [build for build in self._builds if build.folder.name not in self._outcomes]
        chunks = sum(len(build.chunks(workers=workers)) for build in unmade)
        # A process for one chunk alone would only cost its start.
        return "serial" if workers == 1 or chunks < 2 else "processes"

    def _is_wanted(self, number: int) -> bool:
        return self._builds[number].folder.name not in self._outcomes

    def _made(self, event: Finished, build: BridgeBuild) -> None:
        frames = event.task.chunk.stop - event.task.chunk.first
        self._tell(event.task, frames - self._seen[event.task])
        build.records.append(event.record)
        if build.frames_made == build.frames and build.folder.name not in self._outcomes:
            self._finish(build)

    def _tell(self, task: Task, frames: int) -> None:
        if frames:
            self._seen[task] += frames
            total = sum(build.frames for build in self._builds)
            self._options.on_progress(frames, total)

    def _finish(self, build: BridgeBuild) -> None:
        name = build.folder.name
        try:
            self._outcomes[name] = Outcome(name, report=build.finish())
        except CivilRgbdError as error:
            self._fail(name, error)
        build.close()

    def _fail(self, bridge_id: str, error: Exception) -> None:
        if not isinstance(error, CivilRgbdError) and len(self._orders) > 1:
            _log.error("%s failed", bridge_id, exc_info=error)
            error = BridgeFailedError(
                f"{type(error).__name__}: {error}",
                where=bridge_id,
                fix="build it alone for the whole story, and please report that",
            )
        self._outcomes[bridge_id] = Outcome(bridge_id, error=error)
