"""Transforms in words."""

from __future__ import annotations

import numpy as np

from civil_rgbd.geometry.words import extrinsics_in_words, mounting_in_words


def test_extrinsics_that_are_askew_are_said_by_their_nearest_axes() -> None:
    tilt = np.radians(30)
    T = np.eye(4)
    T[:3, :3] = [
        [1, 0, 0],
        [0, np.cos(tilt), -np.sin(tilt)],
        [0, np.sin(tilt), np.cos(tilt)],
    ]

    words = extrinsics_in_words(T)

    assert "looks along its +z (30.0 deg off)" in words
    assert "its right is +x (0.0 deg off)" in words
    assert "its down is +y (30.0 deg off)" in words


def test_it_says_from_which_sensor_it_is_seen() -> None:
    T = np.eye(4)
    T[:3, 3] = 0.25, -1.5, -0.0

    assert "sits at x 0.250, y -1.500, z 0.000 m of the IMU" in extrinsics_in_words(
        T, seen_from="IMU"
    )


def test_a_mounting_names_where_each_axis_points() -> None:
    T = np.array([[0.0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 2], [0, 0, 0, 1]])

    words = mounting_in_words(T, what="LiDAR", seen_from="IMU")

    assert words == (
        "the LiDAR sits at x 0.000, y 0.000, z 2.000 m of the IMU, its x points along +y "
        "(0.0 deg off), its y along -x (0.0 deg off), its z along +z (0.0 deg off)"
    )
