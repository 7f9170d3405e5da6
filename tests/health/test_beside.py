"""Sources with a LiDAR alone are inspected as bags are: what they hold, and what lies beside."""

from __future__ import annotations

import struct
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest

from civil_rgbd.cli import main
from civil_rgbd.converters import inspect_recording, open_recording
from civil_rgbd.domain.inspection import RecordingSummary
from civil_rgbd.domain.recording import RecordingOptions
from civil_rgbd.errors import CivilRgbdError
from civil_rgbd.health.findings import Finding
from civil_rgbd.health.inspection import findings_of
from civil_rgbd.health.inspection_report import InspectionReport
from civil_rgbd.trajectories.files import read_trajectory_file
from civil_rgbd.trajectories.rig import read_rig

from ..conversion.cloud_writers import pcd_bytes, ply_bytes
from ..conversion.lvx_writer import Packet, cartesian, device, file_bytes
from ..conversion.test_scan_folder import START_S, folder_of_scans, options

FRAME_NS, PACKET_NS = 100_000_000, 400_032


def lvx_file(path: Path, *, frames: Iterable[int] = range(20), devices: int = 1) -> Path:
    xyz = np.round(np.random.default_rng(0).normal(size=(96, 3)) * 10, 3)
    content = []
    for f in frames:
        start = 5 * 10**9 + f * FRAME_NS
        packets = [
            Packet(start + k * PACKET_NS, cartesian(xyz), device=d)
            for k in range(3)
            for d in range(devices)
        ]
        imu = [Packet(start + k * 5_000_000, struct.pack("<6f", *range(6)), 6) for k in range(20)]
        content.append(packets + imu)
    listed = [device(index=at, code=f"3JED{at}") for at in range(devices)]
    path.write_bytes(file_bytes(content, devices=listed))
    return path


def inspected(
    path: Path, options: RecordingOptions | None = None
) -> tuple[RecordingSummary, tuple[Finding, ...]]:
    options = options or RecordingOptions()
    summary = inspect_recording(path, options)
    return summary, findings_of(summary, options)


def errors(findings: tuple[Finding, ...]) -> set[str]:
    return {finding.code for finding in findings if finding.level == "error"}


def assert_agrees_with_a_build(
    path: Path, summary: RecordingSummary, found: set[str], options: RecordingOptions
) -> None:
    assert (summary.refusal is not None) == bool(found)
    if summary.refusal is not None:
        with pytest.raises(CivilRgbdError) as caught:
            open_recording(path, options)
        assert (caught.value.what, caught.value.fix) == (summary.refusal.what, summary.refusal.fix)


class TestLvx:
    def test_each_sensor_says_what_it_holds(self, tmp_path: Path) -> None:
        summary, findings = inspected(lvx_file(tmp_path / "a.lvx"))
        lidar, imu = summary.topics
        assert (lidar.name, lidar.type_name, lidar.messages) == ("3JED0", "Livox Avia", 20)
        assert lidar.stamped is not None
        assert (lidar.stamped.rate_hz, lidar.stamped.first_ns) == (10.0, 5 * 10**9)
        assert lidar.cloud is not None
        assert lidar.cloud.points == 288
        assert lidar.cloud.fields[:3] == (("x", "i4"), ("y", "i4"), ("z", "i4"))
        assert lidar.cloud.point_time is not None
        assert "4.167 us from point to point" in lidar.cloud.point_time
        assert (imu.role, imu.messages) == ("imu", 400)
        assert imu.stamped is not None
        assert imu.stamped.rate_hz == 200.0
        assert errors(findings) == {"no-poses", "no-images", "no-camera-model", "no-camera-link"}
        assert "power-on-clock" in {finding.code for finding in findings}
        said = next(finding for finding in findings if finding.code == "no-poses")
        assert "it has an IMU (3JED0 IMU)" in said.message
        assert_agrees_with_a_build(
            tmp_path / "a.lvx", summary, errors(findings), RecordingOptions()
        )

    def test_a_gap_is_told_with_its_place(self, tmp_path: Path) -> None:
        frames = [*range(5), *range(13, 20)]
        _, findings = inspected(lvx_file(tmp_path / "a.lvx", frames=frames))
        gap = next(finding for finding in findings if finding.code == "cloud-gap")
        assert "1 gap of more than three periods, the longest 0.90 s, 0.4 s after" in gap.message

    def test_several_lidars_are_a_choice(self, tmp_path: Path) -> None:
        path = lvx_file(tmp_path / "a.lvx", devices=2)
        summary, findings = inspected(path)
        said = next(finding for finding in findings if finding.code == "several-lidar-topics")
        assert said.message == "2 LiDARs are in the file: 3JED0, 3JED1"
        assert said.fix == "choose one by its number: --lidar-topic 3JED0"
        _, chosen = inspected(path, RecordingOptions(lidar_topic="3JED1"))
        assert "several-lidar-topics" not in errors(chosen)
        assert summary.messages == 40 + 400

    def test_damage_is_told_and_may_be_salvaged(self, tmp_path: Path) -> None:
        path = lvx_file(tmp_path / "a.lvx")
        path.write_bytes(path.read_bytes()[:-100])
        summary, findings = inspected(path)
        assert "damaged" in errors(findings)
        assert "the file ends at" in summary.damage[0]
        _, salvaged = inspected(path, RecordingOptions(salvage=True))
        assert "damaged" not in errors(salvaged)
        assert "damage-salvaged" in {finding.code for finding in salvaged}


class TestScanFolder:
    def test_a_folder_with_all_beside_it_can_be_built(
        self, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        scans = folder_of_scans(tmp_path)
        given = {"--trajectory": "poses.tum", "--images": "images", "--rig": "rig.toml"}
        words = [word for name, path in given.items() for word in (name, str(tmp_path / path))]
        words += ["--pose-of", "lidar", "--scans-in", "lidar"]
        assert main(["inspect-recording", *words, str(scans)]) == 0
        out = capsys.readouterr().out
        assert "scans: scans, " in out
        assert "12 scans over 1.1 s, whole" in out
        assert "PCD files" in out
        assert "20 points: x y z; no point times" in out
        assert "2023-11-14 22:13:20.000 UTC + 1.100 s: scans" in out
        assert "the camera sits at x 0.100" in out
        assert out.endswith("a build can start\n")

    def test_nothing_beside_it_is_all_told_at_once(self, tmp_path: Path) -> None:
        scans = folder_of_scans(tmp_path)
        (scans / "timestamps.txt").unlink()
        summary, findings = inspected(scans)
        assert errors(findings) == {
            "no-scan-times",
            "scans-in-unknown",
            "no-poses",
            "no-images",
            "no-camera-model",
            "no-camera-link",
        }
        assert_agrees_with_a_build(scans, summary, errors(findings), RecordingOptions())
        assert "over 0.0 s" in InspectionReport(summary, findings).to_text()

    @pytest.mark.parametrize(
        ("change", "code"),
        [
            ({"trajectory": None}, "no-poses"),
            ({"pose_of": None}, "pose-of-unknown"),
            ({"images": None}, "no-images"),
            ({"scans_in": None}, "scans-in-unknown"),
            ({"scan_times": Path("elsewhere.txt")}, "no-scan-times"),
            ({"point_time": "nothing:s:header"}, "point-time-unclear"),
            ({"image_topic": "/camera"}, "build-refuses"),
            ({"pose_of": "imu"}, "no-lidar-link no-camera-link"),
            ({}, ""),
        ],
    )
    def test_what_is_missing_is_told_exactly_when_a_build_refuses(
        self, tmp_path: Path, change: dict[str, object], code: str
    ) -> None:
        scans = folder_of_scans(tmp_path)
        given = options(tmp_path, **change)
        summary, findings = inspected(scans, given)
        assert errors(findings) == set(code.split())
        assert_agrees_with_a_build(scans, summary, errors(findings), given)

    @pytest.mark.parametrize("pose_of", ["camera", "lidar"])
    def test_scans_in_the_map_need_no_link_to_the_lidar(self, tmp_path: Path, pose_of: str) -> None:
        scans = folder_of_scans(tmp_path)
        camera = (tmp_path / "rig.toml").read_text().split("[extrinsics]")[0]
        (tmp_path / "rig.toml").write_text(camera)
        given = options(tmp_path, scans_in="map", pose_of=pose_of)
        summary, findings = inspected(scans, given)
        assert errors(findings) == (set() if pose_of == "camera" else {"no-camera-link"})
        assert_agrees_with_a_build(scans, summary, errors(findings), given)

    def test_scans_that_end_before_the_images_are_told(self, tmp_path: Path) -> None:
        scans = folder_of_scans(tmp_path)
        for path in sorted(scans.glob("*.pcd"), key=lambda path: int(path.stem))[6:]:
            path.unlink()
        stamps = (scans / "timestamps.txt").read_text().splitlines(keepends=True)
        (scans / "timestamps.txt").write_text("".join(stamps[:6]))
        _, findings = inspected(scans, options(tmp_path))
        (gap,) = (finding for finding in findings if finding.code == "cloud-gap")
        assert gap.message == "scans ends 0.50 s before the images do"

    def test_poses_on_another_clock_are_told(self, tmp_path: Path) -> None:
        scans = folder_of_scans(tmp_path)
        from_zero = -START_S * 10**9
        moved = read_trajectory_file(tmp_path / "poses.tum", time_offset_ns=from_zero)
        _, findings = inspected(scans, options(tmp_path, trajectory=moved.trajectory))
        assert errors(findings) == {"clocks-apart"}

    def test_times_of_points_are_told(self, tmp_path: Path) -> None:
        columns = {name: np.ones(5, np.float32) for name in "xyz"} | {"t": np.zeros(5, np.uint32)}
        (tmp_path / "1.ply").write_bytes(ply_bytes(columns, "binary_little_endian"))
        summary, _ = inspected(tmp_path)
        cloud = summary.topics[0].cloud
        assert cloud is not None
        assert cloud.point_time == "t, ns after the header"
        assert summary.topics[0].type_name == "PLY files"

    def test_a_time_in_an_unknown_unit_is_told(self, tmp_path: Path) -> None:
        columns = {name: np.ones(5, np.float32) for name in ("x", "y", "z", "stamp")}
        (tmp_path / "1.pcd").write_bytes(pcd_bytes(columns))
        _, findings = inspected(tmp_path)
        assert "point-time-unclear" in errors(findings)

    def test_a_broken_first_scan_is_told_and_may_be_left_out(self, tmp_path: Path) -> None:
        scans = folder_of_scans(tmp_path)
        (scans / "1.pcd").write_bytes(b"# .PCD v0.7\n")
        _, findings = inspected(scans, options(tmp_path))
        (broken,) = (finding for finding in findings if finding.level == "error")
        assert broken.code == "message-broken"
        assert "1.pcd: the scan breaks its own layout" in broken.message
        assert "--salvage" in broken.fix
        salvaged, after = inspected(scans, options(tmp_path, salvage=True))
        assert not errors(after)
        assert salvaged.topics[0].cloud is not None


def test_a_trajectory_beside_an_lvx_file_is_enough_of_its_own(tmp_path: Path) -> None:
    folder_of_scans(tmp_path)
    poses = "".join(f"{4.9 + at / 10:.1f} 0 0 0 0 0 0 1\n" for at in range(30))
    (tmp_path / "poses.tum").write_text(poses)
    times = "".join(f"{5 + at / 10:.1f}\n" for at in range(12))
    (tmp_path / "images/timestamps.txt").write_text(times)
    path = lvx_file(tmp_path / "a.lvx")
    given = RecordingOptions(
        rig=read_rig(tmp_path / "rig.toml"),
        trajectory=read_trajectory_file(tmp_path / "poses.tum").trajectory,
        pose_of="lidar",
        images=tmp_path / "images",
    )
    summary, findings = inspected(path, given)
    assert not errors(findings)
    assert summary.T_lidar_camera is not None
    assert summary.warnings == open_recording(path, given).notes.warnings
