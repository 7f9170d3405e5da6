"""Which topics a recording is made of, whose poses they are, and what is odd about it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from civil_rgbd.conversion.mcap import open_recording
from civil_rgbd.domain.recording import Recording, RecordingOptions
from civil_rgbd.domain.rig import RigFile
from civil_rgbd.errors import ImageDecodeError, RecordingError, UsageError
from civil_rgbd.geometry.camera import LensCamera, PinholeCamera
from civil_rgbd.trajectories.rig import read_rig

from . import messages, scene

Parts = dict[str, list[scene.Message]]
TF = "tf2_msgs/msg/TFMessage"


def opened(tmp_path: Path, parts: Parts, **options: object) -> Recording:
    path = scene.write(tmp_path / "a.mcap", parts)
    return open_recording(path, RecordingOptions(**options))  # type: ignore[arg-type]  # by name


def livox(package: str = "livox_ros_driver2/msg", *, off_ns: int = 0) -> list[scene.Message]:
    points = [(i * 1000, 1.0 + i, 2.0, 3.0, 0, 0x10, 0) for i in range(4)]
    return [
        scene.Message(
            "/livox/lidar",
            f"{package}/CustomMsg",
            scene.stamp(i),
            messages.custom_msg(
                scene.stamp(i), points, frame="lidar", timebase_ns=scene.stamp(i) + off_ns
            ),
        )
        for i in range(scene.SCANS)
    ]


class TestTopics:
    @pytest.mark.parametrize(
        "package",
        [
            "livox_ros_driver/msg",
            "livox_ros_driver2/msg",
            "livox_interfaces/msg",
            "livox_ros_driver",
            "livox_ros_driver2",
            "livox_interfaces",
        ],
    )
    def test_custom_msg_of_every_package_is_read(self, tmp_path: Path, package: str) -> None:
        recording = opened(tmp_path, {**scene.whole(), "scans": livox(package)})
        scan = recording.read_scan(2)
        assert scan.points[:, 0].tolist() == [1, 2, 3, 4]
        assert scan.point_stamps_ns is not None
        assert scan.point_stamps_ns.tolist() == [scene.stamp(2) + i * 1000 for i in range(4)]
        assert recording.point_reach_ns == (0, 10**9)
        assert (recording.notes.deskew, recording.notes.warnings) == ("per_point", ())

    def test_a_timebase_off_by_more_than_a_millisecond_is_reported(self, tmp_path: Path) -> None:
        parts = {**scene.whole(), "scans": livox(off_ns=-2_000_000)}
        (warning,) = opened(tmp_path, parts).notes.warnings
        assert "-0.002000 s" in warning
        quiet = opened(tmp_path, {**scene.whole(), "scans": livox(off_ns=1_000_000)})
        assert quiet.notes.warnings == ()

    @pytest.mark.parametrize(
        ("part", "more", "option", "key"),
        [
            ("scans", scene.scans("/other"), "--lidar-topic", "lidar_topic"),
            ("scans", livox(), "--lidar-topic", "lidar_topic"),
            ("images", scene.images("/other/image"), "--image-topic", "image_topic"),
            ("poses", scene.poses("/other"), "--pose-topic", "pose_topic"),
        ],
    )
    def test_several_that_fit_are_listed_with_the_option(
        self, tmp_path: Path, part: str, more: list[scene.Message], option: str, key: str
    ) -> None:
        parts = {**scene.whole(), "more": more}
        first = parts[part][0].topic
        with pytest.raises(UsageError, match="several topics carry") as caught:
            opened(tmp_path, parts)
        assert f"{first} (" in caught.value.what
        assert f"{more[0].topic} (" in caught.value.what
        assert f"{len(more)} messages" in caught.value.what
        assert option in caught.value.fix
        assert opened(tmp_path, parts, **{key: first}).notes.salvage is None

    def test_a_raw_topic_and_its_compressed_sibling_are_several(self, tmp_path: Path) -> None:
        raw = scene.Message(
            "/cam/image",
            "sensor_msgs/msg/Image",
            scene.stamp(1),
            messages.raw_image(scene.stamp(1), bytes(64 * 48 * 3), 64, 48, "rgb8", 192),
        )
        parts = {**scene.whole(), "raw": [raw]}
        with pytest.raises(UsageError, match=r"/cam/image \(.*, /cam/image/compressed \("):
            opened(tmp_path, parts)
        chosen = opened(tmp_path, parts, image_topic="/cam/image")
        assert chosen.read_image(0).rgb.shape == (48, 64, 3)

    def test_a_depth_image_beside_the_photographs_is_left_aside(self, tmp_path: Path) -> None:
        payload = messages.raw_image(scene.stamp(1), bytes(8), 2, 2, "16UC1", 4)
        depth = scene.Message("/depth", "sensor_msgs/msg/Image", scene.stamp(1), payload)
        parts = {**scene.whole(), "depth": [depth]}
        assert len(opened(tmp_path, parts).image_stamps_ns) == scene.SCANS
        with pytest.raises(RecordingError, match="encoded as '16UC1'"):
            opened(tmp_path, parts, image_topic="/depth")

    def test_an_unknown_topic_names_the_nearest(self, tmp_path: Path) -> None:
        with pytest.raises(UsageError, match="--lidar-topic '/lidra' names no topic") as caught:
            opened(tmp_path, scene.whole(), lidar_topic="/lidra")
        assert "did you mean '/lidar'" in caught.value.fix

    def test_camera_info_of_the_same_namespace_is_preferred(self, tmp_path: Path) -> None:
        other = scene.infos("/depth/camera_info", size=(9, 9))
        recording = opened(tmp_path, {**scene.whole(), "other": other})
        assert recording.rig.camera.pinhole.width_px == 64

    def test_camera_infos_of_other_namespaces_are_asked_for(self, tmp_path: Path) -> None:
        parts = {**scene.whole(), "infos": scene.infos("/a/info"), "more": scene.infos("/b/info")}
        with pytest.raises(UsageError, match="several topics carry CameraInfo") as caught:
            opened(tmp_path, parts)
        assert "--camera-info-topic" in caught.value.fix
        opened(tmp_path, parts, camera_info_topic="/b/info")

    def test_clouds_in_two_frames_are_refused(self, tmp_path: Path) -> None:
        parts = scene.whole()
        parts["scans"] = scene.scans(count=5) + scene.scans(frame="rear", count=5)
        with pytest.raises(RecordingError, match="several frames: lidar, rear"):
            opened(tmp_path, parts)

    def test_a_broken_message_matters_only_on_the_chosen_topic(self, tmp_path: Path) -> None:
        broken = scene.Message("/bad", "nav_msgs/msg/Odometry", scene.stamp(0), b"\0\1\0\0abc")
        parts = {**scene.whole(), "bad": [broken]}
        opened(tmp_path, parts, pose_topic=scene.ODOM)
        with pytest.raises(RecordingError, match="message 0: it ends inside its header"):
            opened(tmp_path, parts, pose_topic="/bad")


class TestCamera:
    def test_an_uncalibrated_camera_is_no_camera(self, tmp_path: Path) -> None:
        parts = {**scene.whole(), "infos": scene.infos(k=(0,) * 9)}
        with pytest.raises(RecordingError, match=r"no camera model: .*not calibrated"):
            opened(tmp_path, parts)

    @pytest.mark.parametrize(
        ("topic", "options"),
        [("/cam/image_rect/compressed", {}), ("/cam/image/compressed", {"rectified": True})],
    )
    def test_rectified_images_take_p(
        self, tmp_path: Path, topic: str, options: dict[str, object]
    ) -> None:
        parts = {**scene.whole(), "images": scene.images(topic)}
        camera = opened(tmp_path, parts, **options).rig.camera
        assert (camera.pinhole.fx_px, camera.lens) == (40.0, "none")

    def test_camera_info_that_changes_is_a_warning(self, tmp_path: Path) -> None:
        parts = scene.whole()
        later = messages.camera_info(scene.stamp(3), k=(51, 0, 31.5, 0, 50, 23.5, 0, 0, 1))
        same = messages.camera_info(scene.stamp(4))
        kind = parts["infos"][0]
        parts["infos"] += [
            kind._replace(log_time_ns=scene.stamp(3), payload=later),
            kind._replace(log_time_ns=scene.stamp(4), payload=same),
        ]
        recording = opened(tmp_path, parts)
        assert recording.rig.camera.pinhole.fx_px == 50.0
        assert "1 CameraInfo messages differ" in recording.notes.warnings[-1]

    def test_a_rig_file_overrides_camera_and_extrinsics(self, tmp_path: Path) -> None:
        rig = tmp_path / "rig.toml"
        rig.write_text(
            "camera_time_offset_s = 0.25\nmap_up = [0, 0, 2]\n"
            "[sensors]\nlidar = 'Livox Avia'\n"
            "[camera]\nwidth_px = 64\nheight_px = 48\nfx_px = 60\nfy_px = 61\ncx_px = 30\n"
            "cy_px = 20\nlens = 'fisheye'\ncoefficients = [0.1, 0, 0, 0]\n"
            "[extrinsics]\nT_lidar_camera = {translation_m = [7, 8, 9], "
            "quaternion_xyzw = [0, 0, 0, 1]}\n"
        )
        recording = opened(tmp_path, scene.whole(), rig=read_rig(rig))
        assert recording.rig.camera.lens == "fisheye"
        assert recording.rig.T_body_camera[:3, 3].tolist() == [7, 8, 9]
        assert recording.rig.camera_time_offset_ns == 250_000_000
        assert (recording.rig.lidar_name, recording.rig.camera_name) == ("Livox Avia", "camera")
        assert recording.notes.map_up == (0.0, 0.0, 1.0)

    @pytest.mark.parametrize(
        ("topic", "rectified"), [("/cam/image_rect_color/compressed", False), (scene.CAMERA, True)]
    )
    def test_a_rig_files_lens_is_not_applied_to_rectified_images(
        self, tmp_path: Path, topic: str, rectified: bool
    ) -> None:
        pinhole = PinholeCamera(64, 48, 60.0, 61.0, 30.0, 20.0)
        rig = RigFile(camera=LensCamera(pinhole, "plumb_bob", (0.1, 0.0, 0.0, 0.0, 0.0)))
        parts = {**scene.whole(), "images": scene.images(topic)}
        recording = opened(tmp_path, parts, rig=rig, rectified=rectified)
        assert (recording.rig.camera.lens, recording.rig.camera.pinhole) == ("none", pinhole)
        assert any("plumb_bob, is not applied" in said for said in recording.notes.warnings)
        assert recording.notes.reading["rectified"] == "yes"

        raw = opened(tmp_path, scene.whole(), rig=rig)
        assert raw.rig.camera.lens == "plumb_bob"
        assert not any("not applied" in said for said in raw.notes.warnings)
        assert raw.notes.reading["rectified"] == "no"


class TestPoses:
    def stamped(self, kind: str) -> list[scene.Message]:
        return [
            scene.Message(
                "/pose",
                f"geometry_msgs/msg/{kind}",
                scene.stamp(i),
                messages.pose_stamped(scene.stamp(i), (i, 0, 0, 0, 0, 0, -1)) + bytes(288),
            )
            for i in range(scene.SCANS)
        ]

    @pytest.mark.parametrize("kind", ["PoseStamped", "PoseWithCovarianceStamped"])
    def test_stamped_poses_need_their_body(self, tmp_path: Path, kind: str) -> None:
        parts = {**scene.whole(), "poses": self.stamped(kind)}
        with pytest.raises(UsageError, match="does not say what") as caught:
            opened(tmp_path, parts)
        assert "--pose-of camera, lidar or imu" in caught.value.fix

        of_camera = opened(tmp_path, parts, pose_of="camera")
        assert np.array_equal(of_camera.rig.T_body_camera, np.eye(4))
        assert of_camera.rig.T_lidar_camera[:3, 3] == pytest.approx([1, 2, 3])
        assert of_camera.rig.body == "camera"
        assert of_camera.trajectory.translations_m[4].tolist() == [4, 0, 0]
        assert of_camera.trajectory.quaternions_xyzw[4].tolist() == [0, 0, 0, 1]
        of_lidar = opened(tmp_path, parts, pose_of="lidar")
        assert np.array_equal(of_lidar.rig.T_body_lidar, np.eye(4))

    def paths(self, parts: list[list[int]], *, frame: str = "odom") -> list[scene.Message]:
        """Paths of the given poses; x is the pose's number, y that of the last message with it."""
        return [
            scene.Message(
                "/path",
                "nav_msgs/msg/Path",
                scene.stamp(number),
                messages.path(
                    scene.stamp(number),
                    [(scene.stamp(i) + 3, (i, number, 0, 0, 0, 0, 1)) for i in numbers],
                    frame=frame,
                ),
            )
            for number, numbers in enumerate(parts)
        ]

    @pytest.mark.parametrize("frame", ["o", "od", "odo", "odom", "odom1"])  # each pads otherwise
    def test_a_sliding_window_of_paths_loses_no_pose(self, tmp_path: Path, frame: str) -> None:
        windows = [list(range(i, i + 5)) for i in range(scene.SCANS - 4)]
        parts = {**scene.whole(), "poses": self.paths(windows, frame=frame)}
        recording = opened(tmp_path, parts, pose_of="lidar")
        xyz_m = recording.trajectory.translations_m
        assert xyz_m[:, 0].tolist() == list(range(scene.SCANS))
        assert xyz_m[:, 1].tolist() == [min(i, 15) for i in range(scene.SCANS)]
        assert any("15 of 20 poses" in warning for warning in recording.notes.warnings)

    def test_of_paths_that_overlap_the_later_pose_holds(self, tmp_path: Path) -> None:
        parts = {**scene.whole(), "poses": self.paths([[0, 2, 4, 6], [2, 3, 4], [6, 8], [3]])}
        xyz_m = opened(tmp_path, parts, pose_of="lidar").trajectory.translations_m
        assert xyz_m[:, 0].tolist() == [0, 2, 3, 4, 6, 8]
        assert xyz_m[:, 1].tolist() == [0, 1, 3, 1, 2, 2]

    def test_a_growing_path_is_no_reason_to_warn(self, tmp_path: Path) -> None:
        parts = {**scene.whole(), "poses": self.paths([[], [0], list(range(8)), list(range(20))])}
        recording = opened(tmp_path, parts, pose_of="lidar")
        assert recording.trajectory.translations_m[:, 1].tolist() == [3.0] * 20
        assert not any("Path" in warning for warning in recording.notes.warnings)

    def test_a_path_whose_own_stamps_step_back_is_refused(self, tmp_path: Path) -> None:
        parts = {**scene.whole(), "poses": self.paths([[0, 1, 2], [0, 2, 1]])}
        with pytest.raises(RecordingError, match=r"pose 2 is stamped .* earlier than") as caught:
            opened(tmp_path, parts, pose_of="lidar")
        assert "--pose-topic" in caught.value.fix

    def test_a_cut_path_is_a_damaged_message(self, tmp_path: Path) -> None:
        parts = {**scene.whole(), "poses": self.paths([[0, 1, 2], list(range(9))])}
        parts["poses"][1] = parts["poses"][1]._replace(payload=parts["poses"][1].payload[:-9])
        with pytest.raises(RecordingError, match="message 1: ") as caught:
            opened(tmp_path, parts, pose_of="lidar")
        assert caught.value.where.endswith("/path")

    def test_paths_of_several_lengths_come_with_their_own_stamps(self, tmp_path: Path) -> None:
        poses = [(scene.stamp(i) + 3, (i, 0, 0, 0, 0, 0, 1)) for i in range(scene.SCANS)]
        lengths = [3, 20, 12, 20, 5]
        parts = {
            **scene.whole(),
            "poses": [
                scene.Message(
                    "/path",
                    "nav_msgs/msg/Path",
                    scene.stamp(i),
                    messages.path(scene.stamp(i), poses[:length]),
                )
                for i, length in enumerate(lengths)
            ],
        }
        recording = opened(tmp_path, parts, pose_of="lidar")
        assert recording.trajectory.stamps_ns.tolist() == [stamp for stamp, _ in poses]

    @pytest.mark.parametrize(("shift_ns", "says"), [(0, "the same as"), (-5, "earlier than")])
    def test_stamps_that_do_not_rise_are_refused(
        self, tmp_path: Path, shift_ns: int, says: str
    ) -> None:
        parts = scene.whole()
        payload = messages.odometry(scene.stamp(3) + shift_ns)
        parts["poses"][4] = parts["poses"][4]._replace(payload=payload)
        with pytest.raises(
            RecordingError, match=f"pose 4 is stamped .* {says} pose 3 at"
        ) as caught:
            opened(tmp_path, parts)
        assert "1700000000.300000000 s" in caught.value.what

    @pytest.mark.parametrize(
        "pose",
        [(0, 0, 0, 0, 0, 0, 0), (0, 0, 0, 0, 0, 0, 1.002), (np.nan, 0, 0, 0, 0, 0, 1)],
    )
    def test_what_is_no_pose_is_refused(self, tmp_path: Path, pose: tuple[float, ...]) -> None:
        parts = scene.whole()
        payload = messages.odometry(scene.stamp(4), pose)
        parts["poses"][4] = parts["poses"][4]._replace(payload=payload)
        with pytest.raises(RecordingError, match="pose 4 is no pose"):
            opened(tmp_path, parts)

    def test_nearly_unit_quaternions_are_made_unit(self, tmp_path: Path) -> None:
        parts = scene.whole()
        payload = messages.odometry(scene.stamp(4), (0, 0, 0, 0.6, 0, 0, -0.8005))
        parts["poses"][4] = parts["poses"][4]._replace(payload=payload)
        q = opened(tmp_path, parts).trajectory.quaternions_xyzw[4]
        assert abs(float((q * q).sum()) - 1) < 1e-12
        assert q[3] > 0 > q[0]


def moving(links: list[tuple[str, str, float]], count: int = scene.SCANS) -> list[scene.Message]:
    """Tf where each link's child moves along x by its speed a step."""
    return [
        scene.Message(
            "/tf",
            TF,
            scene.stamp(i),
            messages.transforms(
                [
                    (scene.stamp(i), parent, child, (speed * i, 0, 0, 0, 0, 0, 1))
                    for parent, child, speed in links
                ]
            ),
        )
        for i in range(count)
    ]


class TestTf:
    def test_the_moving_link_that_carries_the_sensors_is_the_trajectory(
        self, tmp_path: Path
    ) -> None:
        links = [("/odom", "base", 0.2), ("base", "wheel", 1.0), ("map", "odom", 0.01)]
        parts = {**scene.whole(), "poses": moving(links), "base": scene.static("base", "lidar")}
        recording = opened(tmp_path, parts)
        assert recording.trajectory.translations_m[5, 0] == pytest.approx(1.0)
        assert recording.rig.body == "base"
        assert recording.rig.T_body_lidar[:3, 3] == pytest.approx([1, 2, 3])
        assert "odom -> base; map -> odom moves too" in recording.notes.warnings[-1]
        assert opened(tmp_path, parts, pose_topic="/tf").rig.body == "base"

    def test_no_moving_link_that_carries_lists_what_moves(self, tmp_path: Path) -> None:
        links = [("odom", "drone", 0.2), ("odom", "car", 0.3)]
        parts = {**scene.whole(), "poses": moving(links)}
        for more in ({}, {"pose_of": "lidar"}):
            with pytest.raises(RecordingError, match=r"0 moving links that.*odom -> drone"):
                opened(tmp_path, parts, **more)

    def test_the_only_moving_link_is_taken_where_it_is_said_whose_poses_it_has(
        self, tmp_path: Path
    ) -> None:
        """R3LIVE and FAST-LIVO2 link aft_mapped to nothing that a sensor is stamped with."""
        parts = {**scene.whole(), "poses": moving([("world", "aft_mapped", 0.2)])}
        recording = opened(tmp_path, parts, pose_of="lidar")
        assert recording.trajectory.translations_m[5, 0] == pytest.approx(1.0)
        assert recording.notes.reading["pose_topic"] == "tf: world -> aft_mapped"
        assert np.array_equal(recording.rig.T_body_lidar, np.eye(4))
        assert any("overrides the poses' child frame" in said for said in recording.notes.warnings)
        with pytest.raises(RecordingError, match="nothing says what the poses are poses of") as no:
            opened(tmp_path, parts)
        assert "--pose-of camera, lidar or imu" in no.value.fix

    def test_recorded_poses_of_another_clock_are_moved(self, tmp_path: Path) -> None:
        """A Livox that counts from power-on, beside poses and images that count from 1970."""
        parts = {**scene.whole(), "poses": moving([("odom", "lidar", 0.2)])}
        for poses in (scene.whole()["poses"], parts["poses"]):
            there = opened(tmp_path, {**parts, "poses": poses}).trajectory
            recording = opened(tmp_path, {**parts, "poses": poses}, pose_offset_ns=250_000_001)
            moved = recording.trajectory
            assert set((moved.stamps_ns - there.stamps_ns).tolist()) == {250_000_001}
            assert any("are moved by +0.250000001 s" in said for said in recording.notes.warnings)

    def test_links_on_tf_that_never_move_are_fixed(self, tmp_path: Path) -> None:
        still = [m._replace(topic="/tf") for m in moving([("lidar", "camera", 0.0)])]
        recording = opened(tmp_path, {**scene.whole(), "tf": still})
        assert np.array_equal(recording.rig.T_lidar_camera, np.eye(4))

    def test_a_static_link_that_changes_is_a_warning(self, tmp_path: Path) -> None:
        parts = scene.whole()
        payload = messages.transforms([(0, "lidar", "camera", (5, 0, 0, 0, 0, 0, 1))])
        later = parts["tf"][0]._replace(log_time_ns=scene.stamp(3), payload=payload)
        parts["tf"].append(later)
        recording = opened(tmp_path, parts)
        assert recording.rig.T_body_camera[0, 3] == 5
        assert "tf_static changes lidar -> camera" in recording.notes.warnings[-1]

    def test_a_link_without_rotation_is_left_out(self, tmp_path: Path) -> None:
        parts = scene.whole()
        payload = messages.transforms([(0, "lidar", "junk", (0,) * 7)])
        parts["tf"].append(parts["tf"][0]._replace(payload=payload))
        assert "lidar -> junk" in opened(tmp_path, parts).notes.warnings[-1]


class TestFrames:
    def test_a_chain_of_frames_is_followed(self, tmp_path: Path) -> None:
        parts = scene.whole()
        parts["poses"] = scene.poses(child="base")
        parts["base"] = scene.static("base", "lidar")
        rig = opened(tmp_path, parts).rig
        assert rig.body == "base"
        # base -> lidar -> camera, each (1, 2, 3) and the same rotation: by hand
        assert rig.T_body_camera[:3, 3] == pytest.approx([1 + 3, 2 - 1, 3 - 2])

    def test_no_link_names_both_frames_and_those_known(self, tmp_path: Path) -> None:
        parts = {**scene.whole(), "poses": scene.poses(child="body")}
        with pytest.raises(
            RecordingError, match="nothing links the camera frame 'camera'"
        ) as caught:
            opened(tmp_path, parts)
        assert "'body'" in caught.value.what
        assert "'camera', 'lidar'" in caught.value.what

    def test_pose_of_says_what_an_unlinked_child_is(self, tmp_path: Path) -> None:
        parts = {**scene.whole(), "poses": scene.poses(child="body")}
        assert opened(tmp_path, parts, pose_of="lidar").rig.T_body_camera[0, 3] == pytest.approx(1)

    def test_a_cloud_in_the_parent_frame_is_in_the_map(self, tmp_path: Path) -> None:
        parts = {**scene.whole(), "scans": scene.scans(frame="/odom")}
        recording = opened(tmp_path, parts)
        assert recording.notes.deskew == "registered"
        assert recording.read_scan(0).in_map
        assert recording.point_reach_ns == (0, 0)
        assert recording.rig.T_body_camera[:3, 3] == pytest.approx([1, 2, 3])

    def test_raw_clouds_beside_registered_ones_tell_where_the_lidar_sits(
        self, tmp_path: Path
    ) -> None:
        parts = {
            **scene.whole(),
            "scans": scene.scans("/registered", frame="odom"),
            "raw": scene.scans("/raw", frame="lidar"),
            "moved": scene.scans("/moved", frame="base"),
            "poses": scene.poses(child="base"),
            "base": scene.static("base", "lidar"),
        }
        rig = opened(tmp_path, parts, lidar_topic="/registered").rig
        assert rig.T_body_lidar[:3, 3] == pytest.approx([1, 2, 3])

    def test_a_cloud_in_the_body_frame_is_not_in_the_map(self, tmp_path: Path) -> None:
        recording = opened(tmp_path, scene.whole())
        assert not recording.read_scan(0).in_map
        assert recording.notes.deskew == "unavailable"
        assert "no point times" in recording.notes.warnings[0]

    @pytest.mark.parametrize(("child", "warns"), [("body", True), ("lidar", False)])
    def test_pose_of_against_the_child_frame_is_a_warning(
        self, tmp_path: Path, child: str, warns: bool
    ) -> None:
        parts = {**scene.whole(), "poses": scene.poses(child=child)}
        notes = opened(tmp_path, parts, pose_of="lidar").notes
        said = [warning for warning in notes.warnings if "--pose-of lidar overrides" in warning]
        assert len(said) == warns
        assert not warns or ("'body'" in said[0] and "'lidar'" in said[0])

    def test_several_child_frames_are_refused(self, tmp_path: Path) -> None:
        parts = scene.whole()
        parts["poses"][7] = scene.poses(child="other")[7]
        with pytest.raises(RecordingError, match="several child frames: 'lidar', 'other'"):
            opened(tmp_path, parts)


def cut(parts: Parts, part: str, at: int, by: int = 9) -> Parts:
    """The same parts with the end of one message missing."""
    message = parts[part][at]
    parts[part][at] = message._replace(payload=message.payload[:-by])
    return parts


def with_stamps(unit: float = 1.0, *, field: str = "timestamp") -> list[scene.Message]:
    """Clouds with absolute point times."""
    kinds = [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), (field, "<f8")]
    made = scene.scans()
    for at, message in enumerate(made):
        points = np.ones(30, dtype=kinds)
        points[field] = (scene.stamp(at) / 1e9 + np.arange(30) / 512) * unit
        payload = messages.point_cloud(scene.stamp(at), points)
        made[at] = message._replace(payload=payload)
    return made


def damaged_poses(
    kind: str, stamps: list[int], poses: list[tuple[float, ...]]
) -> list[scene.Message]:
    """Poses as Odometry, as a link of tf, or as a Path that follows a whole one of half of them."""
    at = [scene.stamp(i) for i in range(len(stamps))]
    if kind == "path":
        both = list(zip(stamps, poses, strict=True))
        whole = [(scene.stamp(i), poses[0]) for i in range(10)]
        return [
            scene.Message("/path", "nav_msgs/msg/Path", at[k], messages.path(at[k], part))
            for k, part in ((0, whole), (1, both))
        ]
    rows = list(zip(at, stamps, poses, strict=True))
    if kind == "tf":
        return [
            scene.Message(
                "/tf",
                "tf2_msgs/msg/TFMessage",
                log,
                messages.transforms([(stamp, "odom", "lidar", pose)]),
            )
            for log, stamp, pose in rows
        ]
    return [
        scene.Message(
            scene.ODOM,
            "nav_msgs/msg/Odometry",
            log,
            messages.odometry(stamp, pose, child="lidar", frame="odom"),
        )
        for log, stamp, pose in rows
    ]


class TestDamage:
    """Messages that break their layout inside a container that is whole."""

    @pytest.mark.parametrize("part", ["scans", "images"])
    def test_without_salvage_a_cut_message_names_the_option(
        self, tmp_path: Path, part: str
    ) -> None:
        recording = opened(tmp_path, cut(scene.whole(), part, 7))
        read = recording.read_scan if part == "scans" else recording.read_image
        with pytest.raises(RecordingError, match=r" 7 breaks its own layout") as caught:
            read(7)
        assert not isinstance(caught.value, ImageDecodeError)
        assert "--salvage" in caught.value.fix

    @pytest.mark.parametrize("at", [0, 7])
    def test_under_salvage_a_cut_cloud_is_a_scan_without_points(
        self, tmp_path: Path, at: int
    ) -> None:
        recording = opened(tmp_path, cut(scene.whole(), "scans", at), salvage=True)
        scan = recording.read_scan(at)
        assert (len(scan.points), scan.unreadable, scan.stamp_ns) == (0, True, scene.stamp(at))
        assert not recording.read_scan(at + 1).unreadable
        assert len(recording.read_scan(at + 1).points) == 30

    @pytest.mark.parametrize("at", [0, 7])
    def test_under_salvage_a_cut_image_is_the_builds_to_count(
        self, tmp_path: Path, at: int
    ) -> None:
        recording = opened(tmp_path, cut(scene.whole(), "images", at), salvage=True)
        with pytest.raises(ImageDecodeError, match="layout"):
            recording.read_image(at)
        assert recording.read_image(at + 1).index == at + 1

    def test_an_image_of_another_size_is_itself_at_fault(self, tmp_path: Path) -> None:
        parts = scene.whole()
        parts["images"][6] = scene.images(size=(32, 24))[6]
        with pytest.raises(RecordingError, match="image 6 has 32 x 24 pixels, those") as caught:
            opened(tmp_path, parts).read_image(6)
        assert not isinstance(caught.value, ImageDecodeError)
        assert "--salvage" in caught.value.fix
        assert "CameraInfo" not in str(caught.value)
        with pytest.raises(ImageDecodeError, match="image 6 has 32 x 24 pixels"):
            opened(tmp_path, parts, salvage=True).read_image(6)

    def test_images_of_another_camera_are_refused_even_under_salvage(self, tmp_path: Path) -> None:
        parts = {**scene.whole(), "images": scene.images(size=(32, 24))}
        parts["images"][0] = parts["images"][0]._replace(
            payload=messages.compressed_image(scene.stamp(0), b"\xff\xd8\xff")
        )
        with pytest.raises(RecordingError, match="images have 32 x 24") as caught:
            opened(tmp_path, parts, salvage=True)
        assert "--camera-info-topic" in caught.value.fix

    @pytest.mark.parametrize(("part", "at"), [("tf", 0), ("poses", 3), ("scans", 4), ("images", 4)])
    def test_a_message_cut_in_its_head_is_said_or_counted(
        self, tmp_path: Path, part: str, at: int
    ) -> None:
        parts = scene.whole()
        extra = scene.static("lidar", "spare")[0]
        parts["tf"].insert(0, extra)
        message = parts[part][at]
        parts[part][at] = message._replace(payload=message.payload[:10])
        with pytest.raises(RecordingError, match=r"1 of \d+ messages are damaged") as caught:
            opened(tmp_path, parts)
        assert caught.value.where.endswith(message.topic)
        assert "--salvage" in caught.value.fix

        notes = opened(tmp_path, parts, salvage=True).notes
        assert notes.counts == {"message-damaged": 1}
        assert notes.salvage == "left out as damaged: message-damaged 1"
        assert any(warning.startswith(f"{message.topic}: 1 of") for warning in notes.warnings)

    def test_a_topic_without_a_whole_message_is_refused_even_under_salvage(
        self, tmp_path: Path
    ) -> None:
        parts = scene.whole()
        parts["scans"] = [m._replace(payload=m.payload[:10]) for m in parts["scans"]]
        with pytest.raises(RecordingError, match="20 of 20 messages are damaged") as caught:
            opened(tmp_path, parts, salvage=True)
        assert "--salvage" not in caught.value.fix

    @pytest.mark.parametrize("salvage", [False, True])
    def test_a_wrong_unit_of_point_times_shows_when_opened(
        self, tmp_path: Path, salvage: bool
    ) -> None:
        parts = {**scene.whole(), "scans": with_stamps(1e3)}
        says = r"point cloud 0: field .* before the year 2096"
        with pytest.raises(RecordingError, match=says) as caught:
            opened(tmp_path, parts, salvage=salvage)
        assert "--point-time timestamp:UNIT:REFERENCE" in caught.value.fix
        ours = opened(tmp_path, parts, point_time="timestamp:ms:epoch")
        assert ours.notes.reading["point_time"] == "timestamp:ms:epoch"

    @pytest.mark.parametrize("kind", ["odometry", "tf", "path"])
    @pytest.mark.parametrize("how", ["norm", "nan", "later", "earlier", "same"])
    def test_a_damaged_pose_is_said_or_left_out(self, tmp_path: Path, kind: str, how: str) -> None:
        stamps = [scene.stamp(i) for i in range(scene.SCANS + 1)]
        poses = [(0.1 * i, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0) for i in range(len(stamps))]
        moved = {"later": 10**12, "earlier": -(10**12), "same": -scene.STEP_NS}.get(how, 0)
        stamps[7] += moved
        if not moved:
            poses[7] = (0.7, 0, 0, 0, 0, 0, 2.0 if how == "norm" else float("nan"))
        parts = scene.whole() | {"poses": damaged_poses(kind, stamps, poses)}
        given = {"pose_of": "lidar"} if kind == "path" else {}
        says = "is no pose" if not moved else "is stamped"
        with pytest.raises(RecordingError, match=says) as caught:
            opened(tmp_path, parts, **given)
        assert "--salvage" in caught.value.fix

        recording = opened(tmp_path, parts, salvage=True, **given)
        left = len(recording.trajectory.stamps_ns)
        if kind == "path" and moved:  # the first ten poses came in Paths of their own
            assert recording.notes.counts == {"path-unordered": 1}
            assert left == 10
        else:
            reason = "pose-stamp-astray" if moved else "pose-broken"
            assert recording.notes.counts == {reason: 1}
            assert recording.notes.salvage == f"left out as damaged: {reason} 1"
            assert left == len(stamps) - 1
        assert any("damaged poses are left out" in said for said in recording.notes.warnings)

    def test_poses_that_are_none_throughout_are_refused_even_under_salvage(
        self, tmp_path: Path
    ) -> None:
        stamps = [scene.stamp(i) for i in range(scene.SCANS + 1)]
        poses = [(0.1 * i, 0.0, 0.0, 0.0, 0.0, 0.0, 3.0) for i in range(len(stamps))]
        parts = scene.whole() | {"poses": damaged_poses("odometry", stamps, poses)}
        with pytest.raises(RecordingError, match="pose 0 is no pose"):
            opened(tmp_path, parts, salvage=True)

    @pytest.mark.parametrize("part", ["scans", "poses"])
    def test_a_garbled_frame_id_is_said_or_passed_over(self, tmp_path: Path, part: str) -> None:
        parts = scene.whole()
        garbled = {"scans": scene.scans(frame="lidaq"), "poses": scene.poses(child="lidaq")}
        parts[part][3] = garbled[part][3]
        with pytest.raises(RecordingError, match=r"several (child )?frames"):
            opened(tmp_path, parts)
        recording = opened(tmp_path, parts, salvage=True)
        assert recording.rig.body == "lidar"
        parts[part][6:12] = garbled[part][6:12]  # so many are no damage
        with pytest.raises(RecordingError, match=r"several (child )?frames"):
            opened(tmp_path, parts, salvage=True)

    def test_a_link_without_rotation_is_counted(self, tmp_path: Path) -> None:
        parts = scene.whole()
        payload = messages.transforms([(0, "lidar", "junk", (0,) * 7)])
        parts["tf"].append(parts["tf"][0]._replace(payload=payload))
        assert opened(tmp_path, parts).notes.counts == {"tf-link-broken": 1}


class TestReading:
    def test_it_names_every_choice(self, tmp_path: Path) -> None:
        notes = opened(tmp_path, scene.whole()).notes
        assert notes.counts == {}
        assert notes.reading == {
            "lidar_topic": scene.LIDAR,
            "image_topic": scene.CAMERA,
            "camera_info_topic": scene.INFO,
            "pose_topic": scene.ODOM,
            "pose_of": "lidar",
            "point_time": "none",
            "rectified": "no",
            "registered": "no",
        }

    def test_two_openings_that_differ_differ_here(self, tmp_path: Path) -> None:
        parts = {
            **scene.whole(),
            "scans": with_stamps(),
            "rear": scene.scans("/rear"),
            "side": scene.images("/cam/side/compressed"),
            "info": scene.infos("/cam/other_info"),
            "slam": scene.poses("/slam"),
        }
        usual = {
            "lidar_topic": scene.LIDAR,
            "image_topic": scene.CAMERA,
            "camera_info_topic": scene.INFO,
            "pose_topic": scene.ODOM,
        }
        first = opened(tmp_path, parts, **usual).notes.reading
        assert first["point_time"] == "timestamp:s:epoch"
        for name, value in [
            ("lidar_topic", "/rear"),
            ("image_topic", "/cam/side/compressed"),
            ("camera_info_topic", "/cam/other_info"),
            ("pose_topic", "/slam"),
            ("pose_of", "camera"),
            ("point_time", "none"),
            ("rectified", True),
            ("scans_in", "map"),
        ]:
            other = opened(tmp_path, parts, **{**usual, name: value}).notes.reading
            assert other != first, name

    def test_tf_and_a_rig_file_are_named(self, tmp_path: Path) -> None:
        pinhole = PinholeCamera(64, 48, 60.0, 61.0, 30.0, 20.0)
        parts = {**scene.whole(), "poses": moving([("odom", "lidar", 0.2)])}
        reading = opened(tmp_path, parts, rig=RigFile(camera=LensCamera(pinhole))).notes.reading
        assert reading["pose_topic"] == "tf: odom -> lidar"
        assert reading["camera_info_topic"] == "rig"

    def test_nanoseconds_and_seconds_are_settled_once(self, tmp_path: Path) -> None:
        recording = opened(tmp_path, {**scene.whole(), "scans": with_stamps(1e9)})
        assert recording.notes.reading["point_time"] == "timestamp:ns:epoch"
        assert recording.read_scan(3).start_ns == pytest.approx(scene.stamp(3), abs=512)
