"""LVX 1.1 and LVX2: every data type, devices that are mounted, clocks, and damage."""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from civil_rgbd.conversion.lvx import _judged, _walked, open_motion, open_recording
from civil_rgbd.conversion.lvx_scans import Index
from civil_rgbd.domain.recording import RecordingOptions
from civil_rgbd.domain.rig import RigFile
from civil_rgbd.errors import RecordingError, UsageError

from . import lvx_writer
from .lvx_writer import INTERVAL_NS, Packet, cartesian, device, file_bytes

START_NS = 5_000_000_000


def xyz(count: int = 96, seed: int = 0) -> NDArray[np.float64]:
    points = np.random.default_rng(seed).normal(size=(count, 3)) * 10
    points[0] = 0  # no return
    return np.round(points, 3)


def opened(tmp_path: Path, data: bytes, **options: object) -> Index:
    path = tmp_path / "a.lvx"
    path.write_bytes(data)
    return _judged(_walked(path), RecordingOptions(**options))[0]  # type: ignore[arg-type]  # by name


def frames(count: int = 3, **more: int) -> list[list[Packet]]:
    step = 96 * INTERVAL_NS
    return [
        [
            Packet(START_NS + (f * 2 + p) * step, cartesian(xyz(seed=f * 2 + p)), **more)
            for p in range(2)
        ]
        for f in range(count)
    ]


class TestDataTypes:
    def test_points_have_millimetres_tags_and_times(self, tmp_path: Path) -> None:
        tags = [0b0001, 0b0100, 0b00010000] + [0] * 93
        packets = [
            Packet(START_NS, cartesian(xyz(), tags)),
            Packet(START_NS + 500_000, cartesian(xyz(seed=1))),
        ]
        scan = opened(tmp_path, file_bytes([packets])).scans.read(0)
        assert scan.points.dtype == np.float32
        np.testing.assert_array_equal(scan.points[:96], xyz().astype(np.float32))
        assert scan.points[0].tolist() == [0, 0, 0]
        assert scan.point_stamps_ns is not None
        assert scan.point_stamps_ns[:3].tolist() == [START_NS + i * INTERVAL_NS for i in range(3)]
        assert scan.point_stamps_ns[96] == START_NS + 500_000
        assert scan.noise is not None
        assert np.flatnonzero(scan.noise).tolist() == [0, 1]  # a return's number is no noise

    @pytest.mark.parametrize(("kind", "returns"), [(4, 2), (7, 3)])
    def test_returns_of_one_beam_share_its_time(
        self, tmp_path: Path, kind: int, returns: int
    ) -> None:
        count = {4: 48, 7: 30}[kind]
        payload = cartesian(xyz(count * returns))
        index = opened(tmp_path, file_bytes([[Packet(START_NS, payload, kind=kind)]]))
        scan = index.scans.read(0)
        assert scan.point_stamps_ns is not None
        assert len(scan.points) == count * returns
        expected = START_NS + np.repeat(np.arange(count), returns) * INTERVAL_NS
        np.testing.assert_array_equal(scan.point_stamps_ns, expected)
        assert index.scans.reach_ns[1] >= (count - 1) * INTERVAL_NS

    def test_points_without_tags_know_no_noise(self, tmp_path: Path) -> None:
        items = np.zeros(100, dtype=np.dtype([("xyz", "<i4", 3), ("reflectivity", "u1")]))
        items["xyz"] = lvx_writer.mm(xyz(100))
        scan = opened(
            tmp_path, file_bytes([[Packet(START_NS, items.tobytes(), kind=0)]])
        ).scans.read(0)
        np.testing.assert_array_equal(scan.points, xyz(100).astype(np.float32))
        assert scan.noise is None

    @pytest.mark.parametrize(
        ("kind", "count", "returns"), [(1, 100, 1), (3, 96, 1), (5, 48, 2), (8, 30, 3)]
    )
    def test_spherical_points_are_turned_to_cartesian_ones(
        self, tmp_path: Path, kind: int, count: int, returns: int
    ) -> None:
        rng = np.random.default_rng(kind)
        theta, phi = rng.integers(0, 18001, count), rng.integers(0, 36001, count)
        depth = rng.integers(0, 60_000, (count, returns))
        payload = b""
        for at in range(count):
            if returns == 1:
                payload += struct.pack("<IHHB", depth[at, 0], theta[at], phi[at], 9)
                payload += b"\x04" if kind == 3 else b""
            else:
                payload += struct.pack("<HH", theta[at], phi[at])
                payload += b"".join(struct.pack("<IBB", d, 9, 4) for d in depth[at])
        scan = opened(tmp_path, file_bytes([[Packet(START_NS, payload, kind=kind)]])).scans.read(0)
        t, p = (np.repeat(a / 100 * math.pi / 180, returns) for a in (theta, phi))
        expected = np.stack([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)], axis=1)
        expected *= depth.reshape(-1, 1) / 1000
        np.testing.assert_allclose(scan.points, expected, atol=1e-5)
        assert (scan.noise is None) == (kind == 1)
        assert scan.noise is None or scan.noise.all()

    def test_packets_of_several_types_share_a_frame(self, tmp_path: Path) -> None:
        imu = Packet(START_NS, struct.pack("<6f", *range(6)), kind=6)
        dual = Packet(START_NS + 400_000, cartesian(xyz(96, 5)), kind=4)
        single = Packet(START_NS + 800_000, cartesian(xyz(96, 6)))
        index = opened(tmp_path, file_bytes([[imu, dual, imu, single, imu]]))
        scan = index.scans.read(0)
        assert len(scan.points) == 192
        assert index.counts == {}
        assert index.scans.stamps_ns.tolist() == [START_NS + 400_000]

    def test_lvx2_has_points_in_millimetres_and_in_centimetres(self, tmp_path: Path) -> None:
        small = np.zeros(96, np.dtype([("xyz", "<i2", 3), ("reflectivity", "u1"), ("tag", "u1")]))
        small["xyz"] = np.rint(xyz(seed=1) * 100)
        packets = [
            Packet(START_NS, cartesian(xyz()), kind=1),
            Packet(START_NS + 480_000, small.tobytes(), kind=2),
            Packet(START_NS + 960_000, cartesian(xyz(seed=2)), kind=1),
        ]
        index = opened(tmp_path, file_bytes([packets], second=True))
        assert index.scans.device.name == "Livox Mid-360"
        assert index.scans.interval_ns == 5000  # measured: the file does not say it
        points, groups = index.scans.read(0), (0, 2, 1)  # by data type
        for at, seed in enumerate(groups):
            found = points.points[at * 96 : at * 96 + 96]
            step = 0.0051 if seed == 1 else 1e-6
            np.testing.assert_allclose(found, xyz(seed=seed), atol=step)


class TestDevices:
    def test_enabled_extrinsics_move_returns_and_are_reported(self, tmp_path: Path) -> None:
        mounted = device(extrinsics=(0.0, 0.0, 90.0, 1.0, 2.0, 3.0))
        index = opened(tmp_path, file_bytes(frames(1), devices=[mounted]))
        scan = index.scans.read(0)
        raw = xyz()
        np.testing.assert_allclose(
            scan.points[1:96],
            np.stack([1 - raw[1:, 1], 2 + raw[1:, 0], 3 + raw[1:, 2]], 1),
            atol=1e-5,
        )
        assert scan.points[0].tolist() == [0, 0, 0]  # still no return
        assert "x 1.000, y 2.000, z 3.000 m" in index.warnings[0]

    def test_disabled_extrinsics_and_zeros_move_nothing(self, tmp_path: Path) -> None:
        for mounted in (device(), device(extrinsics=(0.0,) * 6)):
            index = opened(tmp_path, file_bytes(frames(1), devices=[mounted]))
            assert index.warnings == ()
            np.testing.assert_array_equal(index.scans.read(0).points[:96], xyz().astype(np.float32))

    def test_one_of_several_is_chosen_by_its_number(self, tmp_path: Path) -> None:
        devices = [device(index=0, code="AAA"), device(index=1, code="BBB", kind=6)]
        both = [[*a, *b] for a, b in zip(frames(), frames(device=1), strict=True)]
        data = file_bytes(both, devices=devices)
        with pytest.raises(UsageError, match=r"AAA \(Livox Avia\), BBB \(Livox Mid-70\)") as caught:
            opened(tmp_path, data)
        assert "--lidar-topic AAA" in caught.value.fix
        assert opened(tmp_path, data, lidar_topic="BBB").scans.interval_ns == 10_000
        assert len(opened(tmp_path, data, lidar_topic="AAA").scans.read(0).points) == 192
        with pytest.raises(UsageError, match="names no device"):
            opened(tmp_path, data, lidar_topic="BBA")


class TestClocks:
    def test_gps_time_is_a_date_an_hour_and_microseconds(self, tmp_path: Path) -> None:
        stamp = struct.pack("<BBBBI", 23, 11, 14, 22, 800_000_123)  # 22:13:20.000123
        packets = [Packet(stamp, cartesian(xyz()), stamp_type=3)]
        index = opened(tmp_path, file_bytes([packets]))
        assert index.scans.stamps_ns.tolist() == [1_700_000_000_000_123_000]

    def test_a_date_that_is_none_is_damage(self, tmp_path: Path) -> None:
        stamp = struct.pack("<BBBBI", 23, 13, 40, 22, 0)
        packets = [Packet(stamp, cartesian(xyz()), stamp_type=3)]
        with pytest.raises(RecordingError, match=r"month must be in"):
            opened(tmp_path, file_bytes([*frames(1), packets]))

    @pytest.mark.parametrize("how", ["back", "type"])
    def test_a_clock_that_changes_is_refused(self, tmp_path: Path, how: str) -> None:
        later = frames(2)
        if how == "back":
            later = later[::-1]
        else:
            later[1] = [Packet(p.stamp, p.payload, stamp_type=1) for p in later[1]]
        with pytest.raises(RecordingError, match="clock changed while it recorded") as caught:
            opened(tmp_path, file_bytes(later))
        assert "PTP" in caught.value.fix
        assert "--salvage" in caught.value.fix

    def test_points_of_every_frame_lie_within_the_reach(self, tmp_path: Path) -> None:
        scans = opened(tmp_path, file_bytes(frames())).scans
        for at in range(3):
            scan = scans.read(at)
            assert scan.start_ns == scan.stamp_ns
            assert scan.end_ns - scan.stamp_ns <= scans.reach_ns[1]


class TestDamage:
    def test_a_cut_file_is_refused_and_salvaged(self, tmp_path: Path) -> None:
        data = file_bytes(frames())
        cut = data[:-700]  # inside the last packet of three frames of two
        with pytest.raises(RecordingError, match="frame 2 should end at byte") as caught:
            opened(tmp_path, cut)
        assert "--salvage" in caught.value.fix
        index = opened(tmp_path, cut, salvage=True)
        assert [len(index.scans.read(at).points) for at in range(3)] == [192, 192, 96]

    def test_a_cut_inside_a_frames_header_keeps_what_is_before(self, tmp_path: Path) -> None:
        data = file_bytes(frames())
        last = lvx_writer.frame_starts(data)[-1]
        index = opened(tmp_path, data[: last + 10], salvage=True)
        assert len(index.scans.stamps_ns) == 2
        assert index.salvage is not None
        assert "inside the header of frame 2" in index.salvage

    def test_a_last_frame_that_names_no_next_one_is_whole(self, tmp_path: Path) -> None:
        data = bytearray(file_bytes(frames()))
        last = lvx_writer.frame_starts(data)[-1]
        struct.pack_into("<Q", data, last + 8, 0)
        assert opened(tmp_path, bytes(data)).salvage is None

    @pytest.mark.parametrize("lie", [1, 2**63, 2**64 - 1])
    def test_an_offset_that_lies_is_damage(self, tmp_path: Path, lie: int) -> None:
        data = bytearray(file_bytes(frames()))
        second = lvx_writer.frame_starts(data)[1]
        struct.pack_into("<Q", data, second + 8, lie)
        with pytest.raises(RecordingError, match="frame 1 "):
            opened(tmp_path, bytes(data))
        kept = opened(tmp_path, bytes(data), salvage=True).scans
        assert len(kept.read(0).points) == 192  # what lies before is whole

    @pytest.mark.parametrize("field", [0, 8])
    @pytest.mark.parametrize("lie", [1, 2**40, -30])
    def test_frames_behind_a_broken_header_are_kept(
        self, tmp_path: Path, field: int, lie: int
    ) -> None:
        data = bytearray(file_bytes(frames(6)))
        starts = lvx_writer.frame_starts(data)
        value = starts[4] + 30 if lie < 0 else lie
        struct.pack_into("<Q", data, starts[2] + field, value)
        kept = opened(tmp_path, bytes(data), salvage=True)
        found = [kept.scans.read(at) for at in range(len(kept.scans.stamps_ns))]
        whole = 6 if field else 5  # of a frame with a wrong end the points are still known
        assert [len(scan.points) for scan in found] == [192] * whole
        assert found[-1].stamp_ns == START_NS + 10 * 96 * INTERVAL_NS
        assert kept.salvage is not None
        assert "frame 2 " in kept.salvage

    def test_a_hole_costs_the_frames_it_touches(self, tmp_path: Path) -> None:
        data = bytearray(file_bytes(frames(6)))
        starts = lvx_writer.frame_starts(data)
        data[starts[2] + 900 : starts[3] + 100] = bytes(starts[3] - starts[2] - 800)
        with pytest.raises(RecordingError, match="the recording is damaged") as caught:
            opened(tmp_path, bytes(data))
        assert "--salvage" in caught.value.fix
        kept = opened(tmp_path, bytes(data), salvage=True).scans
        assert len(kept.stamps_ns) in (4, 5)
        assert len(kept.read(len(kept.stamps_ns) - 1).points) == 192

    @pytest.mark.parametrize("to", ["the end", "frame 5", "no frame"])
    def test_a_frame_that_leaves_frames_out_is_cut_where_they_begin(
        self, tmp_path: Path, to: str
    ) -> None:
        data = bytearray(file_bytes(frames(6)))
        starts = lvx_writer.frame_starts(data)
        lie = {"the end": len(data), "frame 5": starts[5], "no frame": 0}[to]
        struct.pack_into("<Q", data, starts[0] + 8, lie)
        with pytest.raises(RecordingError, match="frame 0 should end at byte"):
            opened(tmp_path, bytes(data))
        kept = opened(tmp_path, bytes(data), salvage=True).scans
        assert [len(kept.read(at).points) for at in range(6)] == [192] * 6

    def test_zeros_are_no_packets_of_another_clock(self, tmp_path: Path) -> None:
        data = bytearray(file_bytes(frames(6, stamp_type=1)))
        starts = lvx_writer.frame_starts(data)
        first = starts[2] + 24 + 19 + 96 * 14  # the second packet of frame 2 and all of frame 3
        data[first : starts[4]] = bytes(starts[4] - first)
        with pytest.raises(RecordingError, match="the recording is damaged") as caught:
            opened(tmp_path, bytes(data))
        assert "--salvage" in caught.value.fix
        kept = opened(tmp_path, bytes(data), salvage=True)
        whole = [START_NS + f * 2 * 96 * INTERVAL_NS for f in (0, 1, 4, 5)]
        assert kept.scans.stamps_ns.tolist() == whole
        assert kept.salvage is not None
        assert "1 frame is left out" in kept.salvage

    def test_a_flipped_kind_of_stamp_costs_its_frame(self, tmp_path: Path) -> None:
        content = frames(6, stamp_type=1)
        odd = content[2][1]
        content[2][1] = Packet(odd.stamp, odd.payload, stamp_type=9)
        with pytest.raises(RecordingError, match="frame 2 has stamps of another type") as caught:
            opened(tmp_path, file_bytes(content))
        assert "--salvage" in caught.value.fix
        kept = opened(tmp_path, file_bytes(content), salvage=True)
        assert len(kept.scans.stamps_ns) == 5
        assert kept.counts == {"scan-stamp-astray": 1}

    def test_a_stamp_that_is_astray_costs_its_frame(self, tmp_path: Path) -> None:
        content = frames(6)
        content[3] = [Packet(START_NS + 10**12, p.payload) for p in content[3]]
        content[4][1] = Packet(START_NS + 10**13, content[4][1].payload)
        with pytest.raises(RecordingError, match=r"clock changed|one frame spans") as caught:
            opened(tmp_path, file_bytes(content))
        assert "go on without the frames that do not fit: --salvage" in caught.value.fix
        kept = opened(tmp_path, file_bytes(content), salvage=True)
        assert len(kept.scans.stamps_ns) == 4
        assert (np.diff(kept.scans.stamps_ns) > 0).all()
        assert kept.counts == {"scan-stamp-astray": 2}
        assert kept.salvage is not None
        assert kept.scans.reach_ns[1] < 10**9

    def test_a_frame_of_half_points_is_left_out_under_salvage(self, tmp_path: Path) -> None:
        content = [[Packet(START_NS + f * 10**8, cartesian(xyz(96, f)), kind=1)] for f in range(3)]
        content[1] = [Packet(START_NS + 10**8, cartesian(xyz(96, 1))[:-5], kind=1)]
        data = file_bytes(content, second=True)
        with pytest.raises(RecordingError, match="frame 1 breaks its own layout") as caught:
            opened(tmp_path, data).scans.read(1)
        assert "--salvage" in caught.value.fix
        kept = opened(tmp_path, data, salvage=True).scans
        assert kept.read(1).unreadable
        assert len(kept.read(2).points) == 96

    def test_an_unknown_data_type_is_damage(self, tmp_path: Path) -> None:
        packets = frames(2)
        packets[1].append(Packet(START_NS + 10**6, b"\0" * 20, kind=77))
        with pytest.raises(RecordingError, match=r"a packet of frame 1 at byte .* is broken"):
            opened(tmp_path, file_bytes(packets))

    @pytest.mark.parametrize(
        ("data", "words"),
        [
            (b"", "no LVX file"),
            (b"livox_tech", "no LVX file"),
            (b"a shopping list, longer than any header", "no LVX file: .*b'a shopping'"),
            (file_bytes(frames(), version=(1, 0)), "version 1.0; 1.1 and 2.0"),
            (file_bytes(frames(), version=(3, 0)), "version 3.0"),
            (file_bytes([]), "holds no points"),
            (file_bytes([])[:50], "ends inside its header: 1 devices"),
            (file_bytes(frames(device=9)), "a packet of frame 0 at byte 112 is broken"),
        ],
    )
    def test_what_is_none_of_ours_is_refused(self, tmp_path: Path, data: bytes, words: str) -> None:
        with pytest.raises(RecordingError, match=words):
            opened(tmp_path, data)


class TestBeside:
    @pytest.mark.parametrize(
        ("options", "words"),
        [
            ({}, "holds no poses"),
            ({"scans_in": "map"}, "in its own frame"),
            ({"image_topic": "/a"}, "--image-topic chooses nothing"),
            ({"point_time": "t:ns:header"}, "--point-time chooses nothing"),
        ],
    )
    def test_what_does_not_fit_is_refused(
        self, tmp_path: Path, options: dict[str, str], words: str
    ) -> None:
        (tmp_path / "a.lvx").write_bytes(file_bytes(frames()))
        with pytest.raises(UsageError, match=words):
            open_recording(tmp_path / "a.lvx", RecordingOptions(**options))  # type: ignore[arg-type]  # by name

    def test_the_imu_comes_along_for_odometry(self, tmp_path: Path) -> None:
        readings: Sequence[Packet] = [
            Packet(START_NS + at * 5_000_000, struct.pack("<6f", 0.1, 0.2, 0.3, 0, at, 1), kind=6)
            for at in range(4)
        ]
        (tmp_path / "a.lvx").write_bytes(file_bytes([[*readings[:2], *f] for f in frames(1)]))
        T_imu_lidar = np.eye(4)
        options = RecordingOptions(rig=RigFile(extrinsics={("imu", "lidar"): T_imu_lidar}))
        motion = open_motion(tmp_path / "a.lvx", options)
        assert motion.imu.stamps_ns.tolist() == [START_NS, START_NS + 5_000_000]
        assert motion.imu.forces.tolist() == [[0, 0, 1], [0, 1, 1]]
        np.testing.assert_allclose(motion.imu.rates_rad_s[0], [0.1, 0.2, 0.3], rtol=1e-6)
        assert motion.is_livox
        assert motion.T_imu_lidar is not None
        (tmp_path / "b.lvx").write_bytes(file_bytes(frames(1)))
        with pytest.raises(RecordingError, match="no IMU readings"):
            open_motion(tmp_path / "b.lvx", options)
