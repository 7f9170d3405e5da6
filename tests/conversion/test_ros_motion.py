"""LiDAR and IMU of a recording, without camera and poses."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from civil_rgbd.converters import open_motion
from civil_rgbd.domain.motion import MotionRecording
from civil_rgbd.domain.recording import RecordingOptions
from civil_rgbd.domain.rig import RigFile
from civil_rgbd.errors import RecordingError, UsageError
from civil_rgbd.geometry.transforms import transform_from

from . import messages, scene

IMU = "/livox/imu"


def imu(topic: str = IMU, *, order: str = "<", short: bool = False) -> list[scene.Message]:
    """Readings whose nine numbers all differ, five milliseconds apart."""
    found = []
    for i in range(40):
        stamp = scene.START_NS + i * 5_000_000
        numbers = [0.0] * 4 + [-1.0] * 9 + [i, i + 0.25, i + 0.5] + [7.0] * 9
        numbers += [] if short else [-i, 0.125, 9.75] + [8.0] * 9
        payload = messages.Cdr(order).header(stamp, "imu_frame").put("d", *numbers).done()
        found.append(scene.Message(topic, "sensor_msgs/msg/Imu", stamp, payload))
    return found


def livox() -> list[scene.Message]:
    points = [(k * 1000, 1.0 + k, 2.0, 3.0, 9, 16, k % 6) for k in range(5)]
    return [
        scene.Message(
            "/livox/lidar",
            "livox_ros_driver2/msg/CustomMsg",
            scene.stamp(i),
            messages.custom_msg(scene.stamp(i), points, frame="lidar_frame"),
        )
        for i in range(3)
    ]


def opened(
    folder: Path, options: RecordingOptions | None = None, **parts: list[scene.Message]
) -> MotionRecording:
    content = {"imu": imu(), "lidar": livox()} | parts
    return open_motion(scene.write(folder / "scan.mcap", content), options)


@pytest.mark.parametrize("order", ["<", ">"])
def test_rates_and_forces_are_told_from_what_lies_around_them(tmp_path: Path, order: str) -> None:
    found = opened(tmp_path, imu=imu(order=order)).imu

    assert found.frame == "imu_frame"
    assert found.stamps_ns.tolist() == [scene.START_NS + i * 5_000_000 for i in range(40)]
    assert found.rates_rad_s[3].tolist() == [3.0, 3.25, 3.5]
    assert found.forces[3].tolist() == [-3.0, 0.125, 9.75]


def test_neither_camera_nor_poses_are_asked_for(tmp_path: Path) -> None:
    found = opened(tmp_path)

    assert found.is_livox
    assert len(found.scan_stamps_ns) == 3
    stamps = found.read_scan(1).point_stamps_ns
    assert stamps is not None
    assert stamps.tolist() == [scene.stamp(1) + k * 1000 for k in range(5)]
    assert found.T_imu_lidar is None


def test_tf_says_where_the_lidar_sits_and_a_rig_file_says_it_first(tmp_path: Path) -> None:
    link = messages.transforms([(0, "imu_frame", "lidar_frame", (1, 2, 3, 0, 0, 0, 1))])
    tf = [scene.Message("/tf_static", "tf2_msgs/msg/TFMessage", scene.START_NS, link)]
    rig = RigFile(extrinsics={("lidar", "imu"): transform_from(np.eye(3), [4.0, 0.0, 0.0])})

    by_tf = opened(tmp_path, tf=tf).T_imu_lidar
    by_rig = opened(tmp_path, RecordingOptions(rig=rig), tf=tf).T_imu_lidar

    assert by_tf is not None
    assert by_rig is not None
    assert by_tf[:3, 3].tolist() == [1.0, 2.0, 3.0]
    assert by_rig[:3, 3].tolist() == [-4.0, 0.0, 0.0]


def test_of_several_imus_one_is_to_be_chosen(tmp_path: Path) -> None:
    several = imu() + imu("/camera/imu")

    with pytest.raises(UsageError, match="several topics carry IMU readings") as info:
        opened(tmp_path, imu=several)
    with pytest.raises(UsageError, match="--imu-topic '/livox/imo' names no topic"):
        opened(tmp_path, RecordingOptions(imu_topic="/livox/imo"), imu=several)

    assert "--imu-topic /camera/imu" in info.value.fix
    assert len(opened(tmp_path, RecordingOptions(imu_topic=IMU), imu=several).imu.stamps_ns) == 40


def test_a_recording_without_imu_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="holds no IMU readings") as info:
        opened(tmp_path, imu=[])

    assert "--trajectory" in info.value.fix


def test_a_reading_that_ends_early_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="it ends before its reading does"):
        opened(tmp_path, imu=imu(short=True))


@pytest.mark.parametrize("at", [0, 7])
@pytest.mark.parametrize("length", [10, 200])
def test_a_cut_reading_is_said_or_left_out(tmp_path: Path, at: int, length: int) -> None:
    readings = imu()
    readings[at] = readings[at]._replace(payload=readings[at].payload[:length])
    with pytest.raises(RecordingError, match="1 of 40 messages are damaged") as caught:
        opened(tmp_path, imu=readings)
    assert "--salvage" in caught.value.fix

    found = opened(tmp_path, RecordingOptions(salvage=True), imu=readings)
    assert len(found.imu.stamps_ns) == 39
    assert found.imu.frame == "imu_frame"
    assert found.notes.counts == {"message-damaged": 1}
    assert any(said.startswith(f"{IMU}: 1 of 40") for said in found.notes.warnings)


def test_a_cut_cloud_is_said_or_a_scan_without_points(tmp_path: Path) -> None:
    clouds = livox()
    clouds[1] = clouds[1]._replace(payload=clouds[1].payload[:-10])
    with pytest.raises(RecordingError, match="point cloud 1 breaks its own layout") as caught:
        opened(tmp_path, lidar=clouds).read_scan(1)
    assert "--salvage" in caught.value.fix

    found = opened(tmp_path, RecordingOptions(salvage=True), lidar=clouds)
    assert found.read_scan(1).unreadable
    assert len(found.read_scan(2).points) == 5


def test_clouds_without_point_times_are_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="have no point times, and odometry needs") as info:
        opened(tmp_path, lidar=scene.scans())

    assert "--point-time" in info.value.fix
