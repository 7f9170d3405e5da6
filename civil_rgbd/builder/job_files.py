"""Jobs on their way to other processes of this machine: written once, mapped by each of them.

What grows with a recording are arrays: its index, its trajectory, the plan. Mapped from a file,
they take a worker's memory only where its chunks look into them, and nobody waits for a copy.
"""

from __future__ import annotations

import mmap
import pickle
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from civil_rgbd.builder.chunks import Job
from civil_rgbd.format.atomic import writing

_ALIGNED_TO: Final = 64
"""Bytes: no array begins across a cache line."""


class JobFiles:
    """Jobs in a folder; each is read when its first chunk is made, and kept until another's is.

    One that cannot be unpacked here, for its converter is not installed, fails alone. Can be
    pickled: only the folder's name travels.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._number: int | None = None
        self._job: Job | None = None

    def __reduce__(self) -> tuple[object, ...]:
        return type(self), (self._folder,)

    def __getitem__(self, number: int) -> Job:
        if self._job is None or self._number != number:
            self._number, self._job = number, _read(self._folder, number)
        return self._job

    def remove(self) -> None:
        """Take the folder away; a process that has read a job keeps it, where the system allows."""
        shutil.rmtree(self._folder, ignore_errors=True)


def write_jobs(jobs: Sequence[Job], folder: Path) -> JobFiles:
    """Write jobs for other processes of this machine.

    Args:
        jobs: what to hand over.
        folder: an empty one, on this machine.

    Raises:
        OutputError: the folder cannot be written.
    """
    files = JobFiles(folder)
    try:
        with writing(folder):
            for number, job in enumerate(jobs):
                _write(folder, number, job)
    except BaseException:
        files.remove()
        raise
    return files


def _write(folder: Path, number: int, job: Job) -> None:
    arrays: list[pickle.PickleBuffer] = []
    packed = pickle.dumps(job, protocol=5, buffer_callback=arrays.append)
    places = []
    with (folder / f"{number}.arrays").open("wb") as file:
        for array in arrays:
            file.write(bytes(-file.tell() % _ALIGNED_TO))
            start = file.tell()
            file.write(array.raw())
            places.append((start, file.tell()))
    (folder / f"{number}.job").write_bytes(pickle.dumps((packed, places)))


def _read(folder: Path, number: int) -> Job:
    packed, places = pickle.loads((folder / f"{number}.job").read_bytes())  # noqa: S301  # ours
    arrays: list[memoryview] = []
    if any(start < stop for start, stop in places):  # nothing can be mapped of an empty file
        with (folder / f"{number}.arrays").open("rb") as file:
            # A private copy, page by page: arrays can be written to, as those of a job sent whole.
            mapped = memoryview(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_COPY))
        arrays = [mapped[start:stop] for start, stop in places]
    else:
        arrays = [memoryview(bytearray()) for _ in places]
    job: Job = pickle.loads(packed, buffers=arrays)  # noqa: S301  # ours
    return job
