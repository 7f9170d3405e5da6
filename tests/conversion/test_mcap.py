"""Opening MCAP files: whole, in every container form, and damaged."""

from __future__ import annotations

import hashlib
import pickle
from pathlib import Path

import numpy as np
import pytest
import zstandard
from mcap.writer import CompressionType

from civil_rgbd.conversion.mcap import open_recording
from civil_rgbd.domain.recording import RecordingOptions
from civil_rgbd.errors import RecordingError, UsageError
from civil_rgbd.trajectories.rig import read_rig

from . import messages, scene

SALVAGE = RecordingOptions(salvage=True)


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    return scene.write(tmp_path / "bridge.mcap", scene.whole())


def test_a_whole_recording_tells_its_stamps_rig_and_source(recording: Path) -> None:
    opened = open_recording(recording, RecordingOptions())

    assert opened.name == "bridge"
    assert opened.image_stamps_ns.tolist() == [scene.stamp(i) + 5 for i in range(scene.SCANS)]
    assert opened.scan_stamps_ns.tolist() == [scene.stamp(i) for i in range(scene.SCANS)]
    assert opened.trajectory.stamps_ns[-1] == scene.stamp(scene.SCANS)
    assert opened.trajectory.translations_m[3].tolist() == pytest.approx([0.3, 0, 0])
    (source,) = opened.sources
    assert (source.name, source.converter) == ("bridge.mcap", "mcap")
    assert source.size_bytes == recording.stat().st_size
    assert source.sha256 == hashlib.sha256(recording.read_bytes()).hexdigest()
    assert opened.rig.body == "lidar"
    assert np.array_equal(opened.rig.T_body_lidar, np.eye(4))
    # lidar x forward, y left, z up; camera z forward, x right, y down: looks along the LiDAR's x
    assert opened.rig.T_lidar_camera[:3, 2] == pytest.approx([1, 0, 0])
    assert opened.rig.T_lidar_camera[:3, 0] == pytest.approx([0, -1, 0])
    assert opened.rig.T_lidar_camera[:3, 3] == pytest.approx([1, 2, 3])
    assert opened.notes.salvage is None


def test_scans_and_images_are_decoded_by_number(recording: Path) -> None:
    opened = open_recording(recording)
    rng = np.random.default_rng(5)
    expected = [rng.normal(size=(30, 3)).astype(np.float32) for _ in range(scene.SCANS)]

    for index in (7, 0, 19, 7):
        scan, image = opened.read_scan(index), opened.read_image(index)
        assert np.array_equal(scan.points, expected[index])
        assert scan.stamp_ns == scene.stamp(index)
        assert (image.index, image.source_stamp_ns) == (index, scene.stamp(index) + 5)
        assert np.abs(image.rgb[20, 20].astype(int) - [200, 30, 60]).max() <= 3


def test_a_pickled_recording_reads_on_in_another_process(recording: Path) -> None:
    opened = open_recording(recording)
    opened.read_scan(4)
    travelled = pickle.loads(pickle.dumps(opened))  # noqa: S301 - our own bytes

    assert np.array_equal(travelled.read_scan(4).points, opened.read_scan(4).points)
    assert len(pickle.dumps(opened)) < 10_000  # no chunk travels


@pytest.mark.parametrize("compression", list(CompressionType))
@pytest.mark.parametrize("chunked", [True, False])
@pytest.mark.parametrize("summary", [True, False])
def test_every_container_form_gives_the_same_recording(
    tmp_path: Path, recording: Path, compression: CompressionType, chunked: bool, summary: bool
) -> None:
    expected = open_recording(recording)
    other = open_recording(
        scene.write(
            tmp_path / "other.mcap",
            scene.whole(),
            compression=compression,
            chunked=chunked,
            summary=summary,
            crcs=summary,
        )
    )

    assert np.array_equal(other.image_stamps_ns, expected.image_stamps_ns)
    for index in (0, 11, 19):
        assert np.array_equal(other.read_scan(index).points, expected.read_scan(index).points)
        assert np.array_equal(other.read_image(index).rgb, expected.read_image(index).rgb)


def test_messages_come_in_log_time_order_ties_by_place(tmp_path: Path) -> None:
    parts = scene.whole()
    late_first = [parts["scans"][i]._replace(log_time_ns=scene.stamp(9)) for i in (2, 1)]
    written = [*late_first, *scene.flat({**parts, "scans": parts["scans"][3:]})]
    opened = open_recording(scene.write(tmp_path / "a.mcap", written, chunk_size=500))

    order = [3, 4, 5, 6, 7, 8, 2, 1, 9, *range(10, 20)]
    assert opened.scan_stamps_ns.tolist() == [scene.stamp(i) for i in order]


def test_a_large_message_outside_of_chunks_is_indexed_by_its_head(tmp_path: Path) -> None:
    parts = scene.whole()
    points = np.arange(600_000, dtype=np.float32).reshape(-1, 3)
    big = messages.xyz_cloud(scene.stamp(0), points)
    parts["scans"][0] = parts["scans"][0]._replace(payload=big)
    opened = open_recording(scene.write(tmp_path / "a.mcap", parts, chunked=False))

    assert np.array_equal(opened.read_scan(0).points, points)


def test_topics_without_messages_do_not_count(tmp_path: Path) -> None:
    silent = (
        ("/other/odom", "nav_msgs/msg/Odometry"),
        ("/other/lidar", "sensor_msgs/msg/PointCloud2"),
        ("/other/image", "sensor_msgs/msg/Image"),
        ("/cam/other_info", "sensor_msgs/msg/CameraInfo"),
    )
    opened = open_recording(scene.write(tmp_path / "a.mcap", scene.whole(), silent=silent))
    assert len(opened.scan_stamps_ns) == scene.SCANS


def test_channels_of_one_topic_are_one_stream(tmp_path: Path) -> None:
    parts = scene.whole()
    for i in range(0, scene.SCANS, 2):  # the old spelling registers a second channel
        message = parts["scans"][i]
        parts["scans"][i] = message._replace(type_name="sensor_msgs/PointCloud2")
    opened = open_recording(scene.write(tmp_path / "a.mcap", parts))

    assert opened.scan_stamps_ns.tolist() == [scene.stamp(i) for i in range(scene.SCANS)]


@pytest.mark.parametrize("chunked", [True, False])
def test_messages_compressed_one_by_one_are_read(tmp_path: Path, chunked: bool) -> None:
    plain = scene.whole()
    points = np.random.default_rng(8).normal(size=(200_000, 3)).astype(np.float32)
    big = messages.xyz_cloud(scene.stamp(0), points)
    plain["scans"][0] = plain["scans"][0]._replace(payload=big)
    squeezed = {
        part: [m._replace(payload=zstandard.compress(m.payload)) for m in some]
        for part, some in plain.items()
    }
    recording = open_recording(scene.write(tmp_path / "a.mcap", squeezed, chunked=chunked))

    expected = open_recording(scene.write(tmp_path / "b.mcap", plain))
    assert np.array_equal(recording.image_stamps_ns, expected.image_stamps_ns)
    assert np.array_equal(recording.read_scan(0).points, points)
    assert np.array_equal(recording.read_scan(7).points, expected.read_scan(7).points)
    assert np.array_equal(recording.read_image(7).rgb, expected.read_image(7).rgb)


class TestDamage:
    def test_no_such_file_is_said(self, tmp_path: Path) -> None:
        with pytest.raises(RecordingError, match="there is no such recording"):
            open_recording(tmp_path / "missing.mcap")

    def test_a_folder_of_several_recordings_names_them(self, recording: Path) -> None:
        (recording.parent / "other.mcap").write_bytes(recording.read_bytes())
        with pytest.raises(RecordingError, match=r"recordings: bridge\.mcap, other\.mcap"):
            open_recording(recording.parent)

    def test_a_folder_without_recordings_is_said(self, tmp_path: Path) -> None:
        with pytest.raises(RecordingError, match=r"holds no \.mcap file"):
            open_recording(tmp_path)

    @pytest.mark.parametrize("content", [b"", b"\x89MCAP", b"#ROSBAG V2.0\n" * 10])
    def test_something_else_is_no_mcap(self, tmp_path: Path, content: bytes) -> None:
        path = tmp_path / "other.mcap"
        path.write_bytes(content)
        with pytest.raises(RecordingError, match="no MCAP file"):
            open_recording(path)

    @pytest.mark.parametrize("compression", list(CompressionType))
    def test_a_cut_file_tells_what_is_readable_and_salvage_reads_it(
        self, tmp_path: Path, compression: CompressionType
    ) -> None:
        path = scene.write(tmp_path / "cut.mcap", scene.whole(), compression=compression)
        data = path.read_bytes()
        places = scene.chunk_places(data)
        start, length = places[len(places) // 2]
        path.write_bytes(data[: start + length * 3 // 4])

        with pytest.raises(RecordingError, match=r"cut inside .* messages over .* s are") as caught:
            open_recording(path)
        assert "--salvage" in caught.value.fix
        opened = open_recording(path, SALVAGE)
        assert opened.notes.salvage is not None
        assert "is cut inside a record" in opened.notes.salvage
        count = len(opened.scan_stamps_ns)
        assert 3 < count < scene.SCANS
        assert opened.scan_stamps_ns.tolist() == [scene.stamp(i) for i in range(count)]
        whole = open_recording(scene.write(tmp_path / "whole.mcap", scene.whole()))
        assert np.array_equal(opened.read_scan(count - 1).points, whole.read_scan(count - 1).points)

    def test_messages_of_the_cut_chunk_itself_are_read(self, tmp_path: Path) -> None:
        none = CompressionType.NONE
        path = scene.write(tmp_path / "cut.mcap", scene.whole(), compression=none)
        data = path.read_bytes()
        start, length = scene.chunk_places(data)[3]
        path.write_bytes(data[:start])
        before = len(open_recording(path, SALVAGE).scan_stamps_ns)
        path.write_bytes(data[: start + length - 10])

        after = open_recording(path, SALVAGE)
        assert len(after.scan_stamps_ns) > before
        assert len(after.read_scan(len(after.scan_stamps_ns) - 1).points) == 30

    def test_a_file_without_its_end_is_cut_even_between_records(self, recording: Path) -> None:
        data = recording.read_bytes()
        recording.write_bytes(data[: scene.chunk_places(data)[4][0]])
        with pytest.raises(RecordingError, match="ends there without a footer"):
            open_recording(recording)

    def test_a_cut_summary_loses_nothing_and_is_remarked(self, recording: Path) -> None:
        data = recording.read_bytes()
        recording.write_bytes(data[:-40])
        opened = open_recording(recording)
        assert len(opened.scan_stamps_ns) == scene.SCANS
        assert "no message is lost" in opened.notes.warnings[0]

    def test_a_chunk_whose_checksum_fails_is_left_out_by_salvage(self, tmp_path: Path) -> None:
        path = scene.write(tmp_path / "flip.mcap", scene.whole(), compression=CompressionType.NONE)
        data = bytearray(path.read_bytes())
        start, length = scene.chunk_places(data)[2]
        data[start + length // 2] ^= 0x10
        path.write_bytes(data)

        with pytest.raises(RecordingError, match="its checksum does not hold"):
            open_recording(path)
        opened = open_recording(path, SALVAGE)
        kept = set(opened.scan_stamps_ns.tolist())
        assert scene.stamp(19) in kept
        assert len(kept) < scene.SCANS
        assert f"the chunk at byte {start} is not readable" in str(opened.notes.salvage)

    def test_the_summary_leads_past_a_hole(self, recording: Path) -> None:
        data = bytearray(recording.read_bytes())
        places = scene.chunk_places(data)
        start, length = places[1]
        data[start : start + length] = bytes(length)
        recording.write_bytes(data)

        opened = open_recording(recording, SALVAGE)
        assert scene.stamp(19) in opened.scan_stamps_ns
        assert "has no record where one begins" in str(opened.notes.salvage)

    def test_channels_defined_in_a_lost_chunk_come_from_the_summary(self, recording: Path) -> None:
        data = bytearray(recording.read_bytes())
        start, length = scene.chunk_places(data)[0]
        data[start + length - 50 : start + length - 20] = bytes(30)
        recording.write_bytes(data)

        opened = open_recording(
            recording, RecordingOptions(salvage=True, rig=read_rig(_rig(recording.parent)))
        )
        assert scene.stamp(19) in opened.scan_stamps_ns

    def test_an_unknown_compression_is_named(self, recording: Path) -> None:
        data = recording.read_bytes().replace(b"\x04\x00\x00\x00zstd", b"\x04\x00\x00\x00zstx")
        recording.write_bytes(data)
        with pytest.raises(RecordingError, match="compression 'zstx' is none of") as caught:
            open_recording(recording, SALVAGE)
        assert "mcap convert" in caught.value.fix

    def test_a_file_that_changes_while_open_is_said(self, recording: Path) -> None:
        opened = open_recording(recording)
        with recording.open("ab") as file:
            file.write(b"more")
        with pytest.raises(RecordingError, match="not the one that was opened"):
            opened.read_scan(0)


def _rig(folder: Path) -> Path:
    path = folder / "rig.toml"
    path.write_text(
        "[camera]\nwidth_px = 64\nheight_px = 48\nfx_px = 50.0\nfy_px = 50.0\ncx_px = 31.5\n"
        "cy_px = 23.5\n[extrinsics]\nT_lidar_camera = {translation_m = [0.0, 0.0, 0.0], "
        "quaternion_xyzw = [0.0, 0.0, 0.0, 1.0]}\n"
    )
    return path


class TestMissing:
    @pytest.mark.parametrize(
        ("part", "says", "remedy"),
        [
            ("scans", "no point clouds", "PointCloud2"),
            ("images", "no images", "CompressedImage"),
            ("infos", "no camera model", "--rig"),
            ("poses", "no poses", "--pose-topic"),
            ("tf", "nothing links the camera frame 'camera'", "--rig"),
        ],
    )
    def test_a_missing_part_is_named_with_its_remedy(
        self, tmp_path: Path, part: str, says: str, remedy: str
    ) -> None:
        parts = scene.whole()
        parts[part] = []
        with pytest.raises(RecordingError, match=says) as caught:
            open_recording(scene.write(tmp_path / "a.mcap", parts))
        assert remedy in caught.value.fix

    def test_no_poses_names_every_option(self, tmp_path: Path) -> None:
        path = scene.write(tmp_path / "a.mcap", {**scene.whole(), "poses": []})
        with pytest.raises(RecordingError, match="no poses") as caught:
            open_recording(path)
        for option in ("--trajectory", "`civil-rgbd poses`", "--pose-topic", "--pose-of", "--rig"):
            assert option in caught.value.fix

    def test_messages_of_another_encoding_are_refused(self, tmp_path: Path) -> None:
        path = scene.write(tmp_path / "a.mcap", scene.whole(), encoding="protobuf")
        with pytest.raises(RecordingError, match="message_encoding 'protobuf'") as caught:
            open_recording(path)
        assert "convert" in caught.value.fix

    def test_clocks_that_do_not_overlap_tell_all_ranges(self, tmp_path: Path) -> None:
        parts = scene.whole()
        parts["scans"] = [
            message._replace(payload=messages.xyz_cloud(5 * 10**9 + i, np.ones((2, 3), "f4")))
            for i, message in enumerate(parts["scans"])
        ]
        with pytest.raises(RecordingError, match="clocks do not overlap") as caught:
            open_recording(scene.write(tmp_path / "a.mcap", parts))
        assert "point clouds 5.000 to 5.000 s" in caught.value.what
        assert "images 1700000000.000 to 1700000001.900 s" in caught.value.what
        assert "poses 1700000000.000 to 1700000002.000 s" in caught.value.what
        assert "camera_time_offset_s" in caught.value.fix

    def test_a_time_offset_brings_clocks_together(self, tmp_path: Path) -> None:
        parts = scene.whole()
        shift_ns = scene.START_NS - 5 * 10**9
        parts["scans"] = [
            m._replace(payload=messages.xyz_cloud(scene.stamp(i) - shift_ns, np.ones((2, 3), "f4")))
            for i, m in enumerate(parts["scans"])
        ]
        parts["poses"] = [
            m._replace(payload=messages.odometry(scene.stamp(i) - shift_ns))
            for i, m in enumerate(parts["poses"])
        ]
        rig = tmp_path / "rig.toml"
        rig.write_text(f"camera_time_offset_s = {-shift_ns // 10**9}\n")
        path = scene.write(tmp_path / "a.mcap", parts)

        opened = open_recording(path, RecordingOptions(rig=read_rig(rig)))
        assert opened.rig.camera_time_offset_ns == -shift_ns

    def test_image_size_unlike_camera_info_names_both(self, tmp_path: Path) -> None:
        parts = {**scene.whole(), "infos": scene.infos(size=(128, 96))}
        with pytest.raises(RecordingError, match=r"64 x 48 pixels.*128 x 96"):
            open_recording(scene.write(tmp_path / "a.mcap", parts))

    def test_a_damaged_first_image_is_the_builds_to_count(self, tmp_path: Path) -> None:
        parts = scene.whole()
        parts["images"][0] = parts["images"][0]._replace(
            payload=messages.compressed_image(scene.stamp(0), scene.jpeg()[:-30])
        )
        opened = open_recording(scene.write(tmp_path / "a.mcap", parts))
        with pytest.raises(RecordingError, match="end marker"):
            opened.read_image(0)

    def test_an_unknown_sensor_in_pose_of_is_named(self, recording: Path) -> None:
        with pytest.raises(UsageError, match="no sensor") as caught:
            open_recording(recording, RecordingOptions(pose_of="lidr"))
        assert "'lidar'" in caught.value.fix
