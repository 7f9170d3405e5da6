"""A ROS recording whose poses or images come from files; and R3LIVE's topics."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from civil_rgbd.conversion.mcap import open_recording
from civil_rgbd.domain.recording import Recording, RecordingOptions
from civil_rgbd.domain.rig import RigFile
from civil_rgbd.errors import RecordingError, UsageError
from civil_rgbd.trajectories.files import read_trajectory_file
from civil_rgbd.trajectories.rig import read_rig

from . import messages, scene
from .test_scan_folder import RIG

Parts = dict[str, list[scene.Message]]


def seconds(ns: int) -> str:
    return f"{ns // 10**9}.{ns % 10**9:09d}"


def without(*names: str) -> Parts:
    return {name: part for name, part in scene.whole().items() if name not in names}


def poses_file(folder: Path) -> Path:
    path = folder / "poses.tum"
    path.write_text(
        "".join(f"{seconds(scene.stamp(i))} 0 {i / 10} 0 0 0 0 1\n" for i in range(scene.SCANS))
    )
    return path


def opened(folder: Path, parts: Parts, **options: object) -> Recording:
    path = scene.write(folder / "a.mcap", parts)
    return open_recording(path, RecordingOptions(**options))  # type: ignore[arg-type]  # by name


def poses(folder: Path, **more: object) -> dict[str, object]:
    read = read_trajectory_file(poses_file(folder))
    return {
        "trajectory": read.trajectory,
        "trajectory_sources": read.sources,
        "trajectory_note": read.note,
    } | more


class TestPoses:
    def test_they_come_from_a_file_where_the_recording_has_none(self, tmp_path: Path) -> None:
        recording = opened(tmp_path, without("poses"), **poses(tmp_path, pose_of="lidar"))
        assert recording.trajectory.translations_m[3].tolist() == [0, 0.3, 0]
        assert [source.name for source in recording.sources] == ["a.mcap", "poses.tum"]
        words = "poses are taken from poses.tum (tum): poses of the lidar"
        assert words in " ".join(recording.notes.warnings)
        assert recording.rig.T_body_camera[:3, 3].tolist() == [1, 2, 3]  # tf still links sensors

    def test_they_come_first_where_the_recording_has_some(self, tmp_path: Path) -> None:
        recording = opened(tmp_path, scene.whole(), **poses(tmp_path, pose_of="camera"))
        assert recording.trajectory.translations_m[3].tolist() == [0, 0.3, 0]
        assert recording.rig.body == "camera"
        np.testing.assert_allclose(recording.rig.T_body_camera, np.eye(4), atol=1e-12)

    def test_their_body_is_asked_for(self, tmp_path: Path) -> None:
        with pytest.raises(UsageError, match="does not say what its poses are") as caught:
            opened(tmp_path, without("poses"), **poses(tmp_path))
        assert "--pose-of" in caught.value.fix
        body = RigFile(extrinsics={("body", "lidar"): np.eye(4)})
        recording = opened(tmp_path, without("poses"), **poses(tmp_path, rig=body))
        assert recording.rig.body == "body"

    def test_a_topic_beside_them_is_one_too_many(self, tmp_path: Path) -> None:
        with pytest.raises(UsageError, match="--pose-topic and --trajectory both"):
            opened(
                tmp_path, scene.whole(), **poses(tmp_path, pose_of="lidar", pose_topic=scene.ODOM)
            )

    def test_another_clock_is_refused(self, tmp_path: Path) -> None:
        read = read_trajectory_file(poses_file(tmp_path), time_offset_ns=-scene.START_NS)
        with pytest.raises(RecordingError, match=r"do not overlap: .*poses 0\.000 to 1\.900"):
            opened(tmp_path, without("poses"), trajectory=read.trajectory, pose_of="lidar")

    def test_clouds_may_be_in_the_map_already(self, tmp_path: Path) -> None:
        recording = opened(
            tmp_path, without("poses"), **poses(tmp_path, pose_of="camera", scans_in="map")
        )
        assert recording.read_scan(0).in_map
        assert recording.notes.deskew == "registered"


class TestImages:
    def folder(self, root: Path) -> Path:
        images = root / "images"
        images.mkdir()
        for at in range(scene.SCANS):
            (images / f"{at}.jpg").write_bytes(scene.jpeg(colour_rgb=(200, at, 60)))
        stamps = "".join(seconds(scene.stamp(at)) + "\n" for at in range(scene.SCANS))
        (images / "timestamps.txt").write_text(stamps)
        (root / "rig.toml").write_text(RIG)
        return images

    def test_they_come_from_a_folder_where_the_recording_has_none(self, tmp_path: Path) -> None:
        recording = opened(
            tmp_path,
            without("images", "infos", "tf"),
            images=self.folder(tmp_path),
            rig=read_rig(tmp_path / "rig.toml"),
        )
        assert recording.image_stamps_ns.tolist() == [scene.stamp(at) for at in range(scene.SCANS)]
        assert int(recording.read_image(15).rgb[0, 0, 1]) == pytest.approx(15, abs=3)
        assert recording.rig.T_body_camera[0, 3] == pytest.approx(0.1)
        assert [source.converter for source in recording.sources] == ["mcap", "images", "times"]

    def test_their_camera_comes_from_the_rig(self, tmp_path: Path) -> None:
        with pytest.raises(RecordingError, match="no camera model") as caught:
            opened(tmp_path, without("images"), images=self.folder(tmp_path))
        assert "--rig" in caught.value.fix


class TestR3live:
    def test_camera_path_gives_poses_of_the_camera(self, tmp_path: Path) -> None:
        for name, type_name, parts in (
            ("/camera_path", "geometry_msgs/msg/PoseStamped", self.stamped()),
            ("/camera_path", "nav_msgs/msg/Path", self.path()),
        ):
            content = without("poses") | {
                "camera": [scene.Message(name, type_name, at, data) for at, data in parts],
                "aft": scene.poses("/aft_mapped_to_init", child="aft_mapped", frame="world"),
            }
            with pytest.raises(UsageError, match="several topics carry poses"):
                opened(tmp_path, content)
            with pytest.raises(UsageError, match="does not say what its poses are"):
                opened(tmp_path, content, pose_topic="/camera_path")
            recording = opened(tmp_path, content, pose_topic="/camera_path", pose_of="camera")
            assert recording.rig.body == "camera"
            assert len(recording.trajectory.stamps_ns) == scene.SCANS

    def test_aft_mapped_to_init_gives_poses_of_the_imu(self, tmp_path: Path) -> None:
        content = without("poses") | {
            "aft": scene.poses("/aft_mapped_to_init", child="aft_mapped", frame="world")
        }
        rig = RigFile(extrinsics={("imu", "lidar"): np.eye(4)})
        recording = opened(tmp_path, content, pose_of="imu", rig=rig)
        assert recording.rig.body == "imu"
        with pytest.raises(RecordingError, match=r"nothing links the .* 'aft_mapped'"):
            opened(tmp_path, content)

    def stamped(self) -> list[tuple[int, bytes]]:
        return [
            (scene.stamp(i), messages.pose_stamped(scene.stamp(i), (i / 10, 0, 0, 0, 0, 0, 1)))
            for i in range(scene.SCANS)
        ]

    def path(self) -> list[tuple[int, bytes]]:
        poses = [(scene.stamp(i), (i / 10, 0, 0, 0, 0, 0, 1)) for i in range(scene.SCANS)]
        return [(scene.stamp(scene.SCANS - 1), messages.path(scene.stamp(scene.SCANS - 1), poses))]
