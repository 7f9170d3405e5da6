"""LiDAR and IMU of a ROS recording: what odometry needs, without camera and poses."""

from __future__ import annotations

import struct
from array import array
from dataclasses import dataclass, replace
from typing import Final, cast

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.conversion.cdr import CdrError
from civil_rgbd.conversion.encodings import READERS
from civil_rgbd.conversion.frame_tree import FrameTree
from civil_rgbd.conversion.gathering import Gathered
from civil_rgbd.conversion.livox import LIVOX_TIME
from civil_rgbd.conversion.point_time import PointTime
from civil_rgbd.conversion.ros_assembly import Opened, point_time_of_scans, stream_of
from civil_rgbd.conversion.ros_choice import (
    choose_lidar,
    damage_of,
    refuse_faults,
    transforms_gathered,
)
from civil_rgbd.conversion.ros_poses import transforms_from
from civil_rgbd.conversion.ros_recording import Payloads, Stream, decoded_scan
from civil_rgbd.conversion.topics import LIVOX_TYPES, Topic, TopicTable, ask_which, plain_type
from civil_rgbd.domain.motion import ImuReadings
from civil_rgbd.domain.recording import RecordingNotes, RecordingOptions, SourceFile
from civil_rgbd.domain.rig import RigFile
from civil_rgbd.domain.scan import LidarScan
from civil_rgbd.errors import RecordingError, UsageError
from civil_rgbd.resources import nearest

IMU_TYPE: Final = "sensor_msgs/Imu"

# Orientation and its covariance come first; then rates, their covariance, and forces.
_IMU: Final = {order: struct.Struct(order + "28d") for order in "<>"}
_RATES, _FORCES = slice(13, 16), slice(25, 28)


class GatheredImu(Gathered):
    """sensor_msgs/Imu: every reading is kept."""

    def __init__(self) -> None:
        super().__init__()
        self._readings = array("d")

    def _look(self, payload: memoryview, stamp_ns: int, header_end: int) -> None:
        del stamp_ns
        at = self.read.aligned(header_end, 8)
        try:
            numbers = _IMU[self.read.order_of(payload)].unpack_from(payload, at)
        except struct.error as error:
            del self._rows[-5:]
            raise CdrError("it ends before its reading does") from error
        self._readings.extend(numbers[_RATES])
        self._readings.extend(numbers[_FORCES])

    def readings(self) -> ImuReadings:
        """Return all of them in message order."""
        rows, order = self._order()
        numbers = np.frombuffer(self._readings).reshape(-1, 6)[order]
        return ImuReadings(
            rows[order, 4].copy(), numbers[:, :3].copy(), numbers[:, 3:].copy(), self.frame
        )


class MotionTable(TopicTable):
    """A table of topics that keeps what the IMU says."""

    def sink_for(self, name: str, type_name: str, encoding: str) -> Gathered | None:
        """Return what takes the messages of one channel; channels of one topic share it."""
        if plain_type(type_name) != IMU_TYPE or encoding not in READERS:
            return super().sink_for(name, type_name, encoding)
        topic = Topic(name, IMU_TYPE, "imu", GatheredImu())
        topic.gathered.read = READERS[encoding]
        return self._topics.setdefault((name, IMU_TYPE), topic).gathered


@dataclass(frozen=True, slots=True, eq=False)
class RosMotion:
    """LiDAR and IMU; fits :class:`civil_rgbd.domain.motion.MotionRecording`.

    Attributes:
        name: the file's stem.
        sources: the files behind it.
        notes: what is odd about it.
        imu: all readings.
        T_imu_lidar: (4, 4) LiDAR frame to IMU frame, from a rig file or tf; None without a link.
        payloads: fetches messages.
        scans: the point clouds.
        point_time: how a PointCloud2's time field is to be read; None for clouds without.
        salvage: go on without clouds that cannot be decoded; they are counted.
    """

    name: str
    sources: tuple[SourceFile, ...]
    notes: RecordingNotes
    imu: ImuReadings
    T_imu_lidar: NDArray[np.float64] | None
    payloads: Payloads
    scans: Stream
    point_time: PointTime | None
    salvage: bool = False

    @property
    def scan_stamps_ns(self) -> NDArray[np.int64]:
        """(S,) header stamps of all LiDAR messages, message order."""
        return self.scans.index.stamps_ns

    @property
    def is_livox(self) -> bool:
        """The LiDAR messages are Livox's own."""
        return self.scans.type_name in LIVOX_TYPES

    def read_scan(self, index: int) -> LidarScan:
        """Decode one LiDAR message.

        Raises:
            RecordingError: the message breaks its own layout, and is not to be left out.
        """
        payload = self.payloads.fetch(*self.scans.index.place(index))
        where = f"{self.sources[0].name}: {self.scans.topic}"
        return decoded_scan(
            self.scans,
            payload,
            index,
            point_time=self.point_time,
            in_map=False,
            salvage=self.salvage,
            where=where,
        )


def assemble_motion(opened: Opened, options: RecordingOptions) -> RosMotion:
    """Put LiDAR and IMU together.

    Args:
        opened: the container, walked with a :class:`MotionTable`.
        options: what the user says about it.

    Raises:
        UsageError: an option does not fit, or one is needed to choose.
        RecordingError: there is no LiDAR or no IMU, or the clouds have no point times.
    """
    table, where = opened.table, opened.where
    lidar = choose_lidar(table, options, where=where)
    imu_topic = _choose_imu(table, options, where)
    imu = cast("GatheredImu", imu_topic.gathered).readings()
    scans = stream_of(lidar)
    point_time = point_time_of_scans(opened, options, scans)
    if point_time is None:
        raise RecordingError(
            "the clouds have no point times, and odometry needs them",
            where=f"{where}: {lidar.name}",
            fix="record the LiDAR with point times, or name their field with --point-time",
        )
    tf = transforms_from(*transforms_gathered(table, options, where=where))
    return RosMotion(
        name=opened.name,
        sources=opened.sources,
        notes=_noted(opened.notes, [lidar, imu_topic, *table.of_role("tf")]),
        imu=imu,
        T_imu_lidar=_T_imu_lidar(options.rig, tf.fixed, imu.frame, lidar.gathered.frame),
        payloads=opened.payloads,
        scans=scans,
        point_time=None if point_time is LIVOX_TIME else point_time,
        salvage=options.salvage,
    )


def _noted(notes: RecordingNotes, used: list[Topic]) -> RecordingNotes:
    damaged, said = damage_of(used)
    return replace(notes, warnings=notes.warnings + said, counts=notes.counts | damaged)


def _choose_imu(table: TopicTable, options: RecordingOptions, where: object) -> Topic:
    found = table.of_role("imu")
    if options.imu_topic is not None:
        known = [topic.name for topic in found]
        found = [topic for topic in found if topic.name == options.imu_topic]
        if not found:
            raise UsageError(
                f"--imu-topic {options.imu_topic!r} names no topic with IMU readings",
                where=where,
                fix=nearest(options.imu_topic, known),
            )
    if len(found) > 1:
        raise ask_which(found, "imu", where=where)
    if not found or not isinstance(found[0].gathered, GatheredImu):
        raise RecordingError(
            "the recording holds no IMU readings",
            where=where,
            fix=f"record {IMU_TYPE}, or compute poses with another tool and give --trajectory",
        )
    refuse_faults(found[0], options, where)
    return found[0]


def _T_imu_lidar(
    rig: RigFile, tf: FrameTree, imu_frame: str, lidar_frame: str
) -> NDArray[np.float64] | None:
    roles = FrameTree()
    for (a, b), T_a_b in rig.extrinsics.items():
        roles.link(a, b, T_a_b)
    found = roles.find("imu", "lidar")
    if found is None and imu_frame and lidar_frame and imu_frame != lidar_frame:
        found = tf.find(imu_frame, lidar_frame)
    return found
