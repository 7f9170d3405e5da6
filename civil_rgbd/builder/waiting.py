"""Which chunk comes next: the one that goes on where its worker is.

The window of a chunk's first frame is read back through the scans before it. A worker that has just
made those frames has these scans already; any other reads and moves them a second time. So every
worker stays on a stretch of its own, and only who has none left takes the half of another's.
"""

from __future__ import annotations

from collections.abc import Iterable

from civil_rgbd.builder.executors import Task


class Waiting:
    """Chunks that nobody has begun; those of one bridge before those of the next."""

    def __init__(self, tasks: Iterable[Task]) -> None:
        self._jobs: dict[int, dict[int, Task]] = {}  # by job, by first frame, ascending
        for task in sorted(tasks, key=lambda task: (task.job, task.chunk.first)):
            self._jobs.setdefault(task.job, {})[task.chunk.first] = task

    def __bool__(self) -> bool:
        return bool(self._jobs)

    def take(self, *, after: Iterable[Task], running: Iterable[Task]) -> Task:
        """Take the chunk to begin next.

        Args:
            after: chunks whose workers are free now.
            running: chunks that are being made: their workers will want what follows.

        Returns:
            what follows a free worker's chunk; else the beginning of the longest stretch that no
            worker is heading for; else the middle of the longest one.
        """
        for ended in after:
            follower = self._jobs.get(ended.job, {}).get(ended.chunk.stop)
            if follower is not None:
                return self._taken(follower)
        job = next(iter(self._jobs))
        wanted = {task.chunk.stop for task in running if task.job == job}
        stretches = self._stretches(job)
        free = [stretch for stretch in stretches if stretch[0].chunk.first not in wanted]
        if free:
            return self._taken(max(free, key=len)[0])
        longest = max(stretches, key=len)
        return self._taken(longest[len(longest) // 2])

    def _taken(self, task: Task) -> Task:
        del self._jobs[task.job][task.chunk.first]
        if not self._jobs[task.job]:
            del self._jobs[task.job]
        return task

    def _stretches(self, job: int) -> list[list[Task]]:
        """Return the runs of chunks that follow one another."""
        stretches: list[list[Task]] = []
        for task in self._jobs[job].values():
            if stretches and stretches[-1][-1].chunk.stop == task.chunk.first:
                stretches[-1].append(task)
            else:
                stretches.append([task])
        return stretches
