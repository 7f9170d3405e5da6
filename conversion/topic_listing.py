"""The topics of a recording, listed from its own index where that holds, else by looking."""

from __future__ import annotations

from array import array
from collections.abc import Iterable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.conversion.compression import is_packed
from civil_rgbd.conversion.container import Container, IndexedTopic
from civil_rgbd.conversion.ros_files import RosFiles
from civil_rgbd.conversion.several_files import START_BYTES, size_of, unreadable, walk_files
from civil_rgbd.conversion.topics import plain_type, role_of
from civil_rgbd.domain.inspection import TopicListing, TopicSummary, timing_of
from civil_rgbd.storage.places import Place, place_of

_LARGEST_NS: Final = 1 << 63


def list_files(files: RosFiles) -> TopicListing:
    """List the topics of a recording: counts, and when their messages were logged.

    The index of each file is taken where it accounts for all of it, so that no message is read;
    if one does not, every file is walked.

    Raises:
        RecordingError: a file is not there, of another kind, or cannot be read.
        UsageError: a file is given twice.
    """
    size_bytes = sum(size_of(path) for path in files.paths)
    name = place_of(str(files.where)).name
    found: list[IndexedTopic] = []
    for path in files.paths:
        indexed = _indexed(files.container, path)
        if indexed is None:
            break
        found += indexed
    else:
        topics = _summaries(found)
        return TopicListing(name, files.container.name, size_bytes, topics, by_index=True)
    counts = _Counts()
    walked = walk_files(files.container, files.paths, counts.sink_for)
    walked.payloads.close()
    return TopicListing(
        name,
        files.container.name,
        size_bytes,
        _summaries(counts.topics()),
        by_index=False,
        damage=tuple(walked.extent.damage),
        remarks=tuple(walked.extent.remarks),
    )


def _indexed(container: Container, path: Place) -> tuple[IndexedTopic, ...] | None:
    if is_packed(path):
        return None
    try:
        with path.open("rb") as file:
            container.refuse(path, file.read(START_BYTES))
        return container.index(path)
    except OSError as error:
        raise unreadable(path, error) from error


class _Count:
    """Keeps the log times of one channel, and looks at no message."""

    head_only = True

    def __init__(self) -> None:
        self.log_times_ns = array("q")

    def take(self, log_time_ns: int, place: tuple[int, int, int], payload: memoryview) -> None:
        """Count one message."""
        del place, payload
        self.log_times_ns.append(log_time_ns % _LARGEST_NS)


class _Counts:
    def __init__(self) -> None:
        self._counts: dict[tuple[str, str, str], _Count] = {}

    def sink_for(self, topic: str, type_name: str, encoding: str) -> _Count:
        return self._counts.setdefault((topic, type_name, encoding), _Count())

    def topics(self) -> list[IndexedTopic]:
        return [
            IndexedTopic(*key, np.array(count.log_times_ns, dtype=np.int64))
            for key, count in self._counts.items()
        ]


def _summaries(topics: Iterable[IndexedTopic]) -> tuple[TopicSummary, ...]:
    """Return the topics by name; channels of one topic and type are one."""
    times: dict[tuple[str, str, str], list[NDArray[np.int64]]] = {}
    for one in topics:
        key = one.topic, plain_type(one.type_name), one.encoding
        times.setdefault(key, []).append(one.log_times_ns)
    return tuple(
        TopicSummary(
            name=name,
            type_name=type_name,
            role=role_of(type_name),
            messages=sum(map(len, parts)),
            encoding=encoding,
            logged=timing_of(np.sort(np.concatenate(parts))),
        )
        for (name, type_name, encoding), parts in sorted(times.items())
    )
