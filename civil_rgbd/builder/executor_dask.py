"""Chunks on a Dask cluster: a running one, or one started on this machine."""

from __future__ import annotations

import pickle
import secrets
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import CancelledError
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from typing import Any, Final

from distributed import Client, Future, KilledWorker, WorkerPlugin, get_worker, wait

from civil_rgbd.builder.bridge import IDENTITY
from civil_rgbd.builder.chunks import Job, run_chunk
from civil_rgbd.builder.cluster import connect, refuse_unfit
from civil_rgbd.builder.executors import (
    Event,
    Finished,
    LastMaker,
    Lost,
    OnFrames,
    PackedJobs,
    Placement,
    Task,
    processors,
    raised,
    use_one_thread,
)
from civil_rgbd.builder.originals import fingerprint
from civil_rgbd.builder.provenance import software
from civil_rgbd.domain.bridge import Software
from civil_rgbd.errors import BridgeFailedError, CivilRgbdError
from civil_rgbd.storage.places import is_remote

_LOOK_EVERY_S: Final = 5.0  # a cluster grows and shrinks, and may lose a chunk without a word


class JobsPlugin(WorkerPlugin):  # type: ignore[misc]  # distributed publishes no stubs
    """Brings the jobs to every worker once; also to those that join later."""

    def __init__(self, name: str, jobs: PackedJobs, software: Software) -> None:
        self.name = name
        self.jobs = jobs
        self.software = software
        self._local: threading.local | None = None  # made where it is used: none can be pickled

    def setup(self, worker: object) -> None:
        """Make room for what each thread of the worker keeps."""
        del worker
        self._local = threading.local()
        use_one_thread()

    def teardown(self, worker: object) -> None:
        """Let go of it."""
        del worker
        self._local = None

    def place(self) -> _Place:
        """Return this thread's copy of the jobs: open files and windows are not shared."""
        if self._local is None:
            raise RuntimeError("the worker was not set up")
        if not hasattr(self._local, "place"):
            self._refuse_other_worker()
            self._local.place = _Place(pickle.loads(pickle.dumps(self.jobs)), LastMaker())  # noqa: S301  # a copy
        place: _Place = self._local.place
        return place

    def _refuse_other_worker(self) -> None:
        # Those that were there at the start are known to fit; this one may have joined later.
        here, there = software(), self.software
        other_commit = there.commit not in {None, here.commit}
        if other_commit or (here.civil_rgbd, here.packages) != (there.civil_rgbd, there.packages):
            raise RuntimeError(f"this worker has other versions: {here}, not {there}")


@dataclass(frozen=True, slots=True, eq=False)
class _Place:
    jobs: PackedJobs
    makers: LastMaker


def run_on_worker(plugin: str, task: Task) -> Event:
    """Make one chunk; runs on a worker."""
    try:
        place = get_worker().plugins[plugin].place()
        job = place.jobs[task.job]
        _refuse_other_files(job)
        record = run_chunk(job, task.chunk, place.makers.of(job), on_frame=_still_wanted(job))
    except CivilRgbdError as error:
        where = f"{error.where}, on the worker {get_worker().address}"
        return raised(task, type(error)(error.what, where=where, fix=error.fix))
    except Exception as error:  # noqa: BLE001  # whatever it is, other chunks go on
        return raised(task, error)
    return Finished(task, record)


def _refuse_other_files(job: Job) -> None:
    for original in job.files:
        if not fingerprint(original.path).same_content(original):
            raise RuntimeError(f"{original.path} is another file on this worker")


def _still_wanted(job: Job) -> Callable[[], None]:
    """Return what stops a chunk when its build was thrown away: nobody could tell this worker."""
    if is_remote(job.partial):
        return lambda: None  # looking would cost a request a frame
    path = job.partial / IDENTITY
    before = path.read_bytes()

    def look() -> None:
        if path.read_bytes() != before:
            raise RuntimeError("the unfinished build was replaced by another one")

    return look


class DaskExecutor:
    """Sends chunks to a cluster; the records come back, the frames go to the dataset folder."""

    def __init__(self, jobs: Sequence[Job], on_frames: OnFrames, placement: Placement) -> None:
        del on_frames  # a worker tells of whole chunks only
        self._running: dict[Future, Task] = {}
        self._looked = 0.0
        self._threads = 1
        self._where = placement.scheduler or "a local cluster"
        self._stack = ExitStack()
        with self._stack as until_it_works:
            self._client: Client = connect(
                placement.scheduler, workers=placement.workers or processors(), stack=self._stack
            )
            files = [original for job in jobs for original in job.files]
            refuse_unfit(self._client, jobs[0].partial.parent.parent, files)
            self._plugin = f"civil-rgbd-{secrets.token_hex(8)}"
            self._client.register_plugin(
                JobsPlugin(self._plugin, PackedJobs(jobs), software()), name=self._plugin
            )
            self._most = placement.workers if placement.scheduler else None
            self._stack = until_it_works.pop_all()

    @property
    def slots(self) -> int:
        """One chunk a thread of the cluster."""
        if time.monotonic() - self._looked > _LOOK_EVERY_S:
            self._looked = time.monotonic()
            threads = sum(self._client.nthreads().values())
            self._threads = max(1, min(threads, self._most or threads))
        return self._threads

    def start(self, task: Task) -> None:
        """Send a chunk."""
        self._refuse_gone()
        future = self._client.submit(
            run_on_worker,
            self._plugin,
            task,
            key=f"{self._plugin}-{task.job}-{task.chunk.first}-{secrets.token_hex(4)}",
            pure=False,
        )
        self._running[future] = task

    def wait(self) -> Sequence[Event]:
        """Wait until some chunks came to an end."""
        while True:
            # Some are cancelled, or none ended in time: their status says which.
            with suppress(TimeoutError, CancelledError):
                wait(list(self._running), timeout=_LOOK_EVERY_S, return_when="FIRST_COMPLETED")
            ended = [future for future in self._running if future.status != "pending"]
            self._refuse_gone()
            if ended:
                return [self._event(future, self._running.pop(future)) for future in ended]

    def close(self) -> None:
        """Take back what was sent, and leave the cluster as it was found."""
        with self._stack:
            if self._client.status == "running":
                self._client.cancel(list(self._running), force=True)
                self._client.unregister_worker_plugin(self._plugin)

    def _event(self, future: Future, task: Task) -> Event:
        if future.status == "finished":
            event: Event = future.result()
            return event
        if future.status == "error":
            error: Any = future.exception()
            if isinstance(error, KilledWorker):
                at = getattr(error.last_worker, "address", "unknown")
                return Lost(task, f"its worker at {at} died")
            return raised(task, error)
        return Lost(task, "the cluster lost it")

    def _refuse_gone(self) -> None:
        if self._client.status != "running":
            raise BridgeFailedError(
                "the Dask scheduler is gone",
                where=self._where,
                fix="start it again, and run the same command: finished chunks are kept",
            )
