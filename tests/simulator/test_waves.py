"""Sines and turns against numpy and scipy."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from civil_rgbd.simulator.waves import chain_turns, cosine, sine, turn_about, turn_towards


def test_sine_and_cosine_agree_with_numpy_over_many_turns() -> None:
    turns = np.linspace(-7.3, 9.1, 10_001)

    np.testing.assert_allclose(sine(turns), np.sin(2 * np.pi * turns), rtol=0, atol=2e-14)
    np.testing.assert_allclose(cosine(turns), np.cos(2 * np.pi * turns), rtol=0, atol=2e-14)


def test_turns_chain_as_scipy_chains_rotations() -> None:
    angles = np.linspace(-3, 3, 11)
    chained = chain_turns(turn_about(2, angles), turn_about(1, angles / 2), turn_about(0, -angles))

    expected = (
        Rotation.from_euler("z", angles[:, None])
        * Rotation.from_euler("y", angles[:, None] / 2)
        * Rotation.from_euler("x", -angles[:, None])
    )
    np.testing.assert_allclose(
        Rotation.from_quat(chained).as_matrix(), expected.as_matrix(), rtol=0, atol=1e-14
    )


def test_a_turn_towards_a_heading_takes_the_x_axis_there_even_backwards() -> None:
    angles = np.linspace(-np.pi, np.pi, 181)
    turned = Rotation.from_quat(turn_towards(3 * np.cos(angles), 3 * np.sin(angles)))

    expected = np.stack([np.cos(angles), np.sin(angles), np.zeros(181)], axis=1)
    np.testing.assert_allclose(turned.apply([1.0, 0.0, 0.0]), expected, rtol=0, atol=1e-13)
    np.testing.assert_allclose(turned.apply([0.0, 0.0, 1.0])[:, 2], 1.0, rtol=0, atol=1e-13)
