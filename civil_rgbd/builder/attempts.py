"""Each chunk gets several attempts; what fails again and again is given up, the rest goes on."""

from __future__ import annotations

from collections import defaultdict, deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from civil_rgbd.builder.chunks import Job
from civil_rgbd.builder.executors import Event, Executor, Finished, Lost, Raised, Task
from civil_rgbd.builder.waiting import Waiting
from civil_rgbd.errors import BridgeFailedError, CivilRgbdError, OutputError, StorageError

MAX_ATTEMPTS: Final = 3
"""A chunk that fails this often is given up."""


@dataclass(frozen=True, slots=True, eq=False)
class Failed:
    """A chunk that is given up.

    Attributes:
        task: which.
        error: what its bridge fails with; names frames, stamps and cause.
    """

    task: Task
    error: CivilRgbdError


def run_tasks(
    executor: Executor,
    tasks: Iterable[Task],
    jobs: Sequence[Job],
    *,
    wanted: Callable[[Task], bool],
) -> Iterator[Event | Failed]:
    """Run chunks, again where one fails, and tell what became of each.

    The last attempt is made when everything else is done, and alone: a chunk whose worker died for
    want of memory has all of it then, and no neighbour's death is blamed on it.

    Args:
        executor: where they run.
        tasks: all chunks.
        jobs: what they belong to.
        wanted: tells, before a task starts, whether anybody still waits for it.

    Yields:
        every attempt's end; :class:`Failed` after the last one's. Nothing for tasks that nobody
        wanted any more.
    """
    queue = _Queue(tasks)
    causes: defaultdict[Task, list[str]] = defaultdict(list)
    while queue:
        queue.start(executor, wanted)
        if not queue.running:
            continue  # nobody wants what is left
        for event in executor.wait():
            queue.ended(event.task)
            yield event
            if isinstance(event, Finished):
                continue
            if isinstance(event, Raised) and event.error and _is_final(event.error):
                yield Failed(event.task, event.error)
                continue
            causes[event.task].append(event.cause)
            if len(causes[event.task]) >= MAX_ATTEMPTS:
                yield Failed(event.task, _given_up(event, causes[event.task], jobs))
            elif isinstance(event, Raised) and isinstance(event.error, StorageError):
                # It takes half a minute to find storage out of reach: not each chunk shall.
                queue.at_once.append(event.task)
            elif len(causes[event.task]) == MAX_ATTEMPTS - 1:
                queue.last.append(event.task)
            else:
                queue.again.append(event.task)


class _Queue:
    """Tasks that wait for their first attempt or for another one, and tasks that run.

    Attributes:
        running: are being made.
        at_once: to be tried again before any other.
        again: to be tried again when each other one has been begun.
        last: to be tried when all else is done, and alone.
    """

    def __init__(self, tasks: Iterable[Task]) -> None:
        self.running: list[Task] = []
        self.at_once, self.again, self.last = deque[Task](), deque[Task](), deque[Task]()
        self._waiting = Waiting(tasks)
        self._free: list[Task] = []  # ended since tasks were started: their workers are free

    def __bool__(self) -> bool:
        return bool(self._more() or self.last or self.running)

    def start(self, executor: Executor, wanted: Callable[[Task], bool]) -> None:
        """Start tasks while places are free."""
        while self._more() and len(self.running) < executor.slots:
            self._start(self._next(), executor, wanted)
        while self.last and not self.running:
            self._start(self.last.popleft(), executor, wanted)
        self._free.clear()

    def ended(self, task: Task) -> None:
        """Take note that an attempt is over."""
        self.running.remove(task)
        self._free.append(task)

    def _more(self) -> bool:
        return bool(self.at_once or self._waiting or self.again)

    def _next(self) -> Task:
        if self.at_once:
            return self.at_once.popleft()
        if self._waiting:
            return self._waiting.take(after=self._free, running=self.running)
        return self.again.popleft()

    def _start(self, task: Task, executor: Executor, wanted: Callable[[Task], bool]) -> None:
        if wanted(task):
            executor.start(task)
            self.running.append(task)


def _is_final(error: CivilRgbdError) -> bool:
    # What a recording or a recipe lacks, it lacks the next time too. A disk may have hiccups, a
    # network too; or one worker of many lacks credentials.
    return not isinstance(error, OutputError | StorageError)


def _given_up(event: Lost | Raised, causes: list[str], jobs: Sequence[Job]) -> CivilRgbdError:
    if isinstance(event, Raised) and event.error is not None:
        return event.error
    job = jobs[event.task.job]
    frames = job.frames[event.task.chunk.first : event.task.chunk.stop]
    died = isinstance(event, Lost)
    same = len(set(causes)) == 1
    why = causes[-1] if same else "; ".join(f"{n}: {cause}" for n, cause in enumerate(causes, 1))
    return BridgeFailedError(
        f"chunk {event.task.chunk.number}, frames {frames[0].source_index} to "
        f"{frames[-1].source_index} (stamps {frames[0].stamp_ns} to {frames[-1].stamp_ns} ns), "
        f"failed {len(causes)} times{', each time' if same else ''}: {why}",
        where=job.recording.name,
        fix="look for the kernel's out-of-memory killer, lower --workers, and run the same "
        "command again: finished chunks are kept"
        if died
        else "please report it with these lines; the same command goes on with finished chunks",
    )
