"""Folders of scans with a time list: the lab's layout, others', and what may not fit."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest

from civil_rgbd.conversion.scan_folder import open_recording
from civil_rgbd.converters import open_recording as open_any
from civil_rgbd.domain.recording import Recording, RecordingOptions
from civil_rgbd.errors import CivilRgbdError, RecordingError, UsageError
from civil_rgbd.trajectories.files import read_trajectory_file
from civil_rgbd.trajectories.rig import read_rig

from . import scene
from .cloud_writers import pcd_bytes, ply_bytes

START_S = 1_700_000_000
RIG = """
[camera]
width_px = 64
height_px = 48
fx_px = 50.0
fy_px = 50.0
cx_px = 32.0
cy_px = 24.0

[extrinsics]
T_lidar_camera = [[0, 0, 1, 0.1], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1]]
"""


def folder_of_scans(root: Path, count: int = 12, **more: bytes) -> Path:
    """Scans 1..12 (so that text order is not theirs), images, poses and a rig beside them."""
    scans, images = root / "scans", root / "images"
    scans.mkdir()
    images.mkdir()
    for at in range(count):
        rng = np.random.default_rng(at)
        x, y, z = rng.normal(size=(3, 20)).astype(np.float32)
        x += at + 1
        (scans / f"{at + 1}.pcd").write_bytes(pcd_bytes({"x": x, "y": y, "z": z}))
        (images / f"{at + 1}.jpg").write_bytes(scene.jpeg())
    times = "".join(f"{START_S + at / 10:.6f}\n" for at in range(count))
    (scans / "timestamps.txt").write_text(times)
    (images / "timestamps.txt").write_text(times)
    poses = "".join(
        f"{START_S + at / 10 - 0.05:.3f} {at / 10} 0 0 0 0 0 1\n" for at in range(count + 2)
    )
    (root / "poses.tum").write_text(poses)
    (root / "rig.toml").write_text(RIG)
    for name, data in more.items():
        (scans / name).write_bytes(data)
    return scans


def options(root: Path, **more: object) -> RecordingOptions:
    read = read_trajectory_file(root / "poses.tum")
    given = {
        "rig": read_rig(root / "rig.toml"),
        "trajectory": read.trajectory,
        "trajectory_sources": read.sources,
        "trajectory_note": read.note,
        "pose_of": "lidar",
        "images": root / "images",
        "scans_in": "lidar",
    }
    return RecordingOptions(**given | more)  # type: ignore[arg-type]  # by name


def opened(root: Path, **more: object) -> Recording:
    return open_recording(root / "scans", options(root, **more))


class TestLayout:
    def test_scans_come_in_numeric_order_with_their_stamps(self, tmp_path: Path) -> None:
        folder_of_scans(tmp_path)
        recording = opened(tmp_path)
        assert recording.name == "scans"
        expected = [START_S * 10**9 + at * 10**8 for at in range(12)]
        assert recording.scan_stamps_ns.tolist() == expected
        assert recording.image_stamps_ns.tolist() == expected
        for at in (0, 1, 9, 11):  # 10.pcd is the tenth
            assert recording.read_scan(at).points[:, 0].mean() == pytest.approx(at + 1, abs=1)
            assert recording.read_scan(at).stamp_ns == expected[at]
            assert not recording.read_scan(at).in_map
        assert recording.read_image(3).rgb.shape == (48, 64, 3)
        assert recording.notes.deskew == "unavailable"
        assert recording.point_reach_ns == (0, 0)
        assert any("without de-skewing" in words for words in recording.notes.warnings)

    def test_the_folder_is_known_by_what_is_in_it(self, tmp_path: Path) -> None:
        scans = folder_of_scans(tmp_path)
        assert len(open_any(scans, options(tmp_path)).scan_stamps_ns) == 12

    def test_a_worker_gets_it_whole(self, tmp_path: Path) -> None:
        folder_of_scans(tmp_path)
        recording = opened(tmp_path)
        copy = pickle.loads(pickle.dumps(recording))  # noqa: S301  # our own bytes
        np.testing.assert_array_equal(copy.read_scan(2).points, recording.read_scan(2).points)
        np.testing.assert_array_equal(copy.read_image(2).rgb, recording.read_image(2).rgb)

    def test_every_file_is_a_source_and_no_path_is_named(self, tmp_path: Path) -> None:
        folder_of_scans(tmp_path)
        sources = opened(tmp_path).sources
        assert [(source.name, source.converter) for source in sources] == [
            ("scans", "scans"),
            ("timestamps.txt", "times"),
            ("poses.tum", "trajectory-tum"),
            ("images", "images"),
            ("timestamps.txt", "times"),
        ]
        assert not any(str(tmp_path) in words for words in opened(tmp_path).notes.warnings)

    def test_poses_and_their_body_are_on_record(self, tmp_path: Path) -> None:
        folder_of_scans(tmp_path)
        recording = opened(tmp_path)
        assert recording.rig.body == "lidar"
        assert "poses.tum (tum): poses of the lidar at the instant of their own" in " ".join(
            recording.notes.warnings
        )

    def test_a_trajectory_that_is_too_short_is_reported(self, tmp_path: Path) -> None:
        folder_of_scans(tmp_path)
        text = (tmp_path / "poses.tum").read_text().splitlines()
        (tmp_path / "poses.tum").write_text("\n".join(text[:6]))
        warnings = " ".join(opened(tmp_path).notes.warnings)
        assert "shorter than the scan: 5 of 12 scans" in warnings

    def test_registered_scans_are_neither_moved_nor_deskewed(self, tmp_path: Path) -> None:
        folder_of_scans(tmp_path)
        (tmp_path / "rig.toml").write_text(RIG.split("[extrinsics]", maxsplit=1)[0])
        recording = opened(tmp_path, scans_in="map", pose_of="camera")
        assert recording.read_scan(0).in_map
        assert recording.notes.reading == {
            "point_time": "none",
            "image_topic": "files",
            "camera_info_topic": "rig",
            "pose_topic": "file",
            "pose_of": "camera",
            "rectified": "no",
            "registered": "yes",
        }
        assert recording.notes.deskew == "registered"
        np.testing.assert_array_equal(recording.rig.T_body_camera, np.eye(4))

    def test_point_times_and_tags_are_read(self, tmp_path: Path) -> None:
        scans = folder_of_scans(tmp_path)
        for at in range(12):
            x = np.full(5, 7.0, dtype=np.float32)
            columns = {"x": x, "y": x, "z": x, "t": np.arange(5, dtype=np.uint32) * 1000}
            columns |= {"tag": np.array([0, 1, 0, 4, 16], dtype=np.uint8)}  # type: ignore[dict-item]  # other types
            (scans / f"{at + 1}.pcd").write_bytes(pcd_bytes(columns, "ascii"))
        recording = opened(tmp_path)
        scan = recording.read_scan(4)
        assert scan.point_stamps_ns is not None
        assert (scan.point_stamps_ns - scan.stamp_ns).tolist() == [0, 1000, 2000, 3000, 4000]
        assert scan.noise is not None
        assert scan.noise.tolist() == [False, True, False, True, False]
        assert recording.point_reach_ns == (0, 10**9)
        ignored = opened(tmp_path, point_time="none").notes
        assert ignored.deskew == "unavailable"
        assert ignored.reading["point_time"] == "none"

    def test_names_bring_stamps_and_files_together(self, tmp_path: Path) -> None:
        scans = folder_of_scans(tmp_path)
        (tmp_path / "times.csv").write_text(f"scan,s\n2.pcd,{START_S}.1\n1,{START_S}.2\n")
        recording = opened(tmp_path, scan_times=tmp_path / "times.csv")
        assert recording.read_scan(0).points[:, 0].mean() == pytest.approx(2, abs=1)
        assert recording.notes.counts == {"scan-file-without-stamp": 10}
        (tmp_path / "times.csv").write_text(f"13.pcd,{START_S}.1\n")
        with pytest.raises(RecordingError, match=r"names '13\.pcd', which is not among the 12"):
            opened(tmp_path, scan_times=tmp_path / "times.csv")
        assert scans.is_dir()

    def test_one_file_is_a_recording_of_one_scan(self, tmp_path: Path) -> None:
        scans = folder_of_scans(tmp_path)
        (tmp_path / "one.txt").write_text(f"{START_S}.3\n")
        given = options(tmp_path, scan_times=tmp_path / "one.txt")
        recording = open_any(scans / "4.pcd", given)
        assert recording.scan_stamps_ns.tolist() == [START_S * 10**9 + 3 * 10**8]
        assert recording.name == "4"

    def test_the_folder_of_an_image_may_lack_some_stamps(self, tmp_path: Path) -> None:
        folder_of_scans(tmp_path)
        (tmp_path / "t.csv").write_text("".join(f"{at}.jpg,{START_S}.{at}\n" for at in range(1, 9)))
        recording = opened(tmp_path, image_times=tmp_path / "t.csv")
        assert len(recording.image_stamps_ns) == 8
        assert recording.notes.counts == {"image-file-without-stamp": 4}


class TestWhatDoesNotFit:
    @pytest.mark.parametrize(
        ("more", "words"),
        [
            ({"scans_in": None}, "which frame their points are in"),
            ({"trajectory": None}, "holds no poses"),
            ({"pose_of": None}, "does not say what its poses are poses of"),
            ({"images": None}, "holds no images"),
            ({"images": None, "image_times": Path("t.txt")}, "there are no images"),
            ({"lidar_topic": "/a"}, "--lidar-topic chooses nothing"),
            ({"pose_topic": "/a"}, "--pose-topic chooses nothing"),
            ({"point_time": "t:ns:header"}, "field that the clouds do not have"),
        ],
    )
    def test_an_option_that_is_missing_or_too_many_is_named(
        self, tmp_path: Path, more: dict[str, object], words: str
    ) -> None:
        folder_of_scans(tmp_path)
        with pytest.raises(UsageError, match=words):
            opened(tmp_path, **more)

    def test_a_rig_without_camera_or_mounting_is_refused(self, tmp_path: Path) -> None:
        folder_of_scans(tmp_path)
        (tmp_path / "rig.toml").write_text(RIG.split("[extrinsics]", maxsplit=1)[0])
        with pytest.raises(RecordingError, match="nothing links the camera frame"):
            opened(tmp_path)
        (tmp_path / "rig.toml").write_text("")
        with pytest.raises(RecordingError, match="no camera model"):
            opened(tmp_path)

    def test_a_body_in_the_rig_needs_no_other_word(self, tmp_path: Path) -> None:
        folder_of_scans(tmp_path)
        rows = "[[1, 0, 0, 0.5], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]"
        (tmp_path / "rig.toml").write_text(RIG + f"T_body_lidar = {rows}\n")
        recording = opened(tmp_path, pose_of=None)
        assert recording.rig.T_body_lidar[0, 3] == 0.5
        assert recording.rig.T_body_camera[0, 3] == pytest.approx(0.6)

    def test_clocks_that_do_not_overlap_are_shown(self, tmp_path: Path) -> None:
        scans = folder_of_scans(tmp_path)
        (scans / "timestamps.txt").write_text("".join(f"{at / 10}\n" for at in range(12)))
        with pytest.raises(RecordingError, match=r"do not overlap.*point clouds 0\.000 to 1\.1"):
            opened(tmp_path)

    @pytest.mark.parametrize(
        ("name", "text", "words"),
        [
            ("timestamps.txt", "1\n2\n", "12 files in 'scans', but 2 stamps"),
            ("timestamps.txt", "", "holds no stamp"),
        ],
    )
    def test_a_list_of_another_length_is_refused(
        self, tmp_path: Path, name: str, text: str, words: str
    ) -> None:
        scans = folder_of_scans(tmp_path)
        (scans / name).write_text(text)
        with pytest.raises(RecordingError, match=words):
            opened(tmp_path)

    def test_a_folder_without_a_list_is_told_where_to_put_it(self, tmp_path: Path) -> None:
        scans = folder_of_scans(tmp_path)
        (scans / "timestamps.txt").unlink()
        with pytest.raises(RecordingError, match="no time list") as caught:
            opened(tmp_path)
        assert "--scan-times" in caught.value.fix
        (tmp_path / "images/timestamps.txt").rename(scans / "timestamps.txt")
        with pytest.raises(RecordingError, match="no time list") as caught:
            opened(tmp_path)
        assert "--image-times" in caught.value.fix

    def test_several_kinds_of_scans_are_not_mixed(self, tmp_path: Path) -> None:
        x = np.ones(3, dtype=np.float32)
        folder_of_scans(tmp_path, **{"13.ply": ply_bytes({"x": x, "y": x, "z": x})})
        with pytest.raises(RecordingError, match=r"several kinds: \.pcd, \.ply"):
            opened(tmp_path)

    def test_images_of_another_size_are_refused_at_once(self, tmp_path: Path) -> None:
        folder_of_scans(tmp_path)
        (tmp_path / "images/1.jpg").write_bytes(scene.jpeg((32, 24)))
        with pytest.raises(RecordingError, match="images have 32 x 24 pixels, the rig's camera 64"):
            opened(tmp_path)

    def test_an_image_that_cannot_be_decoded_is_the_builds_to_count(self, tmp_path: Path) -> None:
        folder_of_scans(tmp_path)
        (tmp_path / "images/1.jpg").write_bytes(scene.jpeg()[:200])
        recording = opened(tmp_path)
        with pytest.raises(CivilRgbdError, match="cannot be decoded"):
            recording.read_image(0)

    def test_a_scan_without_coordinates_is_refused_by_name(self, tmp_path: Path) -> None:
        scans = folder_of_scans(tmp_path)
        (scans / "2.pcd").write_bytes(pcd_bytes({"a": np.ones(3, dtype=np.float32)}))
        with pytest.raises(RecordingError, match="no column 'x'; its columns are 'a'") as caught:
            opened(tmp_path).read_scan(1)
        assert caught.value.where.endswith("2.pcd")


class TestBrokenScans:
    """One file of many is cut: said, or left out and counted."""

    @pytest.mark.parametrize("at", [0, 5])
    def test_without_salvage_the_file_is_named_and_so_is_the_option(
        self, tmp_path: Path, at: int
    ) -> None:
        path = folder_of_scans(tmp_path) / f"{at + 1}.pcd"
        path.write_bytes(path.read_bytes()[:-40])
        with pytest.raises(RecordingError, match="the scan breaks its own layout") as caught:
            opened(tmp_path).read_scan(at)
        assert caught.value.where == str(path)
        assert "--salvage" in caught.value.fix

    @pytest.mark.parametrize("at", [0, 5])
    def test_under_salvage_it_is_a_scan_without_points(self, tmp_path: Path, at: int) -> None:
        path = folder_of_scans(tmp_path) / f"{at + 1}.pcd"
        path.write_bytes(path.read_bytes()[:-40])
        recording = opened(tmp_path, salvage=True)
        scan = recording.read_scan(at)
        assert (len(scan.points), scan.unreadable) == (0, True)
        assert scan.stamp_ns == recording.scan_stamps_ns[at]
        assert not recording.read_scan(at + 1).unreadable

    def test_a_folder_without_a_whole_scan_is_refused_even_under_salvage(
        self, tmp_path: Path
    ) -> None:
        for path in folder_of_scans(tmp_path).glob("*.pcd"):
            path.write_bytes(b"# .PCD v0.7\n")
        with pytest.raises(RecordingError, match="the scan breaks its own layout"):
            opened(tmp_path, salvage=True)

    def test_a_wrong_unit_shows_when_opened(self, tmp_path: Path) -> None:
        scans = folder_of_scans(tmp_path)
        columns = {name: np.ones(5, np.float32) for name in "xyz"}
        columns |= {"time": np.full(5, 1e4, np.float32)}
        (scans / "1.pcd").write_bytes(pcd_bytes(columns))
        with pytest.raises(RecordingError, match="are more than 1 s from their header") as caught:
            opened(tmp_path, salvage=True)
        assert "--point-time" in caught.value.fix
