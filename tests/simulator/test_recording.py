"""The simulated recording keeps the contract of every recording."""

from __future__ import annotations

import pickle
from pathlib import Path

import cv2
import numpy as np
import pytest

from civil_rgbd.converters import open_motion
from civil_rgbd.converters import open_recording as open_by_location
from civil_rgbd.domain.motion import MotionRecording
from civil_rgbd.domain.recording import Recording, RecordingOptions
from civil_rgbd.domain.rig import RigFile
from civil_rgbd.errors import UsageError
from civil_rgbd.simulator.camera import simulate_jpeg
from civil_rgbd.simulator.recorder import write_recording
from civil_rgbd.simulator.recording import SimulatedRecording, open_recording
from civil_rgbd.simulator.spec import ScanSpec
from civil_rgbd.simulator.walk import image_instants_ns

SPEC = ScanSpec(seconds=1.0, image_scale=0.25, point_rate_hz=12_000)


def test_it_is_found_by_its_location() -> None:
    recording = open_by_location("simulated:demo?seconds=1&image_scale=0.25&point_rate_hz=12000")

    assert isinstance(recording, SimulatedRecording)
    assert recording.spec == SPEC
    assert recording.name == "demo"


def test_it_fulfils_the_contract() -> None:
    recording: Recording = SimulatedRecording(SPEC)

    assert len(recording.scan_stamps_ns) == len(recording.image_stamps_ns) == 10
    scan, image = recording.read_scan(2), recording.read_image(3)
    assert scan.stamp_ns == recording.scan_stamps_ns[2]
    assert scan.points.shape == (1_200, 3)
    assert scan.point_stamps_ns is not None
    low, high = recording.point_reach_ns
    assert scan.stamp_ns + low <= scan.start_ns < scan.end_ns <= scan.stamp_ns + high
    assert image.index == 3
    assert image.source_stamp_ns == recording.image_stamps_ns[3]
    assert image.rgb.shape == (180, 320, 3)
    assert recording.notes.simulated
    assert recording.notes.map_up == (0.0, 0.0, 1.0)


def test_it_gives_lidar_and_imu_to_odometry_as_its_file_does(tmp_path: Path) -> None:
    write_recording(tmp_path / "raw.mcap", SPEC)

    simulated: MotionRecording = open_motion(
        "simulated:demo?seconds=1&image_scale=0.25&point_rate_hz=12000"
    )
    recorded = open_motion(tmp_path / "raw.mcap")

    assert (simulated.is_livox, simulated.imu.frame) == (recorded.is_livox, recorded.imu.frame)
    np.testing.assert_array_equal(simulated.imu.stamps_ns, recorded.imu.stamps_ns)
    np.testing.assert_array_equal(simulated.imu.forces, recorded.imu.forces)
    np.testing.assert_array_equal(simulated.imu.rates_rad_s, recorded.imu.rates_rad_s)
    assert simulated.T_imu_lidar is not None
    assert recorded.T_imu_lidar is not None
    np.testing.assert_allclose(simulated.T_imu_lidar, recorded.T_imu_lidar, atol=1e-12)
    assert simulated.scan_stamps_ns.tolist() == recorded.scan_stamps_ns.tolist()
    np.testing.assert_array_equal(simulated.read_scan(3).points, recorded.read_scan(3).points)


def test_odometry_takes_no_options_for_it_either() -> None:
    with pytest.raises(UsageError, match="a simulated recording has no topics") as caught:
        open_motion("simulated:demo", RecordingOptions(imu_topic="/imu"))
    assert "leave these options out" in caught.value.fix


def test_its_trajectory_covers_every_point_and_image() -> None:
    recording = SimulatedRecording(SPEC)
    last = recording.read_scan(9).end_ns

    assert recording.trajectory.start_ns <= recording.scan_stamps_ns[0]
    assert last <= recording.trajectory.end_ns
    covered = recording.trajectory.covers(recording.image_stamps_ns, max_gap_ns=250_000_000)
    assert covered.all()


def test_a_pickled_recording_reads_the_same() -> None:
    recording = SimulatedRecording(SPEC)
    recording.read_image(0)
    other = pickle.loads(pickle.dumps(recording))  # noqa: S301 - our own bytes

    np.testing.assert_array_equal(other.read_scan(1).points, recording.read_scan(1).points)
    np.testing.assert_array_equal(other.read_image(1).rgb, recording.read_image(1).rgb)
    assert other.sources == recording.sources


def test_an_image_is_what_its_jpeg_decodes_to_in_red_green_blue() -> None:
    jpeg = np.frombuffer(simulate_jpeg(SPEC, 2), np.uint8)

    rgb = SimulatedRecording(SPEC).read_image(2).rgb

    np.testing.assert_array_equal(rgb[..., ::-1], cv2.imdecode(jpeg, cv2.IMREAD_COLOR))


@pytest.mark.parametrize("offset_s", [0.037, -0.2])
def test_the_stated_time_offset_takes_image_stamps_to_the_lidar_clock(offset_s: float) -> None:
    spec = ScanSpec(seconds=1.0, camera_time_offset_s=offset_s)
    recording = SimulatedRecording(spec)

    corrected = recording.image_stamps_ns + recording.rig.camera_time_offset_ns

    np.testing.assert_array_equal(corrected, image_instants_ns(spec))
    assert (recording.image_stamps_ns < image_instants_ns(spec)).all() == (offset_s > 0)


def test_false_returns_are_known_as_noise() -> None:
    recording = SimulatedRecording(
        ScanSpec(seconds=1.0, point_rate_hz=12_000, false_return_share=0.2)
    )
    noise = recording.read_scan(0).noise

    assert noise is not None
    assert 0.1 < noise.mean() < 0.25


@pytest.mark.parametrize(
    "options",
    [
        RecordingOptions(lidar_topic="/points"),
        RecordingOptions(rig=RigFile(extrinsics={("lidar", "camera"): np.eye(4)})),
        RecordingOptions(rig=RigFile(camera_time_offset_s=0.0)),
    ],
)
def test_options_for_topics_and_rigs_are_refused(options: RecordingOptions) -> None:
    with pytest.raises(UsageError, match="no topics") as caught:
        open_recording("simulated:demo", options)

    assert "civil-rgbd simulate" in caught.value.fix


def test_the_sources_name_the_spec() -> None:
    (source,) = SimulatedRecording(SPEC).sources

    assert source.converter == "simulated"
    assert source.sha256 == SPEC.sha256()
    assert source.size_bytes == len(SPEC.text())
