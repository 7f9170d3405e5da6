"""The bag that engines read: read back by rosbags and by our own converter."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from civil_rgbd.converters import open_motion
from civil_rgbd.domain.scan import LidarScan
from civil_rgbd.errors import RecordingError
from civil_rgbd.odometry.engines import ENGINES
from civil_rgbd.odometry.imu import steady_imu
from civil_rgbd.odometry.input_bag import WrittenScans, write_input

from .walks import ROOM, SECOND, Walk, last_offset


@dataclass(frozen=True, eq=False)
class Tampered(Walk):
    """Scan 2 carries points of all kinds, scan 3 nothing, scan 4 repeats scan 1."""

    def read_scan(self, index: int) -> LidarScan:
        if index == 4:
            return super().read_scan(1)
        scan = super().read_scan(index)
        if index == 2 and scan.noise is not None and scan.point_stamps_ns is not None:
            scan.points[0] = np.nan
            scan.noise[1] = True
            order = np.roll(np.arange(len(scan.points)), 7)
            return LidarScan(
                scan.stamp_ns, scan.points[order], scan.point_stamps_ns[order], scan.noise[order]
            )
        if index == 3:
            scan.points[:] = 0
        return scan


def written(path: Path, walk: Walk, engine: str = "genz-lio") -> WrittenScans:
    imu = steady_imu(walk.imu, where="imu")
    return write_input(path, walk, imu, ENGINES[engine])


@pytest.mark.parametrize("engine", ["genz-lio", "se3-lio"])
def test_our_own_converter_reads_back_what_was_written(tmp_path: Path, engine: str) -> None:
    walk = Walk(ROOM, seconds=1.0, force_unit=1.0)

    scans = written(tmp_path / "scan.bag", walk, engine)

    back = open_motion(tmp_path / "scan.bag")
    assert back.is_livox == (engine == "genz-lio")
    assert np.array_equal(back.imu.stamps_ns, walk.imu.stamps_ns)
    assert back.imu.forces[:, 2] == pytest.approx(9.80665)
    assert np.array_equal(back.scan_stamps_ns, walk.scan_stamps_ns)
    assert np.array_equal(scans.ends_ns, walk.scan_stamps_ns + last_offset())
    for index in range(10):
        got, put = back.read_scan(index), walk.read_scan(index)
        assert np.array_equal(got.points, put.points)
        assert got.point_stamps_ns is not None
        assert put.point_stamps_ns is not None
        assert np.array_equal(got.point_stamps_ns, put.point_stamps_ns)
        assert got.noise is None or not got.noise.any()


@pytest.mark.parametrize("engine", ["genz-lio", "se3-lio"])
def test_rosbags_reads_it_with_the_imu_before_the_scan_it_belongs_to(
    tmp_path: Path, engine: str
) -> None:
    highlevel = pytest.importorskip("rosbags.highlevel", reason="the peer is not installed")
    walk = Walk(ROOM, seconds=1.0)
    written(tmp_path / "scan.bag", walk, engine)

    with highlevel.AnyReader([tmp_path / "scan.bag"]) as reader:
        counts = {c.topic: c.msgcount for c in reader.connections}
        times = [(c.topic, stamp) for c, stamp, _ in reader.messages()]
        for connection, _, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            if connection.topic == "/imu":
                assert message.linear_acceleration.z == pytest.approx(9.80665)

    assert counts == {"/imu": 201, "/lidar": 10}
    assert [stamp for _, stamp in times] == sorted(stamp for _, stamp in times)


@dataclass(frozen=True, eq=False)
class Damaged(Walk):
    """A walk with one message that is left out."""

    def read_scan(self, index: int) -> LidarScan:
        scan = super().read_scan(index)
        return LidarScan.lost(scan.stamp_ns) if index == 4 else scan


def test_a_damaged_scan_is_counted_as_such(tmp_path: Path) -> None:
    scans = written(tmp_path / "scan.bag", Damaged(ROOM, seconds=1.0))

    assert scans.dropped == {"scan-undecodable": 1}
    assert 4 not in scans.indices
    assert len(open_motion(tmp_path / "scan.bag").scan_stamps_ns) == 9


def test_points_without_a_return_stay_in_as_zeros_and_in_order(tmp_path: Path) -> None:
    walk = Tampered(ROOM, seconds=1.0)

    scans = written(tmp_path / "scan.bag", walk)

    back = open_motion(tmp_path / "scan.bag").read_scan(2)
    true = Walk(ROOM, seconds=1.0).read_scan(2)
    assert (back.points[:2] == 0).all()
    assert np.array_equal(back.points[2:], true.points[2:])
    assert scans.dropped == {"scan-with-few-returns": 1, "scan-repeated": 1}
    assert scans.indices.tolist() == [0, 1, 2, 5, 6, 7, 8, 9]


def test_scans_that_the_imu_does_not_cover_are_counted(tmp_path: Path) -> None:
    walk = Walk(ROOM, seconds=1.0)
    imu = steady_imu(walk.imu, where="imu")
    late = type(imu)(imu.stamps_ns + SECOND // 4, imu.rates_rad_s, imu.forces_m_s2, imu.unit)

    scans = write_input(tmp_path / "scan.bag", walk, late, ENGINES["genz-lio"])

    assert scans.dropped == {"scan-without-imu": 3}


def test_clocks_that_never_meet_are_refused(tmp_path: Path) -> None:
    walk = Walk(ROOM, seconds=1.0)
    imu = steady_imu(walk.imu, where="imu")
    never = type(imu)(imu.stamps_ns - 1000 * SECOND, imu.rates_rad_s, imu.forces_m_s2, imu.unit)

    with pytest.raises(RecordingError, match="no scan can be used") as info:
        write_input(tmp_path / "scan.bag", walk, never, ENGINES["genz-lio"])

    assert "one clock" in info.value.fix
