"""Recordings that others wrote, beside another library's reading of them."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType
from typing import Any

import cv2
import numpy as np
import pytest
import zstandard
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from civil_rgbd.conversion.mcap import open_recording
from civil_rgbd.conversion.mcap_container import walk
from civil_rgbd.conversion.mcap_payloads import McapPayloads
from civil_rgbd.conversion.ros_images import rgb_from_image
from civil_rgbd.conversion.topics import TopicTable
from civil_rgbd.domain.recording import RecordingOptions
from civil_rgbd.errors import RecordingError

TINY = Path(__file__).parents[1] / "data" / "recordings" / "tiny.mcap"


@pytest.fixture(scope="module")
def make() -> ModuleType:
    spec = importlib.util.spec_from_file_location("make_recordings", TINY.with_name("make.py"))
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def decoded(path: Path) -> list[tuple[str, Any]]:
    """Topic and message of every message, by the other library."""
    factory, found = DecoderFactory(), []
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            decode = factory.decoder_for("cdr", schema)
            assert decode is not None
            data = message.data
            if data.startswith(b"\x28\xb5\x2f\xfd"):  # compressed by itself; it does not know that
                data = zstandard.decompress(data)
            found.append((channel.topic, decode(data)))
    return found


def stamp_of(message: Any) -> int:
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


def test_the_tiny_recording_is_what_its_maker_wrote(make: ModuleType) -> None:
    recording = open_recording(TINY)

    assert len(recording.image_stamps_ns) == make.IMAGES
    assert recording.rig.camera.lens == "plumb_bob"
    assert recording.rig.camera.coefficients == (-0.05, 0.06, 0.0001, -0.001, -0.02)
    assert recording.rig.camera.pinhole.fy_px == 31.0
    assert recording.rig.T_lidar_camera[:3, 3] == pytest.approx([0.1, 0.2, 0.3])
    assert recording.rig.T_lidar_camera[:3, 2] == pytest.approx([1, 0, 0])
    assert recording.trajectory.translations_m[:, 0] == pytest.approx(0.05 * np.arange(21))
    assert np.array_equal(recording.read_image(4).rgb, np.full((24, 32, 3), (220, 90, 40)))
    for index in (0, 7, 19):
        scan = recording.read_scan(index)
        expected = [make.point_of(index, point) for point in range(make.POINTS)]
        assert scan.points.tolist() == [[p["x"], p["y"], p["z"]] for p in expected]
        offsets = [p["offset_time"] for p in expected]
        assert scan.point_stamps_ns.tolist() == [scan.stamp_ns + offset for offset in offsets]
        assert scan.noise.tolist() == [p["tag"] == 0x12 for p in expected]


def test_make_writes_the_recording_that_is_kept(tmp_path: Path, make: ModuleType) -> None:
    make.main(tmp_path / "again.mcap")
    again, kept = open_recording(tmp_path / "again.mcap"), open_recording(TINY)
    assert np.array_equal(again.scan_stamps_ns, kept.scan_stamps_ns)
    assert np.array_equal(again.read_scan(5).points, kept.read_scan(5).points)
    assert np.array_equal(again.read_image(5).rgb, kept.read_image(5).rgb)


@pytest.fixture(scope="module")
def path(shared_data: Path) -> Path:
    return shared_data / "kitti_bridge_drive" / "kitti_20frames.mcap"


@pytest.fixture(scope="module")
def by_topic(path: Path) -> dict[str, list[Any]]:
    found: dict[str, list[Any]] = {}
    for topic, message in decoded(path):
        found.setdefault(topic, []).append(message)
    return found


class TestKitti:
    def test_every_cloud_and_image_equals_the_other_readers(
        self, path: Path, by_topic: dict[str, list[Any]]
    ) -> None:
        recording = open_recording(path)
        clouds = by_topic["/velodyne_points"]
        images = by_topic["/camera_left/image_rect/compressed"]
        assert recording.scan_stamps_ns.tolist() == [stamp_of(m) for m in clouds]
        assert recording.image_stamps_ns.tolist() == [stamp_of(m) for m in images]
        for index in range(20):
            scan = recording.read_scan(index)
            expected = np.frombuffer(bytes(clouds[index].data), "<f4").reshape(-1, 4)[:, :3]
            assert np.array_equal(scan.points, expected)
            assert scan.point_stamps_ns is None
            bgr = cv2.imdecode(np.frombuffer(bytes(images[index].data), np.uint8), -1)
            assert np.array_equal(recording.read_image(index).rgb[:, :, ::-1], bgr)

    def test_poses_camera_and_extrinsics_equal_the_other_readers(
        self, path: Path, by_topic: dict[str, list[Any]]
    ) -> None:
        recording = open_recording(path)
        for index, message in enumerate(by_topic["/Odometry"]):
            p, q = message.pose.pose.position, message.pose.pose.orientation
            assert recording.trajectory.translations_m[index].tolist() == [p.x, p.y, p.z]
            assert recording.trajectory.quaternions_xyzw[index] == pytest.approx(
                [q.x, q.y, q.z, q.w], abs=1e-9
            )
        info = by_topic["/camera_left/camera_info"][0]
        camera = recording.rig.camera.pinhole
        assert (camera.fx_px, camera.cx_px, camera.cy_px) == (info.p[0], info.p[2], info.p[6])
        link = by_topic["/tf_static"][0].transforms[0].transform.translation
        assert recording.rig.T_lidar_camera[:3, 3].tolist() == [link.x, link.y, link.z]
        assert (recording.rig.body, recording.notes.deskew) == ("velodyne", "unavailable")

    def test_half_of_it_is_salvaged(self, path: Path, tmp_path: Path) -> None:
        half = tmp_path / "half.mcap"
        half.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
        with pytest.raises(RecordingError, match=r"messages over 0.9.* s are readable"):
            open_recording(half)
        recording = open_recording(half, RecordingOptions(salvage=True))
        whole = open_recording(path)
        count = len(recording.scan_stamps_ns)
        assert 9 <= count <= 11
        assert np.array_equal(
            recording.read_scan(count - 1).points, whole.read_scan(count - 1).points
        )


def test_a_bag_without_summary_is_walked(shared_data: Path) -> None:
    path = shared_data / "rosbags_rs/tests/test_bags/test_bag_mcap/test_bag_mcap.mcap"
    table = TopicTable()
    extent = walk(path, table.sink_for, size_bytes=path.stat().st_size)
    assert (extent.messages, extent.damage) == (188, [])
    counts = {topic.type_name: topic.gathered.count for topic in table.of_role("pose")}
    assert counts == {
        "nav_msgs/Odometry": 2,
        "nav_msgs/Path": 2,
        "geometry_msgs/PoseStamped": 2,
        "geometry_msgs/PoseWithCovarianceStamped": 2,
    }
    for role in ("pose", "lidar", "image", "camera_info", "tf"):
        assert [topic.gathered.fault for topic in table.of_role(role)].count(None) > 0


def test_images_of_the_old_type_name_are_read(shared_data: Path) -> None:
    path = shared_data / "amber_mcap" / "soccer_goal_12.mcap"
    table = TopicTable()
    walk(path, table.sink_for, size_bytes=path.stat().st_size)
    (topic,) = table.of_role("image")
    payloads = McapPayloads(path, path.stat().st_size)
    index = topic.gathered.index()
    expected = [message for _, message in decoded(path)]
    assert len(index) == len(expected) == 2
    for i, message in enumerate(expected):
        rgb = rgb_from_image(payloads.fetch(*index.place(i)), where="amber")
        order = slice(None, None, -1) if message.encoding == "bgr8" else slice(None)
        pixels = np.frombuffer(bytes(message.data), np.uint8)
        shape = (message.height, message.width, 3)
        assert np.array_equal(rgb, pixels.reshape(shape)[:, :, order])
        assert index.stamps_ns[i] == stamp_of(message)
