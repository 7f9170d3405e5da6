"""Angles without a vendor's mathematics library, against those that have one."""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial.transform import Rotation

from civil_rgbd.geometry.angles import (
    quaternions_from_rotation_vectors,
    rotation_from_roll_pitch_yaw,
    sine_and_cosine,
)


def test_sine_and_cosine_are_those_of_the_library() -> None:
    angles = np.linspace(-20, 20, 40_001)
    sine, cosine = sine_and_cosine(angles)
    np.testing.assert_allclose(sine, np.sin(angles), rtol=0, atol=1e-14)
    np.testing.assert_allclose(cosine, np.cos(angles), rtol=0, atol=1e-14)


def test_a_rotation_vector_is_an_axis_times_an_angle() -> None:
    vectors = np.random.default_rng(1).normal(size=(500, 3)) * 2
    expected = Rotation.from_rotvec(vectors).as_quat(canonical=True)
    np.testing.assert_allclose(quaternions_from_rotation_vectors(vectors), expected, atol=1e-14)


def test_no_rotation_and_the_smallest_ones_are_exact() -> None:
    vectors = np.array([[0.0, 0.0, 0.0], [0.0, 1e-12, 0.0], [math.pi, 0.0, 0.0]])
    quaternions = quaternions_from_rotation_vectors(vectors)
    assert quaternions[0].tolist() == [0, 0, 0, 1]
    assert quaternions[1].tolist() == [0, 5e-13, 0, 1]
    np.testing.assert_allclose(np.abs(quaternions[2]), [1, 0, 0, 0], atol=1e-15)


def test_roll_turns_first_and_yaw_last() -> None:
    expected = Rotation.from_euler("xyz", [10, -20, 130], degrees=True).as_matrix()
    np.testing.assert_allclose(rotation_from_roll_pitch_yaw(10, -20, 130), expected, atol=1e-15)
