"""Writes what an engine reads: a bag with one LiDAR and one IMU, whatever the source was."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.constants import MAX_POINT_TIME_OFFSET_NS
from civil_rgbd.domain.motion import MotionRecording
from civil_rgbd.domain.scan import LidarScan
from civil_rgbd.errors import RecordingError
from civil_rgbd.odometry.engines import IMU_TOPIC, LIDAR_TOPIC, Engine
from civil_rgbd.odometry.imu import SteadyImu
from civil_rgbd.odometry.ros1_messages import (
    CLOUD_TYPE,
    IMU_TYPE,
    LIVOX_TYPE,
    TYPES,
    cloud_message,
    imu_message,
    livox_message,
)
from civil_rgbd.ros1.bag_writer import Ros1BagWriter

Progress = Callable[[int, int], object]
"""Called with scans newly written and scans in all."""

_FEWEST_POINTS = 100


@dataclass(frozen=True, slots=True, eq=False)
class WrittenScans:
    """The scans that an engine is given, in order of time.

    Attributes:
        indices: (S,) int64, which scan of the recording each one is.
        starts_ns: (S,) int64, first point, returned or not.
        ends_ns: (S,) int64, last point.
        dropped: scans that it is not given, by reason.
    """

    indices: NDArray[np.int64]
    starts_ns: NDArray[np.int64]
    ends_ns: NDArray[np.int64]
    dropped: dict[str, int]


@dataclass(frozen=True, slots=True, eq=False)
class _Sweep:
    index: int
    stamps_ns: NDArray[np.int64]
    points_lidar: NDArray[np.float32]


def write_input(
    path: Path,
    recording: MotionRecording,
    imu: SteadyImu,
    engine: Engine,
    *,
    on_progress: Progress = lambda _done, _total: None,
) -> WrittenScans:
    """Write the bag.

    Points come in order of time, after a header with the stamp of the first; those that are not
    finite or doubted by the sensor become (0, 0, 0), which says: no return.

    Args:
        path: the bag; scratch, so not written aside first.
        recording: LiDAR.
        imu: in order, in m/s2.
        engine: it says which kind of cloud it wants.
        on_progress: called scan by scan.

    Returns:
        what was written.

    Raises:
        RecordingError: no scan has an IMU beside it, or a scan is longer than a second.
    """
    dropped: dict[str, int] = {}
    rows: list[tuple[int, int, int]] = []
    encode = livox_message if engine.livox_messages else cloud_message
    cloud_type = LIVOX_TYPE if engine.livox_messages else CLOUD_TYPE
    topics = {IMU_TOPIC: TYPES[IMU_TYPE], LIDAR_TOPIC: TYPES[cloud_type]}
    written = 0
    with path.open("wb") as stream, Ros1BagWriter(stream, topics) as bag:

        def write_imu(until: int) -> None:
            nonlocal written
            for k in range(written, until):
                stamp = int(imu.stamps_ns[k])
                payload = imu_message(stamp, imu.rates_rad_s[k], imu.forces_m_s2[k])
                bag.write(IMU_TOPIC, stamp, payload)
            written = max(written, until)

        for sweep in _sweeps(recording, imu, dropped, on_progress):
            start, end = int(sweep.stamps_ns[0]), int(sweep.stamps_ns[-1])
            write_imu(int(np.searchsorted(imu.stamps_ns, end, side="right")))
            offsets = sweep.stamps_ns - start
            bag.write(LIDAR_TOPIC, end, encode(start, sweep.points_lidar, offsets))
            rows.append((sweep.index, start, end))
        write_imu(len(imu.stamps_ns))
    if not rows:
        raise RecordingError(
            f"no scan can be used: {dropped}; the IMU covers {imu.stamps_ns[0] / 1e9:.3f} to "
            f"{imu.stamps_ns[-1] / 1e9:.3f} s, the LiDAR {_span(recording)}",
            where=recording.name,
            fix="record LiDAR and IMU on one clock, at the same time",
        )
    table = np.array(rows, dtype=np.int64)
    return WrittenScans(table[:, 0], table[:, 1], table[:, 2], dropped)


def _sweeps(
    recording: MotionRecording, imu: SteadyImu, dropped: dict[str, int], on_progress: Progress
) -> Iterator[_Sweep]:
    """Yield the scans that can be used, in order of time; count the others."""
    order = np.argsort(recording.scan_stamps_ns, kind="stable").tolist()
    last_end = int(imu.stamps_ns[0])
    for index in order:
        on_progress(1, len(order))
        scan = recording.read_scan(index)
        sweep, reason = _usable(index, scan), None
        if scan.unreadable:
            reason = "scan-undecodable"
        elif (sweep.points_lidar != 0).any(axis=1).sum() < _FEWEST_POINTS:
            reason = "scan-with-few-returns"
        elif sweep.stamps_ns[0] < imu.stamps_ns[0] or sweep.stamps_ns[-1] > imu.stamps_ns[-1]:
            reason = "scan-without-imu"
        elif sweep.stamps_ns[-1] <= last_end:
            reason = "scan-repeated"
        if reason:
            dropped[reason] = dropped.get(reason, 0) + 1
            continue
        if sweep.stamps_ns[-1] - sweep.stamps_ns[0] > MAX_POINT_TIME_OFFSET_NS:
            raise RecordingError(
                f"scan {index} lasts "
                f"{(int(sweep.stamps_ns[-1]) - int(sweep.stamps_ns[0])) / 1e9:.3f} s",
                where=recording.name,
                fix="say what the point times mean with --point-time; a sweep lasts 0.1 s or so",
            )
        last_end = int(sweep.stamps_ns[-1])
        yield sweep


def _usable(index: int, scan: LidarScan) -> _Sweep:
    stamps = scan.point_stamps_ns
    if stamps is None:
        stamps = np.full(len(scan.points), scan.stamp_ns, dtype=np.int64)
    # What is no return stays in as (0, 0, 0), as sensors write it: engines tell a scan's span by
    # all of its points, and take a scan under half a sky for a shorter one otherwise.
    points = np.where(returns(scan)[:, np.newaxis], scan.points, 0.0).astype(np.float32)
    order = np.argsort(stamps, kind="stable")
    return _Sweep(index, stamps[order], points[order])


def returns(scan: LidarScan) -> NDArray[np.bool_]:
    """Tell which points of a scan are returns that the sensor stands by: (N,) bool."""
    finite = np.isfinite(scan.points).all(axis=1)
    keep: NDArray[np.bool_] = finite & (scan.points != 0).any(axis=1)
    return keep if scan.noise is None else keep & ~scan.noise


def _span(recording: MotionRecording) -> str:
    stamps = recording.scan_stamps_ns
    return f"{stamps.min() / 1e9:.3f} to {stamps.max() / 1e9:.3f} s" if len(stamps) else "nothing"
