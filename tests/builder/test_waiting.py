"""Each worker stays on a stretch of its own; all chunks come, each once."""

from __future__ import annotations

import itertools
import random

import pytest

from civil_rgbd.builder.executors import Task
from civil_rgbd.builder.plan import Chunk
from civil_rgbd.builder.waiting import Waiting


def tasks_of(numbers: list[int], job: int = 0) -> list[Task]:
    return [Task(job, Chunk(number, 10 * number, 10 * number + 10)) for number in numbers]


def taken_by(workers: int, tasks: list[Task], seed: int = 0) -> list[list[Task]]:
    """What each worker makes, in order, where chunks take times that nobody foresees."""
    dice = random.Random(seed)  # noqa: S311  # no secret
    waiting, made = Waiting(tasks), [list[Task]() for _ in range(workers)]
    busy_until = [0.0] * workers
    while waiting:
        worker = min(range(workers), key=lambda at: busy_until[at])
        after = made[worker][-1:]
        running = [made[at][-1] for at in range(workers) if at != worker and made[at]]
        made[worker].append(waiting.take(after=after, running=running))
        busy_until[worker] += dice.uniform(0.9, 1.1)
    return made


def jumps(made: list[Task]) -> int:
    """How often a worker began where it had not just been."""
    return sum((a.job, a.chunk.stop) != (b.job, b.chunk.first) for a, b in itertools.pairwise(made))


def test_one_worker_makes_all_in_order() -> None:
    (made,) = taken_by(1, tasks_of([3, 0, 2, 1]))

    assert [task.chunk.number for task in made] == [0, 1, 2, 3]


def test_two_workers_begin_at_the_start_and_in_the_middle() -> None:
    made = taken_by(2, tasks_of(list(range(80))))

    assert [task.chunk.number for task in made[0][:30]] == list(range(30))
    assert [task.chunk.number for task in made[1][:30]] == list(range(40, 70))


@pytest.mark.parametrize("workers", [2, 3, 8])
@pytest.mark.parametrize("seed", range(5))
def test_all_is_made_once_with_few_jumps_and_no_early_end(workers: int, seed: int) -> None:
    tasks = tasks_of(list(range(160)))

    made = taken_by(workers, tasks, seed)

    assert sorted(task.chunk.number for one in made for task in one) == list(range(160))
    assert sum(jumps(one) for one in made) <= 4 * workers
    assert max(map(len, made)) - min(map(len, made)) <= 0.25 * 160 / workers


def test_a_worker_without_a_stretch_takes_the_second_half_of_anothers() -> None:
    ours, others = tasks_of([0, 1, 2, 3, 4, 5, 6, 7]), tasks_of([20])[0]
    waiting = Waiting(ours[1:])

    taken = waiting.take(after=[others], running=[ours[0]])

    assert taken.chunk.number == 4


def test_a_stretch_that_nobody_heads_for_is_begun_at_its_start() -> None:
    tasks = tasks_of([1, 2, 3, 4, 5, 6, 10, 11])
    waiting = Waiting(tasks)

    taken = waiting.take(after=[], running=tasks_of([0]))

    assert taken.chunk.number == 10


def test_a_bridge_is_made_before_the_next_one_is_begun() -> None:
    made = taken_by(2, tasks_of([0, 1, 2], job=1) + tasks_of([0, 1, 2, 3]))

    for one in made:
        assert [task.job for task in one] == sorted(task.job for task in one)
    assert sum(map(len, made)) == 7
