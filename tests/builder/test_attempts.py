"""Three attempts, the last one alone; what fails for good is said once and for all."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

from civil_rgbd.builder.attempts import MAX_ATTEMPTS, Failed, run_tasks
from civil_rgbd.builder.chunks import ChunkRecord, Job
from civil_rgbd.builder.executors import Event, Finished, Lost, Raised, Task
from civil_rgbd.builder.plan import Chunk, plan_frames
from civil_rgbd.domain.recipe import Recipe
from civil_rgbd.errors import OutputError, RecordingError, StorageError
from civil_rgbd.simulator.recording import SimulatedRecording

TASKS = [Task(0, Chunk(number, number, number + 1)) for number in range(4)]
Script = Callable[[Task, int], Event]


class ScriptedExecutor:
    """An executor whose every attempt ends as a script says; writes down what ran beside what."""

    def __init__(self, script: Script, slots: int = 2) -> None:
        self.slots = slots
        self.together: list[tuple[int, ...]] = []
        self._script, self._running, self._attempts = script, list[Task](), dict[Task, int]()

    def start(self, task: Task) -> None:
        assert len(self._running) < self.slots
        self._running.append(task)

    def wait(self) -> Sequence[Event]:
        assert self._running
        self.together.append(tuple(sorted(task.chunk.number for task in self._running)))
        task = self._running.pop(0)
        self._attempts[task] = self._attempts.get(task, 0) + 1
        return [self._script(task, self._attempts[task])]

    def close(self) -> None:
        raise AssertionError("who opened it closes it")


def done(task: Task) -> Finished:
    return Finished(task, ChunkRecord((), {}))


@pytest.fixture(scope="module")
def jobs(recording: SimulatedRecording, recipe: Recipe) -> list[Job]:
    return [Job(recording, recipe, plan_frames(recording, recipe).frames, Path("nowhere"))]


def ends_of(
    script: Script, jobs: list[Job], executor: ScriptedExecutor | None = None
) -> list[Finished | Failed]:
    executor = executor or ScriptedExecutor(script)
    events = run_tasks(executor, TASKS, jobs, wanted=lambda _task: True)
    return [event for event in events if isinstance(event, Finished | Failed)]


def test_every_task_ends_once(jobs: list[Job]) -> None:
    ends = ends_of(lambda task, _attempt: done(task), jobs)

    assert sorted(end.task.chunk.number for end in ends) == [0, 1, 2, 3]


def test_a_lost_chunk_runs_again_and_the_last_time_alone(jobs: list[Job]) -> None:
    def script(task: Task, attempt: int) -> Event:
        bad = task.chunk.number == 1 and attempt < MAX_ATTEMPTS
        return Lost(task, "its worker was killed by SIGKILL") if bad else done(task)

    executor = ScriptedExecutor(script)
    ends = ends_of(script, jobs, executor)

    assert [type(end) for end in ends] == [Finished] * 4
    assert [running for running in executor.together if 1 in running][-1] == (1,)
    assert executor.together[-1] == (1,)


def test_a_chunk_that_is_lost_three_times_names_frames_stamps_and_causes(jobs: list[Job]) -> None:
    def script(task: Task, attempt: int) -> Event:
        return Lost(task, f"death {attempt}") if task.chunk.number == 2 else done(task)

    ends = ends_of(script, jobs)

    (failed,) = [end for end in ends if isinstance(end, Failed)]
    frame = jobs[0].frames[2]
    words = str(failed.error)
    assert f"chunk 2, frames {frame.source_index} to {frame.source_index}" in words
    assert f"stamps {frame.stamp_ns} to {frame.stamp_ns} ns" in words
    assert "failed 3 times: 1: death 1; 2: death 2; 3: death 3" in words
    assert "out-of-memory" in failed.error.fix


def test_what_a_recording_lacks_is_not_asked_for_again(jobs: list[Job]) -> None:
    error = RecordingError("the message breaks its layout", where="x", fix="y")
    asked: list[int] = []

    def script(task: Task, _attempt: int) -> Event:
        asked.append(task.chunk.number)
        return Raised(task, error, error.what) if task.chunk.number == 0 else done(task)

    ends = ends_of(script, jobs)

    assert asked.count(0) == 1
    assert [end.error for end in ends if isinstance(end, Failed)] == [error]


def test_a_disk_may_have_hiccups_but_not_for_ever(jobs: list[Job]) -> None:
    error = OutputError("cannot write: Stale file handle", where="x", fix="y")

    def script(task: Task, attempt: int) -> Event:
        bad = {0: 2, 1: 9}.get(task.chunk.number, 0)
        return Raised(task, error, error.what) if attempt <= bad else done(task)

    ends = ends_of(script, jobs)

    assert [end.error for end in ends if isinstance(end, Failed)] == [error]
    assert len(ends) == 4


def test_storage_out_of_reach_is_asked_again_at_once_but_not_for_every_chunk(
    jobs: list[Job],
) -> None:
    error = StorageError("the object storage cannot be reached", where="s3://x", fix="y")
    asked: list[int] = []
    failed: list[int] = []

    def script(task: Task, _attempt: int) -> Event:
        asked.append(task.chunk.number)
        return Raised(task, error, error.what)

    executor = ScriptedExecutor(script, slots=1)
    for event in run_tasks(executor, TASKS, jobs, wanted=lambda _task: not failed):
        if isinstance(event, Failed):
            assert event.error is error
            failed.append(event.task.chunk.number)

    assert asked == [0] * MAX_ATTEMPTS
    assert failed == [0]


def test_what_nobody_wants_any_more_is_not_started(jobs: list[Job]) -> None:
    executor = ScriptedExecutor(lambda task, _attempt: done(task), slots=1)

    events = list(run_tasks(executor, TASKS, jobs, wanted=lambda task: task.chunk.number < 2))

    assert [event.task.chunk.number for event in events] == [0, 1]
