"""Chunks in processes of this machine; a worker that dies costs its chunk only."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection
from multiprocessing.connection import wait as wait_for_handle
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Final

from civil_rgbd.builder.chunks import Job, run_chunk
from civil_rgbd.builder.executors import (
    Event,
    Finished,
    LastMaker,
    Lost,
    OnFrames,
    Raised,
    Task,
    raised,
    use_one_thread,
)
from civil_rgbd.builder.job_files import JobFiles, write_jobs
from civil_rgbd.format.atomic import writing

_TELL_EVERY_S: Final = 0.2
"""Whoever looks at progress sees no more; each message wakes the parent, and costs a worker."""


@dataclass(slots=True, eq=False)
class _Worker:
    """A process, our end of its pipe, what it is making (None when it waits), what it made."""

    process: BaseProcess
    pipe: Connection
    task: Task | None = None
    made: Task | None = None

    def goes_on(self, task: Task) -> bool:
        """Tell whether a chunk follows the one that it made last: it has read the scans before."""
        made = self.made
        return made is not None and (made.job, made.chunk.stop) == (task.job, task.chunk.first)


class ProcessExecutor:
    """Processes that each make one chunk at a time: whose worker died is known for sure."""

    def __init__(self, jobs: Sequence[Job], on_frames: OnFrames, *, workers: int) -> None:
        self.slots = workers
        with writing(tempfile.gettempdir()):
            folder = Path(tempfile.mkdtemp(prefix="civil_rgbd_"))
        self._jobs = write_jobs(jobs, folder)
        self._on_frames = on_frames
        self._workers: list[_Worker] = []

    def start(self, task: Task) -> None:
        """Give a chunk to a worker that waits, or to a new one."""
        idle = [worker for worker in self._workers if worker.task is None]
        for worker in sorted(idle, key=lambda worker: not worker.goes_on(task)):
            try:
                worker.pipe.send(task)
            except OSError:  # it died while it waited
                self._bury(worker)
            else:
                worker.task = task
                return
        worker = _start_worker(self._jobs)
        self._workers.append(worker)
        worker.task = task
        with contextlib.suppress(OSError):  # it is dead already: `wait` sees the end of the pipe
            worker.pipe.send(task)

    def wait(self) -> Sequence[Event]:
        """Wait until some chunks came to an end; frames are told of as they are made."""
        while True:
            busy = {id(worker.pipe): worker for worker in self._workers if worker.task}
            ready = wait_for_handle([worker.pipe for worker in busy.values()])
            events = [self._hear(busy[id(pipe)]) for pipe in ready]
            ended = [event for event in events if event is not None]
            if ended:
                return ended

    def close(self) -> None:
        """End all workers at once."""
        for worker in self._workers:
            worker.process.kill()
        for worker in list(self._workers):
            self._bury(worker)
        self._jobs.remove()

    def _hear(self, worker: _Worker) -> Event | None:
        """Take one message of a worker, or notice that it is dead; None for frames."""
        task = worker.task
        if task is None:
            raise RuntimeError("a worker spoke that was not asked")
        try:
            said = worker.pipe.recv()
        except (EOFError, OSError):
            return Lost(task, self._bury(worker))
        if isinstance(said, int):
            self._on_frames(task, said)
            return None
        worker.task, worker.made = None, task
        if isinstance(said, Finished | Raised):
            return said
        raise RuntimeError(f"a worker said {said!r}")

    def _bury(self, worker: _Worker) -> str:
        """Take leave of a worker that is dying; return of what, in words."""
        self._workers.remove(worker)
        worker.process.join()
        worker.pipe.close()
        code = worker.process.exitcode or 0
        worker.process.close()
        if code >= 0:
            return f"its worker ended with exit code {code}"
        name = next((sign.name for sign in signal.Signals if sign == -code), f"signal {-code}")
        return f"its worker was killed by {name}"


def _start_worker(jobs: JobFiles) -> _Worker:
    # Spawn: a fork copies locks that other threads of the parent may hold.
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=_work, args=(theirs, jobs), daemon=True)
    with without_interrupts():
        process.start()
    theirs.close()  # or the end of the pipe would never be seen
    return _Worker(process, ours)


@contextmanager
def without_interrupts() -> Iterator[None]:
    """Start children that Ctrl-C does not reach: this process answers it, and ends them."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    # Its own start, with the first child, would let interrupts through again.
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _work(pipe: Connection, jobs: JobFiles) -> None:
    """Make chunks until the parent is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_die_with_parent, args=(jobs,), daemon=True).start()
    use_one_thread()
    makers = LastMaker()
    with contextlib.suppress(EOFError, OSError):
        while True:
            pipe.send(_make(pipe, jobs, makers, pipe.recv()))


def _make(pipe: Connection, jobs: JobFiles, makers: LastMaker, task: Task) -> Event:
    try:
        job = jobs[task.job]
        record = run_chunk(job, task.chunk, makers.of(job), on_frame=_Teller(pipe).frame)
    except Exception as error:  # noqa: BLE001  # whatever it is, other chunks go on
        return raised(task, error)
    return Finished(task, record)


class _Teller:
    """Tells the parent of frames, some at a time; of the last ones the chunk's end does."""

    def __init__(self, pipe: Connection) -> None:
        self._pipe, self._untold, self._told_s = pipe, 0, time.monotonic()

    def frame(self) -> None:
        """Count one, and tell if it is time."""
        self._untold += 1
        if time.monotonic() - self._told_s >= _TELL_EVERY_S:
            self._pipe.send(self._untold)
            self._untold, self._told_s = 0, time.monotonic()


def _die_with_parent(jobs: JobFiles) -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait_for_handle([parent.sentinel])
        jobs.remove()  # the parent cannot any more
        os._exit(1)  # the build was killed: nobody wants what this worker is making
