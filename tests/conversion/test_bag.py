"""ROS 1 bags: whole in every form, without index, and damaged."""

from __future__ import annotations

import hashlib
import pickle
import struct
from itertools import permutations
from pathlib import Path

import numpy as np
import pytest

from civil_rgbd.conversion.bag import BAG, inspect_recording, open_motion, open_recording
from civil_rgbd.conversion.several_files import walk_files
from civil_rgbd.domain.recording import Recording, RecordingOptions
from civil_rgbd.errors import RecordingError, UsageError
from civil_rgbd.trajectories.rig import read_rig

from . import containers, messages, scene
from .test_mcap import _rig

SALVAGE = RecordingOptions(salvage=True)
COMPRESSIONS = sorted(containers.COMPRESSORS)
MESSAGES = scene.flat(scene.whole())


def bag(folder: Path, **how: object) -> Path:
    path = folder / "bridge.bag"
    path.write_bytes(containers.bag_by_hand(MESSAGES, **how))  # type: ignore[arg-type]
    return path


def assert_same(found: Recording, expected: Recording) -> None:
    assert np.array_equal(found.image_stamps_ns, expected.image_stamps_ns)
    assert np.array_equal(found.scan_stamps_ns, expected.scan_stamps_ns)
    assert np.array_equal(found.trajectory.stamps_ns, expected.trajectory.stamps_ns)
    assert np.array_equal(found.trajectory.translations_m, expected.trajectory.translations_m)
    assert np.array_equal(found.rig.T_body_camera, expected.rig.T_body_camera)
    assert found.rig.camera == expected.rig.camera
    for index in (0, 11, 19):
        assert np.array_equal(found.read_scan(index).points, expected.read_scan(index).points)
        assert np.array_equal(found.read_image(index).rgb, expected.read_image(index).rgb)


@pytest.fixture(scope="module")
def expected(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    from civil_rgbd.conversion import mcap

    return mcap.open_recording(scene.write(tmp_path_factory.mktemp("e") / "a.mcap", scene.whole()))


@pytest.mark.parametrize("compression", COMPRESSIONS)
def test_a_bag_of_another_writer_is_read(
    tmp_path: Path, expected: Recording, compression: str
) -> None:
    path = containers.write_bag(tmp_path / "bridge.bag", MESSAGES, compression=compression)
    opened = open_recording(path)

    assert_same(opened, expected)
    assert opened.name == "bridge"
    assert opened.notes == expected.notes
    (source,) = opened.sources
    assert (source.name, source.converter) == ("bridge.bag", "bag")
    assert source.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()


@pytest.mark.parametrize("compression", COMPRESSIONS)
@pytest.mark.parametrize("order", list(permutations(("conn", "op", "time"))))
def test_header_fields_come_in_any_order(
    tmp_path: Path, expected: Recording, compression: str, order: tuple[str, ...]
) -> None:
    assert_same(open_recording(bag(tmp_path, compression=compression, order=order)), expected)


@pytest.mark.parametrize("compression", COMPRESSIONS)
def test_header_fields_that_nobody_knows_are_stepped_over(
    tmp_path: Path, expected: Recording, compression: str
) -> None:
    path = bag(tmp_path, compression=compression, more_fields=[("latching", b"1")])
    assert_same(open_recording(path), expected)


@pytest.mark.parametrize("compression", COMPRESSIONS)
def test_a_bag_without_index_is_read_and_remarked(
    tmp_path: Path, expected: Recording, compression: str
) -> None:
    path = bag(tmp_path, compression=compression, index=False)
    active = path.rename(tmp_path / "bridge.bag.active")
    opened = open_recording(active)

    assert_same(opened, expected)
    assert opened.name == "bridge"
    assert "no index" in opened.notes.warnings[0]


@pytest.mark.parametrize("compression", COMPRESSIONS)
def test_the_chunk_that_a_killed_recorder_left_open_is_read(
    tmp_path: Path, expected: Recording, compression: str
) -> None:
    path = bag(tmp_path, compression=compression, index=False, last_chunk_open=True)

    assert_same(open_recording(path, SALVAGE), expected)


def test_a_pickled_recording_reads_on_in_another_process(tmp_path: Path) -> None:
    opened = open_recording(bag(tmp_path, compression="lz4"))
    opened.read_scan(4)
    travelled = pickle.loads(pickle.dumps(opened))  # noqa: S301 - our own bytes

    assert np.array_equal(travelled.read_scan(4).points, opened.read_scan(4).points)
    assert len(pickle.dumps(opened)) < 10_000


@pytest.mark.parametrize("package", ["livox_ros_driver", "livox_ros_driver2"])
def test_livox_messages_of_ros_1_have_points_of_19_bytes(tmp_path: Path, package: str) -> None:
    points = [(7 * i, 1.5 * i, 2.0, -0.25 * i, i, 0x12 if i % 2 else 0x10, i % 6) for i in range(9)]
    parts = scene.whole()
    parts["scans"] = [
        scene.Message(
            scene.LIDAR,
            f"{package}/msg/CustomMsg",
            scene.stamp(i),
            messages.custom_msg(scene.stamp(i), points[: i % 10], frame="lidar"),
        )
        for i in range(scene.SCANS)
    ]
    path = containers.write_bag(tmp_path / "a.bag", scene.flat(parts))
    opened = open_recording(path)

    scan = opened.read_scan(9)
    assert scan.points.tolist() == [list(point[1:4]) for point in points]
    assert scan.point_stamps_ns is not None
    assert scan.point_stamps_ns.tolist() == [scene.stamp(9) + 7 * i for i in range(9)]
    assert scan.noise is not None
    assert scan.noise.tolist() == [bool(i % 2) for i in range(9)]
    assert len(opened.read_scan(10).points) == 0
    assert opened.notes.deskew == "per_point"
    assert opened.notes.warnings == ()  # the timebase was found, and is the header's stamp


def test_poses_paths_and_tf_of_ros_1(tmp_path: Path) -> None:
    parts = scene.whole()
    last = scene.stamp(scene.SCANS)
    way = [(scene.stamp(i), (0.1 * i, 0, 0, 0, 0, 0, 1)) for i in range(scene.SCANS + 1)]
    parts["poses"] = [
        scene.Message("/path", "nav_msgs/msg/Path", last, messages.path(last, way)),
        *(
            scene.Message(
                "/pose",
                "geometry_msgs/msg/PoseStamped",
                at,
                messages.pose_stamped(at, (0, 0.2 * i, 0, 0, 0, 0, 1)),
            )
            for i, (at, _) in enumerate(way)
        ),
        *(
            scene.Message(
                "/tf",
                "tf2_msgs/msg/TFMessage",
                at,
                messages.transforms([(at, "odom", "lidar", (0, 0, 0.3 * i, 0, 0, 0, 1))]),
            )
            for i, (at, _) in enumerate(way)
        ),
    ]
    path = containers.write_bag(tmp_path / "a.bag", scene.flat(parts))
    moved = {
        topic: open_recording(path, RecordingOptions(pose_topic=topic, pose_of="lidar"))
        for topic in ("/path", "/pose", "/tf")
    }
    assert {
        topic: opened.trajectory.translations_m[10].tolist() for topic, opened in moved.items()
    } == {"/path": [1, 0, 0], "/pose": [0, 2, 0], "/tf": [0, 0, 3]}


def test_raw_images_and_imu_of_ros_1(tmp_path: Path) -> None:
    parts = scene.whole()
    pixels = np.random.default_rng(4).integers(0, 255, (48, 64, 3), dtype=np.uint8)
    parts["images"] = [
        scene.Message(
            "/cam/image",
            "sensor_msgs/msg/Image",
            scene.stamp(i),
            messages.raw_image(scene.stamp(i), pixels.tobytes(), 64, 48, "rgb8", 192),
        )
        for i in range(scene.SCANS)
    ]
    points = np.zeros(5, dtype=[("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("t", "<u4")])
    parts["scans"] = [
        m._replace(payload=messages.point_cloud(scene.stamp(i), points))
        for i, m in enumerate(parts["scans"])
    ]
    parts["imu"] = [
        scene.Message("/imu", "sensor_msgs/msg/Imu", scene.stamp(i), messages.imu(scene.stamp(i)))
        for i in range(scene.SCANS)
    ]
    path = containers.write_bag(tmp_path / "a.bag", scene.flat(parts))

    assert np.array_equal(open_recording(path).read_image(3).rgb, pixels)
    motion = open_motion(path)
    assert motion.imu.stamps_ns.tolist() == [scene.stamp(i) for i in range(scene.SCANS)]
    assert motion.imu.frame == "imu"


def test_inspection_lists_the_topics(tmp_path: Path) -> None:
    summary = inspect_recording(bag(tmp_path))

    assert summary.converter == "bag"
    assert {topic.name: topic.messages for topic in summary.topics} == {
        name: sum(m.topic == name for m in MESSAGES) for name in {m.topic for m in MESSAGES}
    }


@pytest.mark.parametrize("name", ["example-lz4.bag", "example-bz2.bag"])
def test_bags_of_turtles_hold_no_point_clouds(shared_data: Path, name: str) -> None:
    path = shared_data / "evo_ros_bag" / name
    with pytest.raises(RecordingError, match="holds no point clouds"):
        open_recording(path)

    found = walk_files(BAG, [path], lambda *_: None)
    assert found.extent.messages == 8647  # as rosbags counts them
    assert found.extent.damage == []
    counts = {topic.name: topic.messages for topic in inspect_recording(path).topics}
    assert counts["/turtle1/pose"] == 1344
    assert counts["/tf"] == 2688


class TestSeveralFiles:
    def parts(self, folder: Path, count: int = 3) -> list[Path]:
        size = -(-len(MESSAGES) // count)
        found = []
        for i in range(count):
            path = folder / f"bridge_{i}.bag"
            some = MESSAGES[i * size : (i + 1) * size]
            path.write_bytes(containers.bag_by_hand(some, compression=("none", "lz4", "bz2")[i]))
            found.append(path)
        return found

    def test_they_are_one_recording(self, tmp_path: Path, expected: Recording) -> None:
        first, *more = self.parts(tmp_path)
        opened = open_recording(first, RecordingOptions(more_files=tuple(more)))

        assert_same(opened, expected)
        assert [source.name for source in opened.sources] == [
            "bridge_0.bag",
            "bridge_1.bag",
            "bridge_2.bag",
        ]
        travelled = pickle.loads(pickle.dumps(opened))  # noqa: S301 - our own bytes
        assert_same(travelled, expected)

    def test_a_folder_of_splits_is_one_recording(self, tmp_path: Path, expected: Recording) -> None:
        self.parts(tmp_path)
        assert_same(open_recording(tmp_path), expected)

    def test_the_same_file_twice_is_refused(self, tmp_path: Path) -> None:
        path = bag(tmp_path)
        with pytest.raises(UsageError, match="are the same") as caught:
            open_recording(path, RecordingOptions(more_files=(path,)))
        assert "once" in caught.value.fix

    def test_damage_names_its_file(self, tmp_path: Path) -> None:
        first, second, third = self.parts(tmp_path)
        second.write_bytes(second.read_bytes()[:-6000])
        with pytest.raises(RecordingError, match=r"damaged: bridge_1\.bag: the file is cut"):
            open_recording(first, RecordingOptions(more_files=(second, third)))

    def test_a_further_file_of_another_kind_is_refused(self, tmp_path: Path) -> None:
        other = scene.write(tmp_path / "other.mcap", scene.whole())
        with pytest.raises(RecordingError, match="no ROS 1 bag"):
            open_recording(bag(tmp_path), RecordingOptions(more_files=(other,)))


class TestDamage:
    def test_no_such_file_is_said(self, tmp_path: Path) -> None:
        with pytest.raises(RecordingError, match="there is no such recording"):
            open_recording(tmp_path / "missing.bag")

    @pytest.mark.parametrize("content", [b"", b"#ROSBAG", b"\x89MCAP0\r\n" + bytes(50)])
    def test_something_else_is_no_bag(self, tmp_path: Path, content: bytes) -> None:
        path = tmp_path / "other.bag"
        path.write_bytes(content)
        with pytest.raises(RecordingError, match="no ROS 1 bag"):
            open_recording(path)

    @pytest.mark.parametrize("magic", [b"#ROSBAG V1.2\n", b"#ROSRECORD V1.1\n"])
    def test_an_old_version_is_named(self, tmp_path: Path, magic: bytes) -> None:
        path = tmp_path / "old.bag"
        path.write_bytes(magic + bytes(100))
        with pytest.raises(RecordingError, match=r"bag of version 1\.[12]") as caught:
            open_recording(path)
        assert "rosbag fix" in caught.value.fix

    def test_an_encrypted_bag_is_named(self, tmp_path: Path) -> None:
        path = bag(tmp_path, header=[("encryptor", b"rosbag/AesCbcEncryptor")])
        with pytest.raises(RecordingError, match="encrypted by 'rosbag/AesCbcEncryptor'") as caught:
            open_recording(path)
        assert "decrypt" in caught.value.fix

    def test_a_bag_that_says_it_is_not_encrypted_is_read(self, tmp_path: Path) -> None:
        assert open_recording(bag(tmp_path, header=[("encryptor", b"")])).name == "bridge"

    @pytest.mark.parametrize("compression", COMPRESSIONS)
    @pytest.mark.parametrize("index", [True, False])
    def test_a_cut_bag_tells_what_is_readable_and_salvage_reads_it(
        self, tmp_path: Path, compression: str, index: bool
    ) -> None:
        path = bag(tmp_path, compression=compression, index=index, per_chunk=11)
        data = path.read_bytes()
        at = data.find(b"compression=", len(data) * 2 // 5)
        path.write_bytes(data[: at + 400])

        with pytest.raises(RecordingError, match=r"is cut inside .* messages over .* s are") as e:
            open_recording(path)
        assert "--salvage" in e.value.fix
        opened = open_recording(path, SALVAGE)
        count = len(opened.scan_stamps_ns)
        assert 3 < count < scene.SCANS
        assert opened.scan_stamps_ns.tolist() == [scene.stamp(i) for i in range(count)]
        assert len(opened.read_scan(count - 1).points) == 30
        assert "is cut inside" in str(opened.notes.salvage)

    def test_a_bag_cut_between_chunks_is_short_of_its_index(self, tmp_path: Path) -> None:
        path = bag(tmp_path)
        data = path.read_bytes()
        cut = data.find(b"\x14\0\0\0compression=", len(data) // 2)
        cut = data.rfind(b"compression=", 0, len(data) // 2) - 8
        path.write_bytes(data[:cut])
        with pytest.raises(RecordingError, match=r"\d+ of \d+ chunks are there"):
            open_recording(path)

    def test_a_cut_index_loses_nothing_and_is_remarked(
        self, tmp_path: Path, expected: Recording
    ) -> None:
        path = bag(tmp_path, compression="lz4")
        path.write_bytes(path.read_bytes()[:-40])
        opened = open_recording(path)
        assert_same(opened, expected)
        assert "no message is lost" in opened.notes.warnings[0]

    @pytest.mark.parametrize("compression", ["lz4", "bz2"])
    def test_a_flipped_byte_is_noticed_where_there_is_a_checksum(
        self, tmp_path: Path, compression: str
    ) -> None:
        path = bag(tmp_path, compression=compression, per_chunk=6)
        data = bytearray(path.read_bytes())
        at = data.find(b"compression=", len(data) // 2)
        data[at + 200] ^= 0x10
        path.write_bytes(data)

        with pytest.raises(RecordingError, match="is not readable: it cannot be decompressed"):
            open_recording(path)
        opened = open_recording(path, SALVAGE)
        assert scene.stamp(19) in opened.scan_stamps_ns
        assert len(opened.image_stamps_ns) < scene.SCANS or len(opened.scan_stamps_ns) < scene.SCANS

    @pytest.mark.parametrize("compression", COMPRESSIONS)
    @pytest.mark.parametrize("index", [True, False])
    def test_the_walk_goes_on_behind_a_hole(
        self, tmp_path: Path, compression: str, index: bool
    ) -> None:
        path = bag(tmp_path, compression=compression, index=index)
        data = bytearray(path.read_bytes())
        start = data.find(b"compression=", len(data) // 3) - 8
        data[start : start + 900] = bytes(900)
        path.write_bytes(data)

        opened = open_recording(path, SALVAGE)
        assert scene.stamp(19) in opened.scan_stamps_ns
        assert "has no record where one begins" in str(opened.notes.salvage)

    def test_connections_defined_in_a_lost_chunk_come_from_the_index(self, tmp_path: Path) -> None:
        path = bag(tmp_path, compression="lz4", per_chunk=4)
        data = bytearray(path.read_bytes())
        first = data.find(b"compression=")
        second = data.find(b"compression=", first + 1)
        data[first + 60 : second - 300] = bytes(second - 300 - first - 60)
        path.write_bytes(data)

        rig = read_rig(_rig(tmp_path))  # the camera lay in the lost chunk as well
        opened = open_recording(path, RecordingOptions(salvage=True, rig=rig))
        assert scene.stamp(19) in opened.scan_stamps_ns

    def test_an_unknown_compression_is_named(self, tmp_path: Path) -> None:
        path = bag(tmp_path, compression="lz4")
        path.write_bytes(path.read_bytes().replace(b"compression=lz4", b"compression=lz5"))
        with pytest.raises(RecordingError, match="compression 'lz5' is none of") as caught:
            open_recording(path, SALVAGE)
        assert "rosbag compress" in caught.value.fix

    def test_a_message_that_nothing_describes_is_said(self, tmp_path: Path) -> None:
        path = bag(tmp_path, order=("op", "conn", "time"))
        data = path.read_bytes()
        known = b"conn=" + struct.pack("<I", 2)
        at = data.rfind(b"\x04\0\0\0op=\x02\x09\0\0\0" + known)
        data = data[: at + 17] + struct.pack("<I", 99) + data[at + 21 :]
        path.write_bytes(data)
        with pytest.raises(RecordingError, match="messages of connection 99 are"):
            open_recording(path)

    def test_a_point_count_that_lies_is_said(self, tmp_path: Path) -> None:
        parts = scene.whole()
        points = [(0, 1.0, 2.0, 3.0, 0, 0, 0)] * 3
        parts["scans"] = [
            scene.Message(
                scene.LIDAR,
                "livox_ros_driver/msg/CustomMsg",
                scene.stamp(i),
                messages.custom_msg(scene.stamp(i), points, frame="lidar"),
            )
            for i in range(scene.SCANS)
        ]
        path = containers.write_bag(tmp_path / "a.bag", scene.flat(parts))
        honest = struct.pack("<I4BI", 3, 1, 0, 0, 0, 3)
        lying = struct.pack("<I4BI", 2**32 - 1, 1, 0, 0, 0, 2**32 - 1)
        path.write_bytes(path.read_bytes().replace(honest, lying))
        with pytest.raises(RecordingError, match="4294967295 points need"):
            open_recording(path).read_scan(0)

    def test_a_bag_that_changes_while_open_is_said(self, tmp_path: Path) -> None:
        path = bag(tmp_path)
        opened = open_recording(path)
        with path.open("ab") as file:
            file.write(b"more")
        with pytest.raises(RecordingError, match="not the one that was opened"):
            opened.read_scan(0)
