"""Cells, one after another or some at a time; one that fails stops no other."""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context

from civil_rgbd.benchmark.cells import Cell, CellFailure, Outcome, failure_of, run_cell
from civil_rgbd.errors import CivilRgbdError, TrainingError

_LOGGER = logging.getLogger(__name__)


def run_cells(cells: Sequence[Cell], jobs: int) -> Iterator[Outcome]:
    """Yield what came out of each cell, as they are done.

    Args:
        cells: to train and score.
        jobs: how many at a time, each in a process of its own; 1 takes this process.
    """
    if jobs == 1:
        yield from map(attempt, cells)
        return
    left = deque(cells)
    while left:
        suspects: list[Cell] = []
        yield from _until_broken(left, jobs, suspects)
        for cell in suspects:  # alone: whose process was killed is told from whose was beside it
            again: list[Cell] = []
            yield from _until_broken(deque([cell]), 1, again)
            yield from map(_killed, again)


def attempt(cell: Cell) -> Outcome:
    """Train and score a cell; whatever fails is said of this cell alone."""
    try:
        return run_cell(cell)
    except CivilRgbdError as error:
        return failure_of(cell, error)
    except Exception as error:
        _LOGGER.exception("%s failed", cell.folder)  # nobody foresaw it: the trace tells where
        return failure_of(cell, error)


def _until_broken(left: deque[Cell], jobs: int, suspects: list[Cell]) -> Iterator[Outcome]:
    """Take cells from the left; when a process is killed, those that ran are suspects."""
    running: dict[Future[Outcome], Cell] = {}
    # spawn: a process that was forked from one with threads of torch may wait for them for ever.
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        try:
            while left or running:
                while left and len(running) < jobs:
                    running[pool.submit(attempt, left[0])] = left[0]
                    left.popleft()
                done, _ = wait(running, return_when=FIRST_COMPLETED)
                for future in done:
                    yield future.result()
                    del running[future]
        except BrokenProcessPool:
            suspects += running.values()
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


def _killed(cell: Cell) -> CellFailure:
    error = TrainingError(
        "the process was killed, perhaps for want of memory",
        where=cell.folder,
        fix="give the command again with a smaller batch or fewer --jobs: finished cells are kept, "
        "and this one goes on from its checkpoint",
    )
    return failure_of(cell, error)
