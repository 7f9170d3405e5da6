"""What a container of ROS messages holds: every topic watched while the container is walked.

A converter that walks its container with ``TopicTable.sink_for`` inspects it by walking it with
``WatchedTable.sink_for`` instead, and handing what it found to :func:`summarise`.
"""

from __future__ import annotations

from array import array
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.conversion.cdr import CdrError
from civil_rgbd.conversion.first_messages import camera_facts, cloud_facts, image_facts
from civil_rgbd.conversion.gathering import (
    Gathered,
    GatheredCameraInfo,
    GatheredPoses,
    GatheredTransforms,
)
from civil_rgbd.conversion.ros_assembly import Opened, assemble
from civil_rgbd.conversion.ros_poses import transforms_from
from civil_rgbd.conversion.topics import Topic, TopicTable, plain_type
from civil_rgbd.domain.inspection import (
    RecordingSummary,
    Refusal,
    TopicSummary,
    lateness_drift,
    timing_of,
)
from civil_rgbd.domain.recording import RecordingOptions
from civil_rgbd.errors import CivilRgbdError

_LARGEST_NS = 1 << 63


class Watch:
    """Counts the messages of one topic and keeps their instants; hands them on to what reads them.

    Attributes:
        topic: its name.
        type_name: plain.
        encoding: as the container says.
        gathered: what a build would keep of it; None for what no build reads.
    """

    def __init__(
        self, topic: str, type_name: str, encoding: str, gathered: Gathered | None
    ) -> None:
        self.topic, self.type_name, self.encoding = topic, type_name, encoding
        self.gathered = gathered
        self._rows = array("q")  # log time, stamp
        self._log_only = array("q")
        self.count = 0

    @property
    def head_only(self) -> bool:
        """Whether large messages may come cut."""
        return self.gathered is None or self.gathered.head_only

    def take(self, log_time_ns: int, place: tuple[int, int, int], payload: memoryview) -> None:
        """Take one message."""
        self.count += 1
        if self.gathered is not None:
            self.gathered.take(log_time_ns, place, payload)
        stamp_ns = self._stamp_ns(payload)
        if stamp_ns is None:
            self._log_only.append(log_time_ns % _LARGEST_NS)
        else:
            self._rows.extend((log_time_ns % _LARGEST_NS, stamp_ns))

    def _stamp_ns(self, payload: memoryview) -> int | None:
        if self.gathered is None or isinstance(self.gathered, GatheredTransforms):
            return None
        try:
            return self.gathered.read.stamp_and_frame(payload)[0]
        except CdrError:
            return None  # what was gathered tells of it

    def instants(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return (M, 2) log times and stamps in order of log time, and log times without stamp."""
        rows = np.array(self._rows, dtype=np.int64).reshape(-1, 2)
        return rows[np.argsort(rows[:, 0], kind="stable")], np.array(self._log_only, dtype=np.int64)


class WatchedTable:
    """Every topic of a recording, also those that no build reads.

    Attributes:
        table: the topics that a build reads.
    """

    def __init__(self) -> None:
        self.table = TopicTable()
        self._watches: dict[tuple[str, str, str], Watch] = {}

    def sink_for(self, name: str, type_name: str, encoding: str) -> Watch:
        """Return what takes the messages of one channel; channels of one topic share it."""
        key = name, plain_type(type_name), encoding
        gathered = self.table.sink_for(name, type_name, encoding)
        if key not in self._watches:
            self._watches[key] = Watch(*key, gathered)
        return self._watches[key]

    @property
    def watches(self) -> list[Watch]:
        """All topics, by name and type."""
        return [self._watches[key] for key in sorted(self._watches)]


@dataclass(frozen=True, slots=True)
class Walked:
    """What the walk over a container found.

    Attributes:
        converter: its name.
        name: the file's or folder's name, without folders above it.
        size_bytes: of all files.
        messages: how many could be read.
        damage: what could not, in words.
        remarks: what is odd though nothing is lost.
        refused: why a build does not go on after the walk, with the same options.
    """

    converter: str
    name: str
    size_bytes: int
    messages: int
    damage: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()
    refused: CivilRgbdError | None = None


def summarise(
    watched: WatchedTable, opened: Opened, walked: Walked, options: RecordingOptions
) -> RecordingSummary:
    """Say what a recording holds, and whether a build could open it.

    Args:
        watched: what its messages went through.
        opened: the same, as a build would get it; its table is ``watched.table``.
        walked: what the walk found.
        options: what the user says about the recording.

    Returns:
        the summary; a recording that no build can use is not an error here.
    """
    roles = {
        (topic.name, topic.type_name): topic
        for role in ("lidar", "image", "camera_info", "imu", "pose", "tf")
        for topic in watched.table.of_role(role)
    }
    topics = tuple(
        _topic_summary(watch, roles.get((watch.topic, watch.type_name)), opened, options)
        for watch in watched.watches
    )
    logs = [time for topic in topics if topic.logged for time in _ends(topic)]
    fixed, moving = _links(watched.table)
    refusal, T_lidar_camera, warnings = _tried(opened, options, walked)
    return RecordingSummary(
        name=walked.name,
        converter=walked.converter,
        size_bytes=walked.size_bytes,
        messages=walked.messages,
        logged=timing_of(np.array(logs, dtype=np.int64)),
        topics=topics,
        fixed_links=fixed,
        moving_links=moving,
        damage=walked.damage,
        remarks=walked.remarks,
        refusal=refusal,
        T_lidar_camera=T_lidar_camera,
        warnings=warnings,
    )


def _ends(topic: TopicSummary) -> tuple[int, ...]:
    return (topic.logged.first_ns, topic.logged.last_ns) if topic.logged else ()


def _topic_summary(
    watch: Watch, topic: Topic | None, opened: Opened, options: RecordingOptions
) -> TopicSummary:
    rows, log_only = watch.instants()
    off_ns = rows[:, 0] - rows[:, 1]
    gathered = watch.gathered
    role = topic.role if topic else ""
    first = role in {"lidar", "image"} and topic is not None
    return TopicSummary(
        name=watch.topic,
        type_name=watch.type_name,
        role=role,
        messages=watch.count,
        encoding=watch.encoding,
        logged=timing_of(np.sort(np.concatenate([rows[:, 0], log_only]))),
        stamped=timing_of(rows[:, 1]),
        log_minus_stamp_ns=(
            (int(off_ns.min()), int(np.median(off_ns)), int(off_ns.max())) if len(rows) else None
        ),
        lateness_drift_ns=lateness_drift(rows[:, 0], rows[:, 1]),
        frames=_by_count(gathered.frames) if gathered else (),
        children=_by_count(gathered.children) if isinstance(gathered, GatheredPoses) else (),
        fault=gathered.fault if gathered else None,
        cloud=cloud_facts(topic, opened, options) if first and role == "lidar" and topic else None,
        image=image_facts(topic, opened) if first and role == "image" and topic else None,
        camera=camera_facts(gathered) if isinstance(gathered, GatheredCameraInfo) else None,
    )


def _by_count(counts: dict[str, int]) -> tuple[str, ...]:
    return tuple(sorted(counts, key=lambda name: (-counts[name], name)))


def _links(table: TopicTable) -> tuple[tuple[tuple[str, str], ...], tuple[tuple[str, str], ...]]:
    """Return the links of tf that do not move, and those that do."""
    static: list[GatheredTransforms] = []
    others: list[GatheredTransforms] = []
    for topic in table.of_role("tf"):
        if isinstance(topic.gathered, GatheredTransforms):
            (static if topic.name.endswith("tf_static") else others).append(topic.gathered)
    moving = [(link.parent, link.child) for link in transforms_from(static, others).moving]
    every = {link for gathered in static + others for link in gathered.links}
    return tuple(sorted(every - set(moving))), tuple(sorted(moving))


def _tried(
    opened: Opened, options: RecordingOptions, walked: Walked
) -> tuple[Refusal | None, NDArray[np.float64] | None, tuple[str, ...]]:
    try:
        if walked.refused is not None:
            raise walked.refused
        recording = assemble(opened, options)
    except CivilRgbdError as error:
        return Refusal(error.what, error.where, error.fix), None, ()
    return None, recording.rig.T_lidar_camera, recording.notes.warnings
