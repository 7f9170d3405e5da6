"""Where chunks run: in this process, or in a pool that outlives the death of a worker."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from functools import lru_cache
from multiprocessing.connection import wait as wait_for_handle
from typing import Final

from civil_rgbd.builder.chunks import ChunkRecord, Job, run_chunk
from civil_rgbd.builder.plan import Chunk
from civil_rgbd.errors import BridgeFailedError
from civil_rgbd.pipeline.frames import FrameMaker

MAX_ATTEMPTS: Final = 3
"""A chunk whose worker dies this often is given up."""

OnFrames = Callable[[int], object]


def in_this_process(
    job: Job, chunks: Sequence[Chunk], *, workers: int, on_frames: OnFrames
) -> Iterator[ChunkRecord]:
    """Run chunks one after another: the default for one worker, and the easiest to debug."""
    del workers
    use_one_thread()
    maker = FrameMaker(job.recording, job.recipe)
    for chunk in chunks:
        yield run_chunk(job, chunk, maker, on_frame=lambda: on_frames(1))


def in_processes(
    job: Job, chunks: Sequence[Chunk], *, workers: int, on_frames: OnFrames
) -> Iterator[ChunkRecord]:
    """Run chunks in a pool of processes; when a worker dies the pool is rebuilt.

    Raises:
        BridgeFailedError: a chunk's worker died :data:`MAX_ATTEMPTS` times.
        CivilRgbdError: what a chunk itself raised.
    """
    waiting = list(reversed(chunks))
    suspects: list[Chunk] = []
    attempts = dict.fromkeys(chunks, 0)
    while waiting or suspects:
        # Whose worker died is not told: those that were running are tried again, each alone.
        alone = [suspects.pop()] if suspects else None
        queue, at_once = (alone, 1) if alone else (waiting, workers)
        pool = ProcessPoolExecutor(
            max_workers=min(at_once, len(queue)),
            # Spawn: a fork copies locks that other threads of the parent may hold.
            mp_context=multiprocessing.get_context("spawn"),
            initializer=_start_worker,
            initargs=(job,),
        )
        running: dict[Future[ChunkRecord], Chunk] = {}
        try:
            yield from _drain(pool, running, queue, workers=at_once, on_frames=on_frames)
        except BrokenProcessPool:
            for chunk in running.values():
                attempts[chunk] += 1
                _refuse_poison(job, chunk, attempts[chunk])
                suspects.append(chunk)
        finally:
            _stop(pool)


def _drain(
    pool: ProcessPoolExecutor,
    running: dict[Future[ChunkRecord], Chunk],
    waiting: list[Chunk],
    *,
    workers: int,
    on_frames: OnFrames,
) -> Iterator[ChunkRecord]:
    """Keep the workers busy until nothing waits; ``running`` is what a broken pool loses."""
    while waiting or running:
        while waiting and len(running) < workers:
            future = pool.submit(_run_in_worker, waiting[-1])  # raises when the pool is broken
            running[future] = waiting.pop()
        for future in wait(running, return_when=FIRST_COMPLETED).done:
            record = future.result()  # BrokenProcessPool leaves the chunk in `running`
            del running[future]
            on_frames(len(record.frames))
            yield record


def _refuse_poison(job: Job, chunk: Chunk, attempts: int) -> None:
    if attempts < MAX_ATTEMPTS:
        return
    frames = job.frames[chunk.first : chunk.stop]
    raise BridgeFailedError(
        f"the worker of frames {frames[0].source_index} to {frames[-1].source_index} (stamps "
        f"{frames[0].stamp_ns} to {frames[-1].stamp_ns} ns) died {attempts} times",
        where=job.recording.name,
        fix="look for the kernel's out-of-memory killer, lower --workers, and run the same "
        "command again: finished chunks are kept",
    )


EXECUTORS: Final = {"serial": in_this_process, "processes": in_processes}

_job: Job | None = None  # a worker's copy, handed over once


def _start_worker(job: Job) -> None:
    global _job  # noqa: PLW0603  # the pool's initializer has no other place to leave it
    _job = job
    # The parent answers Ctrl-C; a worker only dies with it.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_die_with_parent, daemon=True).start()
    use_one_thread()


def _die_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait_for_handle([parent.sentinel])
        os._exit(1)  # the build was killed: nobody wants what this worker is making


def _run_in_worker(chunk: Chunk) -> ChunkRecord:
    if _job is None:
        raise RuntimeError("the worker was not started by _start_worker")
    return run_chunk(_job, chunk, _maker_of(_job), on_frame=lambda: None)


@lru_cache(maxsize=1)
def _maker_of(job: Job) -> FrameMaker:
    return FrameMaker(job.recording, job.recipe)


def _stop(pool: ProcessPoolExecutor) -> None:
    processes = list((pool._processes or {}).values())  # noqa: SLF001  # no public way to end them at once
    pool.shutdown(wait=False, cancel_futures=True)
    for process in processes:
        process.terminate()
    for process in processes:
        process.join()


def use_one_thread() -> None:
    """Keep libraries from starting threads of their own: the chunks are the parallelism."""
    import cv2
    import OpenEXR

    cv2.setNumThreads(1)
    OpenEXR.set_global_thread_count(0)
