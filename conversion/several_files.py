"""The files of one recording, walked in order as if they were one long file."""

from __future__ import annotations

import os
import shutil
import weakref
from bisect import bisect_right
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from civil_rgbd.conversion.compression import is_packed, unpack_file
from civil_rgbd.conversion.container import NO_CHUNK, Container, Extent, FilePayloads, SinkFor
from civil_rgbd.conversion.ros_assembly import Opened
from civil_rgbd.conversion.source_hash import NOT_WANTED, HashWanted, being_read, hashes_wanted
from civil_rgbd.conversion.topics import TopicTable
from civil_rgbd.domain.recording import RecordingNotes, RecordingOptions, SourceFile
from civil_rgbd.errors import RecordingError, UsageError
from civil_rgbd.storage.client import is_web
from civil_rgbd.storage.places import Place
from civil_rgbd.storage.remote_path import RemotePath

_SAID_AT_MOST: Final = 5
_OPEN_FILES: Final = 2  # scans and images of one instant lie at most across one border
START_BYTES: Final = 512
"""Enough to tell a kind of file: a bag names its encryption in its first record."""


class JoinedPayloads:
    """Fetches messages of several files by places that count on from file to file."""

    def __init__(self, bases: Sequence[int], files: Sequence[FilePayloads]) -> None:
        self._bases, self._files = tuple(bases), tuple(files)
        self._open: list[FilePayloads] = []

    def __reduce__(self) -> tuple[Any, ...]:
        return (JoinedPayloads, (self._bases, self._files))

    def fetch(self, chunk_start: int, offset: int, length: int) -> memoryview:
        """Return one message's payload.

        Raises:
            RecordingError: its file is gone, changed, or cannot be read.
        """
        chunked = chunk_start != NO_CHUNK
        number = bisect_right(self._bases, chunk_start if chunked else offset) - 1
        base, file = self._bases[number], self._files[number]
        self._keep_open(file)
        if chunked:
            return file.fetch(chunk_start - base, offset, length)
        return file.fetch(NO_CHUNK, offset - base, length)

    def _keep_open(self, file: FilePayloads) -> None:
        if self._open and self._open[-1] is file:
            return
        self._open = [other for other in self._open if other is not file]
        self._open.append(file)
        while len(self._open) > _OPEN_FILES:
            self._open.pop(0).close()

    def close(self) -> None:
        """Let go of all files; the next fetch opens what it needs again."""
        for file in self._files:
            file.close()
        self._open.clear()


class UnpackedPayloads:
    """Messages of a file that is compressed as a whole: unpacked aside once a process needs it."""

    def __init__(
        self,
        make: Callable[[Path, int], FilePayloads],
        packed: Path,
        unpacked: Path | None = None,
    ) -> None:
        self._make, self._packed, self._unpacked = make, packed, unpacked
        self._inner: FilePayloads | None = None

    def __reduce__(self) -> tuple[Any, ...]:
        # A worker on the same machine finds the unpacked file; another one unpacks anew.
        return (UnpackedPayloads, (self._make, self._packed, self._unpacked))

    def unpack(self) -> Path:
        """Return the unpacked file; it goes when this object goes."""
        if self._unpacked is None or not self._unpacked.exists():
            self._unpacked = unpack_file(self._packed)
            weakref.finalize(self, _remove, self._unpacked.parent, os.getpid())
        return self._unpacked

    def fetch(self, chunk_start: int, offset: int, length: int) -> memoryview:
        """Return one message's payload.

        Raises:
            RecordingError: the file is gone, changed, or cannot be read.
        """
        if self._inner is None:
            try:
                unpacked = self.unpack()
                self._inner = self._make(unpacked, unpacked.stat().st_size)
            except OSError as error:
                raise unreadable(self._packed, error) from error
        return self._inner.fetch(chunk_start, offset, length)

    def close(self) -> None:
        """Let go of the file; the unpacked one stays for the next fetch."""
        if self._inner is not None:
            self._inner.close()
        self._inner = None


def _remove(folder: Path, owner: int) -> None:
    if os.getpid() == owner:  # a forked worker forgets its copy; the file is its parent's
        shutil.rmtree(folder, ignore_errors=True)


@dataclass(frozen=True, slots=True, eq=False)
class WalkedFiles:
    """The files of a recording, each read once.

    Attributes:
        sources: name, size and checksum of each.
        payloads: fetches their messages.
        extent: what the walks found, of all together.
    """

    sources: tuple[SourceFile, ...]
    payloads: JoinedPayloads
    extent: Extent


@contextmanager
def opened_files(
    container: Container,
    files: Sequence[Place],
    options: RecordingOptions,
    table: TopicTable,
    *,
    name: str,
    where: object,
) -> Iterator[Opened]:
    """Walk files of one kind and hand out what was found; let go of the files afterwards.

    Args:
        container: the kind.
        files: in order.
        options: what the user says.
        table: gathers the messages.
        name: of the recording.
        where: what the user gave, for errors.

    Raises:
        RecordingError: a file is not there, of another kind, or damaged.
        UsageError: a file is given twice.
    """
    hashes = hashes_wanted(options, len(files))
    walked = walk_files(container, files, table.sink_for, hashes=hashes)
    try:
        salvage = judge(walked.extent, container, options, where=where)
        notes = RecordingNotes(
            salvage=salvage,
            simulated=walked.extent.simulated or table.simulated,
            warnings=tuple(walked.extent.remarks),
        )
        yield Opened(table, walked.payloads, walked.sources, name, where, notes)
    finally:
        walked.payloads.close()


def walk_files(
    container: Container,
    files: Sequence[Place],
    sink_for: SinkFor,
    *,
    hashes: Sequence[HashWanted] = (),
) -> WalkedFiles:
    """Read every record of every file once; hashes are taken meanwhile, if at all.

    Raises:
        RecordingError: a file is not there, cannot be read, or is of another kind.
        UsageError: a file is given twice.
    """
    found: list[tuple[Extent, FilePayloads, SourceFile]] = []
    base = 0
    for path, wanted in zip(files, hashes or [NOT_WANTED] * len(files), strict=True):
        try:
            found.append(_walk_file(container, path, sink_for, base, wanted))
        except OSError as error:
            raise unreadable(path, error) from error
        base += found[-1][0].span
    extents, payloads, sources = zip(*found, strict=True)
    _refuse_twice(sources, files)
    bases = [sum(extent.span for extent in extents[:number]) for number in range(len(extents))]
    return WalkedFiles(sources, JoinedPayloads(bases, payloads), _together(extents, files))


def _walk_file(
    container: Container, path: Place, sink_for: SinkFor, base: int, wanted: HashWanted
) -> tuple[Extent, FilePayloads, SourceFile]:
    size_of(path)
    payloads: FilePayloads
    with being_read(path, wanted) as read:
        if is_packed(path):
            payloads = UnpackedPayloads(container.payloads, _packed(path))
            plain: Place = payloads.unpack()
        else:
            plain, payloads = read.path, container.payloads(_bound(read.path), read.size_bytes)
        with plain.open("rb") as file:
            container.refuse(path, file.read(START_BYTES))
        extent = container.walk(plain, sink_for, plain.stat().st_size, base)
        return extent, payloads, read.described(container.name)


def _bound(path: Place) -> Place:
    """Return a path that other processes find: a remote one with the version that was walked."""
    return RemotePath(path.url, path.pinned) if isinstance(path, RemotePath) else path.absolute()


def _packed(path: Place) -> Path:
    if isinstance(path, Path):
        return path.absolute()
    raise RecordingError(
        "a file that is compressed as a whole cannot be read by ranges",
        where=path,
        fix="download it, or unpack it (`zstd -d`) and upload that",
    )


def _together(extents: Sequence[Extent], files: Sequence[Place]) -> Extent:
    if len(extents) == 1:
        return extents[0]
    together = Extent(whole=True)
    for extent, path in zip(extents, files, strict=True):
        together.add(extent, path.name)
    return together


def _refuse_twice(sources: Sequence[SourceFile], files: Sequence[Place]) -> None:
    first: dict[str, Place] = {}
    for source, path in zip(sources, files, strict=True):
        same = source.sha256 or str(path.absolute())
        if same in first:
            raise UsageError(
                f"two files of the recording are the same: {first[same].name} and {path.name}",
                where=path,
                fix="give each file once",
            )
        first[same] = path


def size_of(path: Place) -> int:
    """Return a file's length.

    Raises:
        RecordingError: it is not there, or a folder.
    """
    if isinstance(path, Path) and path.is_dir():
        raise RecordingError(
            "this is a folder where a file is needed",
            where=path,
            fix="name the file inside, or the folder of a ROS 2 recording by itself",
        )
    try:
        return path.stat().st_size
    except FileNotFoundError as error:
        if isinstance(path, RemotePath) and not is_web(path.url) and path.is_dir():
            raise RecordingError(
                "this is a folder; on object storage recordings are read file by file",
                where=path,
                fix="name the file inside, or the files in order",
            ) from error
        raise RecordingError(
            f"there is no such recording: {str(path)!r}",
            where=path.absolute().parent,
            fix="check the path",
        ) from error


def unreadable(path: Place, error: OSError) -> RecordingError:
    """Compose the error for a file that the system does not give."""
    return RecordingError(
        f"the recording cannot be read: {error.strerror or error}",
        where=path,
        fix="check the disk and the file's permissions",
    )


def judge(
    extent: Extent, container: Container, options: RecordingOptions, *, where: object
) -> str | None:
    """Return what was lost, in words; None when nothing was.

    Raises:
        RecordingError: something was lost, and the user did not ask to go on without it.
    """
    if not extent.damage:
        return None
    said = "; ".join(extent.damage[:_SAID_AT_MOST])
    if len(extent.damage) > _SAID_AT_MOST:
        said += f"; and {len(extent.damage) - _SAID_AT_MOST} more"
    readable = f"{extent.messages} messages over {extent.duration_s:.3f} s are readable"
    if extent.unknown_compression:
        raise RecordingError(said, where=where, fix=container.recompress)
    if not options.salvage:
        raise RecordingError(
            f"the recording is damaged: {said}; {readable}",
            where=where,
            fix="record or copy it again, or go on with what is readable: --salvage",
        )
    return f"{said}; {readable}"
