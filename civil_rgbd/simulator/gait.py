"""How a person carries the sensors: standing, setting off, stepping, swaying, looking around."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.simulator.path import WalkPath
from civil_rgbd.simulator.waves import chain_turns, sine, turn_about, turn_towards

Floats = NDArray[np.float64]

_SETTING_OFF_S: Final = 1.5
_STEPS_HZ: Final = 1.8
# A step lifts the chest twice as often as it sways it: metres and radians, as inertial sensors on
# the chests of walking people show them.
_BOB_M, _SURGE_M, _SIDE_M = 0.020, 0.008, 0.015
_NOD_RAD, _TWIST_RAD, _ROLL_RAD = 0.008, 0.014, 0.014
_TREMBLE_RAD: Final = 0.0008
_TREMBLE_HZ: Final = (3.1, 4.7, 6.3)
_SWEEP_S: Final = (11.3, 5.3)  # how long the walker takes to look around and back
_SWEEP_SHARES: Final = (0.7, 0.3)


@dataclass(frozen=True, slots=True)
class Carrying:
    """How one walk is walked.

    Attributes:
        speed_m_s: of the walk; 0 stands still.
        stands_s: before setting off.
        sway: of looking around and swaying, 1 = as a person does.
        seed: of when the walker looks where.
        starts_m: how far along the way it begins.
    """

    speed_m_s: float
    stands_s: float
    sway: float
    seed: int
    starts_m: float = 0.0


def setting_off(t_s: Floats, stands_s: float) -> tuple[Floats, Floats]:
    """Return how long one has walked at full speed, in effect, and the share of it now.

    Args:
        t_s: (N,) since the start.
        stands_s: when one sets off.

    Returns:
        (N,) seconds and (N,) 0 to 1, without a jerk.

    >>> setting_off(np.array([1.0, 2.0, 3.5, 10.0]), 2.0)[0].tolist()
    [0.0, 0.0, 0.75, 7.25]
    """
    x = np.clip((t_s - stands_s) / _SETTING_OFF_S, 0.0, 1.0)
    cube = x * x * x
    share = cube * (10 - 15 * x + 6 * x * x)
    eased = _SETTING_OFF_S * x * cube * (2.5 - 3 * x + x * x)
    return eased + np.maximum(t_s - stands_s - _SETTING_OFF_S, 0.0), share


def carried(path: WalkPath, how: Carrying, t_s: Floats) -> tuple[Floats, Floats]:
    """Return where the IMU is carried.

    Args:
        path: the way.
        how: it is walked.
        t_s: (N,) seconds since the start.

    Returns:
        places (N, 3) metres, scene frame; quaternions (N, 4), xyzw.
    """
    walked_s, share = setting_off(t_s, how.stands_s)
    live = share * min(how.speed_m_s, 1.0) * how.sway  # who stands still does not bob
    phases = np.random.default_rng([how.seed, 6]).random(10)
    feet, slope = path.ground(how.starts_m + how.speed_m_s * walked_s)
    step = _STEPS_HZ * walked_s
    places = _chest(feet, slope, live, step)
    yaw_sweep = _sweep(walked_s, _SWEEP_S, phases[:2])
    up_sweep = _sweep(walked_s, _SWEEP_S[::-1], phases[2:4])
    tremble = [_tremble(t_s, phases[4:7]), _tremble(t_s, phases[7:])]
    yaw = math.radians(path.look_left_deg) + live * (
        math.radians(path.sweep_left_deg) * yaw_sweep
        + _TWIST_RAD * sine(step / 2 + 0.1)
        + _TREMBLE_RAD * tremble[0]
    )
    up = math.radians(path.look_up_deg) + live * (
        math.radians(path.sweep_up_deg) * up_sweep
        + _NOD_RAD * sine(step + 0.3)
        + _TREMBLE_RAD * tremble[1]
    )
    roll = 0.015 + live * _ROLL_RAD * sine(step / 2 + 0.4)
    turns = chain_turns(
        turn_towards(slope[:, 0], slope[:, 1]),
        turn_about(2, yaw),
        turn_about(1, -up),
        turn_about(0, roll),
    )
    places[:, 2] += path.chest_m
    return places, turns


def _chest(feet: Floats, slope: Floats, live: Floats, step: Floats) -> Floats:
    length = np.sqrt(slope[:, 0] ** 2 + slope[:, 1] ** 2)
    cos, sin = slope[:, 0] / length, slope[:, 1] / length
    ahead, left = live * _SURGE_M * sine(step + 0.2), live * _SIDE_M * sine(step / 2)
    moved = [cos * ahead - sin * left, sin * ahead + cos * left, live * _BOB_M * sine(step)]
    return feet + np.stack(moved, axis=1)


def _sweep(walked_s: Floats, periods_s: tuple[float, float], phases: Floats) -> Floats:
    """Return where the walker looks, -1 to 1."""
    first, second = (
        share * sine(walked_s / period_s + phase)
        for share, period_s, phase in zip(_SWEEP_SHARES, periods_s, phases, strict=True)
    )
    return first + second


def _tremble(t_s: Floats, phases: Floats) -> Floats:
    waves = [sine(hz * t_s + phase) for hz, phase in zip(_TREMBLE_HZ, phases, strict=True)]
    return waves[0] + waves[1] + waves[2]
