"""How the sensors are carried, against what people do and scipy computes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from civil_rgbd.simulator.gait import Carrying, carried, setting_off
from civil_rgbd.simulator.path import WalkPath

PATH = WalkPath(((-15.0, 0.0, 0.2), (15.0, 0.0, 0.2), (15.0, 2.0, 0.2), (-15.0, 2.0, 0.2)))
HOW = Carrying(speed_m_s=1.0, stands_s=2.0, sway=1.0, seed=0)
T_S = np.arange(0.0, 40.0, 0.005)


def _rates(how: Carrying) -> np.ndarray:
    turns = Rotation.from_quat(carried(PATH, how, T_S)[1])
    return (turns[:-1].inv() * turns[1:]).as_rotvec() / 0.005


def test_one_stands_still_then_sets_off_without_a_jerk() -> None:
    places, turns = carried(PATH, HOW, T_S)
    velocity = np.gradient(places, 0.005, axis=0)
    acceleration = np.gradient(velocity, 0.005, axis=0)

    still = T_S < 1.99
    assert np.ptp(places[still], axis=0).max() == 0
    assert np.ptp(turns[still], axis=0).max() == 0
    assert np.abs(np.diff(acceleration, axis=0)).max() < 0.3  # a g's hundredth a reading: no jump
    assert np.abs(acceleration).max() < 5


def test_full_speed_is_reached_after_a_second_and_a_half() -> None:
    walked, share = setting_off(np.array([0.0, 2.0, 3.5, 13.5]), 2.0)

    np.testing.assert_allclose(walked, [0.0, 0.0, 0.75, 10.75], rtol=0, atol=1e-12)
    assert share.tolist() == [0.0, 0.0, 1.0, 1.0]


def test_the_share_of_full_speed_is_the_slope_of_the_walked_time() -> None:
    walked, share = setting_off(T_S, 2.0)

    np.testing.assert_allclose(np.gradient(walked, 0.005)[1:-1], share[1:-1], rtol=0, atol=1e-4)


def test_the_chest_bobs_at_the_steps_about_its_height_above_the_ground() -> None:
    places, _ = carried(PATH, HOW, T_S)
    height = places[T_S > 5, 2] - 0.2 - PATH.chest_m

    assert np.abs(height).max() == pytest.approx(0.02, abs=0.002)
    spectrum = np.abs(np.fft.rfft(height * np.hanning(len(height))))
    hz = np.fft.rfftfreq(len(height), 0.005)[spectrum.argmax()]
    assert hz == pytest.approx(1.8, abs=0.05)


def test_the_sensors_turn_to_and_fro_as_a_person_turns_them() -> None:
    rates = _rates(HOW)[T_S[:-1] > 4]

    assert 0.2 < np.sqrt((rates**2).sum(axis=1).mean()) < 0.5
    assert ((rates > 0.05).any(axis=0) & (rates < -0.05).any(axis=0)).all()


def test_sway_scales_the_turning_and_none_leaves_the_way_alone() -> None:
    one, half = (np.abs(_rates(replace(HOW, sway=s))[T_S[:-1] > 5]).mean() for s in (1.0, 0.5))
    calm_places, _ = carried(PATH, replace(HOW, sway=0.0), T_S)

    assert 1.3 < one / half < 2.1
    np.testing.assert_allclose(calm_places[:, 2], 0.2 + PATH.chest_m, rtol=0, atol=1e-12)


def test_they_look_where_the_way_goes_and_to_its_side() -> None:
    _, turns = carried(PATH, replace(HOW, sway=0.0), np.array([12.0]))
    facing = Rotation.from_quat(turns).apply([1.0, 0.0, 0.0])[0]

    azimuth, elevation = np.arctan2(facing[1], facing[0]), np.arcsin(facing[2])
    assert np.degrees(azimuth) == pytest.approx(PATH.look_left_deg, abs=0.5)  # along x here
    assert np.degrees(elevation) == pytest.approx(PATH.look_up_deg, abs=1e-6)


def test_the_seed_decides_when_one_looks_where() -> None:
    (first, turns), (second, others) = (
        carried(PATH, replace(HOW, seed=s), T_S[1600:]) for s in (0, 1)
    )

    np.testing.assert_array_equal(first, second)
    assert np.abs(turns - others).max() > 0.05
