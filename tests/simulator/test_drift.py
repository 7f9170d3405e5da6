"""What the recording claims of the walk drifts by what the spec says, and starts out true."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from civil_rgbd.simulator.drift import recorded_imu_poses
from civil_rgbd.simulator.recording import SimulatedRecording
from civil_rgbd.simulator.spec import ScanSpec
from civil_rgbd.simulator.truth import write_truth
from civil_rgbd.simulator.walk import imu_poses, pose_stamps_ns

SPEC = ScanSpec(seconds=16.0, drift_m_per_root_s=0.02)


def _errors_m(spec: ScanSpec) -> np.ndarray:
    stamps, places, _ = recorded_imu_poses(spec)
    return places - imu_poses(spec, stamps)[0]


def test_without_drift_the_recording_tells_the_truth() -> None:
    stamps, places, turns = recorded_imu_poses(ScanSpec())
    true_places, true_turns = imu_poses(ScanSpec(), pose_stamps_ns(ScanSpec()))

    np.testing.assert_array_equal(stamps, pose_stamps_ns(ScanSpec()))
    np.testing.assert_array_equal(places, true_places)
    np.testing.assert_array_equal(turns, true_turns)


def test_places_drift_with_the_root_of_time() -> None:
    errors = np.stack([_errors_m(replace(SPEC, seed=s)) for s in range(60)])

    assert (errors[:, 0] == 0).all()
    after_s = {s: float(errors[:, s * 200].std()) for s in (1, 4, 16)}
    for seconds, spread in after_s.items():
        assert spread == pytest.approx(0.02 * np.sqrt(seconds), rel=0.2)


def test_drift_comes_about_smoothly() -> None:
    errors = _errors_m(SPEC)

    assert np.abs(np.diff(errors, axis=0)).max() < 0.02 * 4 * 0.5**0.5 * 3 / 200
    assert np.abs(np.diff(errors, n=2, axis=0)).max() < 5e-5


def test_a_wrong_heading_turns_the_body_and_bends_the_way() -> None:
    spec = replace(SPEC, drift_m_per_root_s=0.0, yaw_drift_deg_per_root_s=1.0)
    stamps, places, turns = recorded_imu_poses(spec)
    true_places, true_turns = imu_poses(spec, stamps)

    wrong = (Rotation.from_quat(turns) * Rotation.from_quat(true_turns).inv()).as_rotvec()
    assert np.abs(wrong[:, :2]).max() < 1e-12  # about the vertical alone
    assert 0.2 < np.degrees(np.abs(wrong[:, 2]).max()) < 15
    np.testing.assert_allclose(places[:, 2], true_places[:, 2], rtol=0, atol=1e-12)
    steps = Rotation.from_rotvec(wrong[:-1]).apply(np.diff(true_places, axis=0))
    np.testing.assert_allclose(np.diff(places, axis=0), steps, rtol=0, atol=1e-12)
    assert (turns[:, 3] >= 0).all()


def test_the_recording_drifts_and_its_truth_does_not(tmp_path: Path) -> None:
    spec = replace(SPEC, seconds=2.0, point_rate_hz=600, image_scale=0.1)
    claimed = SimulatedRecording(spec).trajectory.translations_m

    folder = write_truth(tmp_path / "raw.mcap", spec)
    told = np.loadtxt(folder / "poses.csv", delimiter=",", skiprows=1)[:, 1:4]

    np.testing.assert_array_equal(told, imu_poses(spec, pose_stamps_ns(spec))[0])
    assert np.abs(claimed - told)[-1].max() > 1e-3
