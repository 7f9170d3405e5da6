"""Where the LiDAR sits on the IMU."""

from __future__ import annotations

import numpy as np
import pytest

from civil_rgbd.errors import RecordingError
from civil_rgbd.odometry.mount import horizontal_view_deg, lidar_on_imu

from .walks import ROOM, Walk


def test_what_the_recording_says_comes_first() -> None:
    T_imu_lidar, words = lidar_on_imu(Walk(ROOM))

    assert np.array_equal(T_imu_lidar, np.eye(4))
    assert "as the rig file or tf says" in words


def test_a_livox_without_a_word_is_taken_for_an_avia_and_that_is_said() -> None:
    T_imu_lidar, words = lidar_on_imu(Walk(ROOM, T_imu_lidar=None))

    assert T_imu_lidar[:3, 3].tolist() == [0.04165, 0.02326, -0.0284]
    assert "Livox Avia, from its manual" in words
    assert "--rig" in words


def test_another_sensor_without_a_word_is_refused() -> None:
    with pytest.raises(RecordingError, match="nothing links the LiDAR to the IMU") as info:
        lidar_on_imu(Walk(ROOM, T_imu_lidar=None, is_livox=False))

    assert "T_imu_lidar" in info.value.fix


def test_the_view_is_told_from_the_azimuths() -> None:
    angles = np.radians(np.arange(-34, 35))
    fan = np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)], axis=1)

    assert horizontal_view_deg(fan) == pytest.approx(70, abs=5)
    assert horizontal_view_deg(np.concatenate([fan, -fan])) == pytest.approx(140, abs=10)
