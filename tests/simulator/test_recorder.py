"""The file decodes with another library, message by message."""

from __future__ import annotations

import os
import zlib
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zstandard
from mcap.reader import make_reader
from mcap.records import Chunk, DataEnd
from mcap.stream_reader import StreamReader
from mcap_ros2.decoder import DecoderFactory
from rosbags import rosbag1
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from civil_rgbd.converters import list_topics, open_recording
from civil_rgbd.domain.recording import RecordingOptions
from civil_rgbd.errors import OutputError, UsageError
from civil_rgbd.simulator.camera import raw_camera, simulate_jpeg
from civil_rgbd.simulator.lidar import simulate_scan
from civil_rgbd.simulator.recorder import TOPICS, write_recording
from civil_rgbd.simulator.recording import SimulatedRecording
from civil_rgbd.simulator.spec import ScanSpec

SPEC = ScanSpec(
    seconds=0.5,
    image_scale=0.1,
    point_rate_hz=6_000,
    camera_time_offset_s=0.25,
    false_return_share=0.1,
    extrinsic_error_deg=(0.5, 0.0, 1.0),
)


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("simulated") / "raw.mcap"
    write_recording(path, SPEC)
    return path


@pytest.fixture(scope="module")
def messages(file: Path) -> dict[str, list[tuple[Any, Any]]]:
    found = defaultdict(list)
    with file.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        last = 0
        for _, channel, message, decoded in reader.iter_decoded_messages(log_time_order=False):
            assert message.log_time >= last  # written in order of log time
            last = message.log_time
            found[channel.topic].append((message, decoded))
    return found


def _stamp_ns(message: Any) -> int:
    return int(message.header.stamp.sec) * 10**9 + int(message.header.stamp.nanosec)


def test_every_topic_is_there_at_its_rate(messages: dict[str, list[Any]]) -> None:
    assert {topic: len(found) for topic, found in messages.items()} == {
        "/civil_rgbd/origin": 1,
        "/tf_static": 1,
        "/odometry": 101,
        "/livox/imu": 101,
        "/livox/lidar": 5,
        "/camera/color/camera_info": 5,
        "/camera/color/image_raw/compressed": 5,
    }


def test_points_arrive_as_simulated(messages: dict[str, list[Any]]) -> None:
    for index, (message, decoded) in enumerate(messages["/livox/lidar"]):
        scan = simulate_scan(SPEC, index)
        assert _stamp_ns(decoded) == decoded.timebase == scan.stamp_ns
        assert decoded.header.frame_id == "livox_frame"
        assert decoded.point_num == len(decoded.points) == 600
        assert message.log_time == scan.stamp_ns + 100_000_000
        columns = {
            name: [getattr(point, name) for point in decoded.points]
            for name in ("offset_time", "x", "y", "z", "reflectivity", "tag", "line")
        }
        assert columns["offset_time"] == scan.offset_ns.tolist()
        points = np.array([columns[axis] for axis in "xyz"], dtype=np.float32).T
        np.testing.assert_array_equal(points, scan.points_lidar)
        assert columns["reflectivity"] == scan.reflectivity.tolist()
        assert columns["tag"] == scan.tag.tolist()
        assert columns["line"] == scan.line.tolist()
        assert any(columns["tag"])


def test_a_livox_payload_ends_with_its_last_point_unpadded(file: Path) -> None:
    with file.open("rb") as stream:
        for _, _, message in make_reader(stream).iter_messages(topics="/livox/lidar"):
            assert len(message.data) == 48 + 600 * 20 - 1


def test_images_and_their_camera_arrive_as_simulated(messages: dict[str, list[Any]]) -> None:
    recording = SimulatedRecording(SPEC)
    camera = raw_camera(0.1)
    images = messages["/camera/color/image_raw/compressed"]
    for index, (_, decoded) in enumerate(images):
        assert bytes(decoded.data) == simulate_jpeg(SPEC, index)
        assert _stamp_ns(decoded) == recording.image_stamps_ns[index]
        assert decoded.header.frame_id == "camera_color_optical_frame"
        assert "jpeg" in decoded.format
    for index, (_, info) in enumerate(messages["/camera/color/camera_info"]):
        assert _stamp_ns(info) == recording.image_stamps_ns[index]
        assert (info.width, info.height) == (128, 72)
        assert info.distortion_model == "plumb_bob"
        assert tuple(info.d) == camera.coefficients
        assert list(info.k) == camera.pinhole.matrix.ravel().tolist()
        assert list(info.r) == np.eye(3).ravel().tolist()
        assert np.reshape(info.p, (3, 4))[:, :3].tolist() == camera.pinhole.matrix.tolist()
        assert (info.binning_x, info.binning_y, info.roi.width, info.roi.do_rectify) == (0, 0, 0, 0)


def test_odometry_is_the_recordings_trajectory(messages: dict[str, list[Any]]) -> None:
    trajectory = SimulatedRecording(SPEC).trajectory
    for index, (_, decoded) in enumerate(messages["/odometry"]):
        place, turn = decoded.pose.pose.position, decoded.pose.pose.orientation
        assert (decoded.header.frame_id, decoded.child_frame_id) == ("map", "imu_link")
        assert _stamp_ns(decoded) == trajectory.stamps_ns[index]
        assert [place.x, place.y, place.z] == trajectory.translations_m[index].tolist()
        assert [turn.x, turn.y, turn.z, turn.w] == trajectory.quaternions_xyzw[index].tolist()


def test_static_transforms_chain_to_the_stated_camera(messages: dict[str, list[Any]]) -> None:
    from scipy.spatial.transform import Rotation

    ((_, decoded),) = messages["/tf_static"]
    T = np.eye(4)
    frames = []
    for link in decoded.transforms:
        t, q = link.transform.translation, link.transform.rotation
        step = np.eye(4)
        step[:3, :3] = Rotation.from_quat([q.x, q.y, q.z, q.w]).as_matrix()
        step[:3, 3] = [t.x, t.y, t.z]
        T = T @ step
        frames.append((link.header.frame_id, link.child_frame_id))

    assert frames == [("imu_link", "livox_frame"), ("livox_frame", "camera_color_optical_frame")]
    np.testing.assert_allclose(T, SimulatedRecording(SPEC).rig.T_body_camera, rtol=0, atol=1e-15)


def test_the_file_and_the_recording_without_a_file_are_the_same_to_the_bit(file: Path) -> None:
    recording, simulated = open_recording(file), SimulatedRecording(SPEC)

    assert recording.notes.simulated
    assert recording.rig.camera == simulated.rig.camera
    for name in ("T_body_camera", "T_body_lidar"):
        np.testing.assert_array_equal(getattr(recording.rig, name), getattr(simulated.rig, name))
    for name in ("stamps_ns", "translations_m", "quaternions_xyzw"):
        np.testing.assert_array_equal(
            getattr(recording.trajectory, name), getattr(simulated.trajectory, name)
        )
    np.testing.assert_array_equal(recording.image_stamps_ns, simulated.image_stamps_ns)
    for index in range(5):
        one, two = recording.read_scan(index), simulated.read_scan(index)
        np.testing.assert_array_equal(one.points, two.points)
        np.testing.assert_array_equal(one.point_stamps_ns, two.point_stamps_ns)
        np.testing.assert_array_equal(one.noise, two.noise)
        np.testing.assert_array_equal(
            recording.read_image(index).rgb, simulated.read_image(index).rgb
        )


def test_the_imu_is_in_g_and_has_no_orientation(messages: dict[str, list[Any]]) -> None:
    for _, decoded in messages["/livox/imu"]:
        force = decoded.linear_acceleration
        assert 0.7 < force.z < 1.3
        assert decoded.orientation_covariance[0] == -1
        assert decoded.angular_velocity_covariance[8] == 0


def test_the_file_has_crcs_zstd_chunks_and_says_that_it_is_simulated(file: Path) -> None:
    with file.open("rb") as stream:
        reader = make_reader(stream)
        summary = reader.get_summary()
        assert summary is not None
        assert {index.compression for index in summary.chunk_indexes} == {"zstd"}
        assert {schema.encoding for schema in summary.schemas.values()} == {"ros2msg"}
        assert {c.topic for c in summary.channels.values()} == set(TOPICS)
        assert reader.get_header().profile == "ros2"
        (metadata,) = reader.iter_metadata()
        assert metadata.metadata == {"origin": "simulated"}


def test_every_chunk_and_the_data_carry_a_checksum(file: Path) -> None:
    with file.open("rb") as stream:
        records = list(StreamReader(stream, emit_chunks=True).records)
    chunks = [record for record in records if isinstance(record, Chunk)]
    (end,) = (record for record in records if isinstance(record, DataEnd))

    assert chunks
    for chunk in chunks:
        content = zstandard.ZstdDecompressor().decompress(chunk.data, chunk.uncompressed_size)
        assert zlib.crc32(content) == chunk.uncompressed_crc
    assert end.data_section_crc != 0


def test_the_same_spec_gives_the_same_bytes(file: Path, tmp_path: Path) -> None:
    write_recording(tmp_path / "again.mcap", SPEC)

    assert (tmp_path / "again.mcap").read_bytes() == file.read_bytes()


def test_progress_counts_every_image_once(tmp_path: Path) -> None:
    told: list[tuple[int, int]] = []
    write_recording(
        tmp_path / "new" / "raw.mcap", SPEC, progress=lambda done, total: told.append((done, total))
    )

    assert told == [(1, 5)] * 5


def test_a_file_that_is_there_is_not_replaced_unasked(tmp_path: Path) -> None:
    path = tmp_path / "raw.mcap"
    path.write_bytes(b"precious")

    with pytest.raises(OutputError, match="there already") as caught:
        write_recording(path, SPEC)
    assert "--overwrite" in caught.value.fix
    assert path.read_bytes() == b"precious"

    write_recording(path, SPEC, overwrite=True)
    assert path.read_bytes().startswith(b"\x89MCAP")


def test_an_interrupted_recording_leaves_nothing(tmp_path: Path) -> None:
    def interrupt(done: int, total: int) -> None:
        raise KeyboardInterrupt(done, total)

    with pytest.raises(KeyboardInterrupt, match="1"):
        write_recording(tmp_path / "raw.mcap", SPEC, progress=interrupt)

    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_cannot_be_made_is_a_clear_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")

    with pytest.raises(OutputError, match="cannot write") as caught:
        write_recording(tmp_path / "file" / "raw.mcap", SPEC)
    assert caught.value.where.endswith("raw.mcap")


def test_what_a_killed_run_left_is_never_written_over(tmp_path: Path) -> None:
    left = tmp_path / f".raw.mcap.{os.getpid()}.partial"
    left.write_text("of another machine's process of this id, which may still write")

    write_recording(tmp_path / "raw.mcap", SPEC)

    assert left.read_text().startswith("of another machine's")


def test_two_that_write_one_file_at_once_keep_apart(file: Path, tmp_path: Path) -> None:
    def meanwhile(_done: int, _total: int) -> None:
        if not (tmp_path / "raw.mcap").exists():
            write_recording(tmp_path / "raw.mcap", SPEC)

    write_recording(tmp_path / "raw.mcap", SPEC, progress=meanwhile)

    assert (tmp_path / "raw.mcap").read_bytes() == file.read_bytes()
    assert [entry.name for entry in tmp_path.iterdir()] == ["raw.mcap"]


def test_a_full_disk_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(_descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)

    with pytest.raises(OutputError, match="No space left"):
        write_recording(tmp_path / "raw.mcap", SPEC)
    assert list(tmp_path.iterdir()) == []


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("simulated") / "raw.bag"
    write_recording(path, SPEC)
    return path


class TestBag:
    def test_it_opens_as_the_same_recording_as_the_mcap_file(self, bag: Path, file: Path) -> None:
        one, two = open_recording(bag), open_recording(file)

        assert one.notes == two.notes
        assert one.notes.simulated
        assert one.rig.camera == two.rig.camera
        for name in ("T_body_camera", "T_body_lidar"):
            np.testing.assert_array_equal(getattr(one.rig, name), getattr(two.rig, name))
        for name in ("stamps_ns", "translations_m", "quaternions_xyzw"):
            np.testing.assert_array_equal(
                getattr(one.trajectory, name), getattr(two.trajectory, name)
            )
        np.testing.assert_array_equal(one.image_stamps_ns, two.image_stamps_ns)
        for index in range(5):
            a, b = one.read_scan(index), two.read_scan(index)
            np.testing.assert_array_equal(a.points, b.points)
            np.testing.assert_array_equal(a.point_stamps_ns, b.point_stamps_ns)
            np.testing.assert_array_equal(a.noise, b.noise)
            np.testing.assert_array_equal(one.read_image(index).rgb, two.read_image(index).rgb)

    def test_another_library_decodes_every_message(self, bag: Path) -> None:
        with rosbag1.Reader(bag) as reader:
            store = get_typestore(Stores.EMPTY)
            for connection in reader.connections:
                types = get_types_from_msg(connection.msgdef.data, connection.msgtype)
                store.register({k: v for k, v in types.items() if k not in store.fielddefs})
            for connection in reader.connections:
                # The sum is what ROS computes of the very definition that lies beside it.
                _, md5 = store.generate_msgdef(connection.msgtype)
                assert connection.digest == md5, connection.msgtype
            counts: dict[str, int] = defaultdict(int)
            for connection, _, data in reader.messages():
                decoded = store.deserialize_ros1(data, connection.msgtype)
                again = store.serialize_ros1(decoded, connection.msgtype)
                assert bytes(again) == bytes(data)
                counts[connection.topic] += 1
            assert counts == {t: info.msgcount for t, info in reader.topics.items()}
            assert set(counts) == set(TOPICS)

    def test_the_definitions_are_those_of_ros(self, bag: Path) -> None:
        noetic = get_typestore(Stores.ROS1_NOETIC)
        with rosbag1.Reader(bag) as reader:
            known = [c for c in reader.connections if c.msgtype in noetic.fielddefs]
            assert len(known) == 5
            for connection in known:
                assert connection.digest == noetic.generate_msgdef(connection.msgtype)[1]

    def test_the_same_spec_gives_the_same_bytes(self, bag: Path, tmp_path: Path) -> None:
        write_recording(tmp_path / "again.bag", SPEC)

        assert (tmp_path / "again.bag").read_bytes() == bag.read_bytes()


@pytest.mark.parametrize("suffix", ["mcap", "bag"])
def test_poses_and_extrinsics_can_be_left_out(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"raw.{suffix}"
    write_recording(path, SPEC, without=("poses", "extrinsics"))
    found = {topic.name for topic in list_topics(path, RecordingOptions()).topics}

    assert found == set(TOPICS) - {"/odometry", "/tf_static"}


def test_a_suffix_of_no_recording_is_a_clear_error(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"neither \.mcap nor \.bag") as caught:
        write_recording(tmp_path / "raw.db3", SPEC)
    assert "'raw.mcap'" in caught.value.fix
