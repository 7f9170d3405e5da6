"""Jumps of drawn trajectories, and clouds of a room moved by known amounts."""

from __future__ import annotations

import numpy as np
import pytest

from civil_rgbd.geometry.trajectory import Trajectory
from civil_rgbd.health.checks import Figure
from civil_rgbd.health.sampling import Stretch
from civil_rgbd.health.steadiness import disagreement, drift_figure, jump_figures


def _walk(rate_hz: int, jump_m: float = 0.0, jerk_deg: float = 0.0) -> dict[str, Figure]:
    t = np.arange(0, 10, 1 / rate_hz)
    places = np.stack([1.2 * t, 0.3 * np.sin(t), 0.02 * np.sin(2 * np.pi * 1.8 * t)], axis=1)
    half = (0.3 * np.sin(2 * np.pi * t / 6) + np.radians(jerk_deg) * (t > 5)) / 2
    turns = np.stack([0 * t, 0 * t, np.sin(half), np.cos(half)], axis=1)
    places[t > 5] += [0.0, jump_m, 0.0]
    trajectory = Trajectory(np.rint(t * 1e9).astype(np.int64), places, turns)
    return {figure.code: figure for figure in jump_figures(trajectory)}


@pytest.mark.parametrize("rate_hz", [10, 50, 200])
def test_a_walk_with_steps_and_sway_has_no_jump(rate_hz: int) -> None:
    assert not any(figure.found for figure in _walk(rate_hz).values())


@pytest.mark.parametrize("rate_hz", [10, 50, 200])
def test_a_jump_twice_the_limit_is_found_and_placed(rate_hz: int) -> None:
    figure = _walk(rate_hz, jump_m=0.2)["pose-jump"]

    assert figure.found
    assert figure.detail.startswith(("4.9", "5.0"))


@pytest.mark.parametrize("rate_hz", [50, 200])
def test_a_sudden_turn_is_found(rate_hz: int) -> None:
    figure = _walk(rate_hz, jerk_deg=2.0)["pose-jerk"]

    assert figure.value == pytest.approx(2.0, abs=0.3)


@pytest.mark.parametrize("degrees", [0.0, 1.5])
def test_sparse_poses_do_not_tell_a_sudden_turn_and_are_not_called_fit(degrees: float) -> None:
    figure = _walk(10, jerk_deg=degrees)["pose-jerk"]

    assert figure.value is None
    assert figure.detail.startswith("poses come at 10.0 Hz: between two of them this motion hides ")


def test_a_great_turn_is_found_between_sparse_poses_as_well() -> None:
    assert _walk(10, jerk_deg=5.0)["pose-jerk"].found


def test_a_jump_between_poses_at_5_hz_is_found_or_not_observable() -> None:
    assert _walk(5, jump_m=0.5)["pose-jump"].found
    assert not _walk(5)["pose-jump"].found
    assert _walk(5, jump_m=0.12)["pose-jump"].state != "fit"


def test_poses_that_are_mostly_gaps_show_no_jump() -> None:
    figures = _walk(2)

    assert figures["pose-jump"].value is None
    assert figures["pose-jump"].detail.startswith("poses come at 2.0 Hz")


def test_a_gap_is_no_jump() -> None:
    t = np.concatenate([np.arange(0, 5, 0.005), np.arange(6, 10, 0.005)])
    upright = np.tile([0.0, 0, 0, 1], (len(t), 1))
    places = np.stack([np.where(t < 5.5, t, 3 * t), 0 * t, 0 * t], axis=1)

    jump, _ = jump_figures(Trajectory(np.rint(t * 1e9).astype(np.int64), places, upright))

    assert not jump.found


def _room(rng: np.random.Generator, *, tunnel: bool = False) -> np.ndarray:
    """Points on the floor, two walls and a far one; of a tunnel, not the far one."""
    a, b = rng.uniform(0, 10, (2, 4, 6000))
    noise = rng.normal(0, 0.01, (4, 6000))
    floor = np.stack([a[0], b[0], noise[0]], axis=1)
    left = np.stack([a[1], noise[1], b[1] / 3], axis=1)
    right = np.stack([a[2], 10 + noise[2], b[2] / 3], axis=1)
    far = np.stack([10 + noise[3], a[3], b[3] / 3], axis=1)
    return np.concatenate([floor, left, right] + ([] if tunnel else [far])) + 0.2


def _apart_m(target: np.ndarray, source: np.ndarray) -> float:
    found = disagreement(target, source)
    assert found is not None
    return found[0]


def test_clouds_that_agree_are_apart_by_millimetres() -> None:
    rng = np.random.default_rng(5)

    apart_m = _apart_m(_room(rng), _room(rng))

    assert apart_m < 0.005


@pytest.mark.parametrize("shift", [(0.2, 0, 0), (0, 0.15, 0), (0, 0, 0.2), (0.1, -0.1, 0.1)])
def test_a_shift_between_clouds_is_measured(shift: tuple[float, float, float]) -> None:
    rng = np.random.default_rng(6)

    apart_m = _apart_m(_room(rng), _room(rng) + shift)

    assert apart_m == pytest.approx(np.sqrt(np.square(shift).sum()), abs=0.02)


def test_along_a_tunnel_nothing_is_known_and_nothing_said() -> None:
    rng = np.random.default_rng(7)
    first, second = _room(rng, tunnel=True), _room(rng, tunnel=True)

    along = _apart_m(first, second + np.array([0.2, 0, 0]))
    across = _apart_m(first, second + np.array([0.2, 0, 0.15]))

    assert along < 0.01
    assert across == pytest.approx(0.15, abs=0.02)


def test_clouds_that_share_nothing_are_not_compared() -> None:
    room = _room(np.random.default_rng(8))

    assert disagreement(room, room + 100.0) is None


def _stretch(seconds: float, points: np.ndarray) -> Stretch:
    return Stretch(round(seconds * 1e9), (0,), points, np.zeros(len(points), np.int64))


def test_drift_is_told_per_second_and_from_stretches_apart() -> None:
    rng = np.random.default_rng(9)
    stretches = [_stretch(s, _room(rng) + np.array([0, 0, 0.05 * s])) for s in (0.0, 1.0, 4.0)]

    figure = drift_figure(stretches)

    assert figure.value == pytest.approx(0.05, abs=0.005)
    assert figure.found
    assert "2 pairs compared" in figure.detail


def test_one_stretch_shows_no_drift() -> None:
    figure = drift_figure([_stretch(0.0, _room(np.random.default_rng(10)))])

    assert figure.value is None


def test_a_direction_that_nothing_holds_is_named() -> None:
    rng = np.random.default_rng(11)
    slide = np.array([0.1, 0, 0])
    tunnel = [_stretch(s, _room(rng, tunnel=True) + slide * s) for s in (0.0, 3.0)]
    room = [_stretch(s, _room(rng)) for s in (0.0, 3.0)]

    assert "no plane holds the map's direction (1.00, " in drift_figure(tunnel).detail
    assert "no plane" not in drift_figure(room).detail
