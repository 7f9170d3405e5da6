"""Where chunks run: one small interface, and the places that fulfil it."""

from __future__ import annotations

import os
import pickle
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Final, Protocol

from civil_rgbd.builder.chunks import ChunkRecord, Job, run_chunk
from civil_rgbd.builder.plan import Chunk
from civil_rgbd.errors import CivilRgbdError, MissingExtraError
from civil_rgbd.pipeline.frames import FrameMaker


@dataclass(frozen=True, slots=True)
class Task:
    """One chunk of one bridge.

    Attributes:
        job: the place of its job among those that the executor was made with.
        chunk: which frames.
    """

    job: int
    chunk: Chunk


@dataclass(frozen=True, slots=True, eq=False)
class Finished:
    """A chunk is made, and its record is on disk."""

    task: Task
    record: ChunkRecord


@dataclass(frozen=True, slots=True, eq=False)
class Lost:
    """A chunk's worker died; ``cause`` says how, in words."""

    task: Task
    cause: str


@dataclass(frozen=True, slots=True, eq=False)
class Raised:
    """A chunk raised; ``error`` is None when it was none of ours; ``cause`` says it in words."""

    task: Task
    error: CivilRgbdError | None
    cause: str


Event = Finished | Lost | Raised


class Executor(Protocol):
    """Runs chunks somewhere. Which bytes come out does not depend on where."""

    @property
    def slots(self) -> int:
        """How many chunks it takes at once; it may grow and shrink."""

    def start(self, task: Task) -> None:
        """Begin a chunk; at most :attr:`slots` are under way."""

    def wait(self) -> Sequence[Event]:
        """Wait until chunks that were started came to an end, one way or another."""

    def close(self) -> None:
        """End all workers at once, whatever they are doing."""


OnFrames = Callable[[Task, int], object]
"""Called with a task and how many more of its frames are made, while it runs."""


@dataclass(frozen=True, slots=True)
class Placement:
    """Where to run.

    Attributes:
        executor: a key of :data:`EXECUTORS`.
        workers: how many chunks at once; None = one a processor, or what a cluster has.
        scheduler: address of a running Dask scheduler; None = a local cluster of its own.
    """

    executor: str = "serial"
    workers: int | None = 1
    scheduler: str | None = None


class SerialExecutor:
    """Runs one chunk after the other in this process: the easiest to debug."""

    slots = 1

    def __init__(self, jobs: Sequence[Job], on_frames: OnFrames) -> None:
        self._jobs = jobs
        self._on_frames = on_frames
        self._makers = LastMaker()
        self._task: Task | None = None
        use_one_thread()

    def start(self, task: Task) -> None:
        """Remember a chunk."""
        self._task = task

    def wait(self) -> Sequence[Event]:
        """Make the frames of the chunk."""
        task = self._task
        if task is None:
            raise RuntimeError("nothing was started")
        self._task = None
        job = self._jobs[task.job]
        try:
            record = run_chunk(
                job,
                task.chunk,
                self._makers.of(job),
                on_frame=lambda: self._on_frames(task, 1),
            )
        except Exception as error:  # noqa: BLE001  # whatever it is, other chunks go on
            return (raised(task, error),)
        return (Finished(task, record),)

    def close(self) -> None:
        """Nothing is left behind."""


class LastMaker:
    """The frame maker of the last job: a worker makes the chunks of a bridge in a row."""

    def __init__(self) -> None:
        self._job: Job | None = None
        self._maker: FrameMaker | None = None

    def of(self, job: Job) -> FrameMaker:
        """Return the maker of a job; chunks of the same job share what was read."""
        if self._maker is None or self._job is not job:
            self._job, self._maker = job, FrameMaker(job.recording, job.recipe)
        return self._maker


class PackedJobs:
    """Jobs on their way to other processes; each is unpacked when its first chunk is made.

    One that cannot be unpacked there, for its converter is not installed, fails alone.
    """

    def __init__(self, jobs: Sequence[Job]) -> None:
        self._packed = tuple(pickle.dumps(job) for job in jobs)
        self._number: int | None = None
        self._job: Job | None = None

    def __reduce__(self) -> tuple[object, ...]:
        return _as_packed, (self._packed,)

    def __getitem__(self, number: int) -> Job:
        if self._job is None or self._number != number:
            self._number, self._job = number, pickle.loads(self._packed[number])  # noqa: S301  # ours
        return self._job


def _as_packed(packed: tuple[bytes, ...]) -> PackedJobs:
    jobs = PackedJobs(())
    jobs._packed = packed  # noqa: SLF001  # its own way through pickle
    return jobs


def raised(task: Task, error: Exception) -> Raised:
    """Put an exception into words that survive the way between processes."""
    if isinstance(error, CivilRgbdError):
        return Raised(task, error, error.what)
    place = traceback.extract_tb(error.__traceback__)[-1:]
    where = "".join(f" ({Path(at.filename).name}, line {at.lineno})" for at in place)
    return Raised(task, None, f"{type(error).__name__}: {error}{where}")


def _serial(jobs: Sequence[Job], placement: Placement, on_frames: OnFrames) -> Executor:
    del placement
    return SerialExecutor(jobs, on_frames)


def _processes(jobs: Sequence[Job], placement: Placement, on_frames: OnFrames) -> Executor:
    from civil_rgbd.builder.executor_processes import ProcessExecutor

    return ProcessExecutor(jobs, on_frames, workers=placement.workers or processors())


def _dask(jobs: Sequence[Job], placement: Placement, on_frames: OnFrames) -> Executor:
    from civil_rgbd.builder.executor_dask import DaskExecutor

    return DaskExecutor(jobs, on_frames, placement)


EXECUTORS: Final = {"serial": _serial, "processes": _processes, "dask": _dask}
"""By name: what makes one of jobs, a placement, and whom to tell of frames."""


def require_dask() -> None:
    """Refuse to go on without Dask.

    Raises:
        MissingExtraError: it is not installed.
    """
    if find_spec("distributed") is None:
        raise MissingExtraError(
            "the executor dask needs the package distributed, which is not installed",
            where="--executor dask",
            fix='pip install "civil-rgbd[dask]"',
        )


def processors() -> int:
    """Return how many processors this process may use: a job on a cluster has fewer than all."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def use_one_thread() -> None:
    """Keep libraries from starting threads of their own: the chunks are the parallelism."""
    import cv2
    import OpenEXR

    cv2.setNumThreads(1)
    OpenEXR.set_global_thread_count(0)
