"""Poses between poses: against SciPy and by hand."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from civil_rgbd.geometry.trajectory import Trajectory

from ..recordings import trajectory_of
from ..reference.pose import pose_at
from ..strategies import trajectories

ANYWHERE = st.floats(0, 1)


def stamps(*values: int) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    return np.array(values, dtype=np.int64)


def _half_turn_between(trajectory: Trajectory) -> bool:
    # At exactly 180 degrees both ways round are equally short, and SciPy may take the other.
    q = trajectory.quaternions_xyzw
    return any(abs(float((a * b).sum())) < 1e-9 for a, b in itertools.pairwise(q))


@given(trajectories(), ANYWHERE)
def test_poses_between_are_scipys_slerp_and_linear(trajectory: Trajectory, share: float) -> None:
    if len(trajectory.stamps_ns) < 2 or _half_turn_between(trajectory):
        return
    t = trajectory.start_ns + round(share * (trajectory.end_ns - trajectory.start_ns))
    expected = pose_at(
        trajectory.stamps_ns.tolist(),
        trajectory.translations_m.tolist(),
        trajectory.quaternions_xyzw.tolist(),
        t,
    )

    found = trajectory.transforms_at(stamps(t))[0]

    # SciPy is asked in seconds: a short segment makes its time of day coarse, not ours.
    shortest_s = np.diff(trajectory.stamps_ns).min() / 1e9
    span_s = (trajectory.end_ns - trajectory.start_ns) / 1e9
    coarse = 4e-16 * span_s / shortest_s
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 + 500 * coarse)


def test_a_thousand_instants_of_a_real_turn_are_scipys_to_1e_12() -> None:
    rng = np.random.default_rng(7)
    at = np.arange(20, dtype=np.int64) * 100_000_000
    rotations = Rotation.from_rotvec(np.cumsum(rng.normal(scale=0.3, size=(20, 3)), axis=0))
    positions = np.cumsum(rng.normal(size=(20, 3)), axis=0)
    trajectory = Trajectory(at, positions, rotations.as_quat(canonical=True))
    asked = rng.integers(at[0], at[-1], size=1000, endpoint=True)

    translations, quaternions = trajectory.at(asked)

    expected = Slerp(at / 1e9, rotations)(asked / 1e9).as_matrix()
    np.testing.assert_allclose(
        Rotation.from_quat(quaternions).as_matrix(), expected, rtol=0, atol=1e-12
    )
    for axis in range(3):
        line = np.interp(asked / 1e9, at / 1e9, positions[:, axis])
        np.testing.assert_allclose(translations[:, axis], line, rtol=0, atol=1e-12)
    np.testing.assert_allclose((quaternions**2).sum(axis=1), 1, rtol=0, atol=1e-15)


def test_a_third_of_a_turn_by_hand() -> None:
    # 0 to 90 degrees about z in 3 s, from (0, 0, 0) to (3, 6, 0): after 1 s 30 degrees, (1, 2, 0).
    half = math.sqrt(0.5)
    trajectory = trajectory_of(
        [0, 3_000_000_000], [(0, 0, 0), (3, 6, 0)], [(0, 0, 0, 1), (0, 0, half, half)]
    )

    T = trajectory.transforms_at(stamps(1_000_000_000))[0]

    np.testing.assert_allclose(T[:3, 3], [1, 2, 0], atol=1e-15)
    np.testing.assert_allclose(T[:2, :2], [[math.sqrt(0.75), -0.5], [0.5, math.sqrt(0.75)]])


def test_a_quaternion_on_the_other_side_does_not_send_the_body_the_long_way_round() -> None:
    ten_deg = (0.0, 0.0, math.sin(math.radians(5)), math.cos(math.radians(5)))
    flipped = tuple(-component for component in ten_deg)
    ends = ([0, 10], [(0, 0, 0), (0, 0, 0)])

    one = trajectory_of(*ends, [(0, 0, 0, 1), ten_deg]).transforms_at(stamps(5))
    other = trajectory_of(*ends, [(0, 0, 0, 1), flipped]).transforms_at(stamps(5))

    np.testing.assert_allclose(one, other, atol=1e-15)
    assert math.degrees(math.acos(other[0, 0, 0])) == pytest.approx(5)


@pytest.mark.parametrize("nudge", [0.0, 1e-12, -1e-12])
def test_a_half_turn_goes_round_one_axis_at_an_even_pace(nudge: float) -> None:
    # 0 and 180 degrees apart about z: which way is not defined, but half of it is a quarter turn.
    end = (0.0, 0.0, math.cos(nudge), math.sin(nudge))
    trajectory = trajectory_of([0, 4], [(0, 0, 0)] * 2, [(0, 0, 0, 1), end])

    angles = Rotation.from_quat(trajectory.at(stamps(0, 1, 2, 3, 4))[1]).magnitude()

    np.testing.assert_allclose(np.degrees(angles), [0, 45, 90, 135, 180], atol=1e-7)


@pytest.mark.parametrize("angle_rad", [1e-300, 1e-12, 1.9e-8, 2.1e-8, 1e-4])
def test_tiny_turns_are_slerped_without_a_division_by_zero(angle_rad: float) -> None:
    end = (math.sin(angle_rad / 2), 0.0, 0.0, math.cos(angle_rad / 2))
    trajectory = trajectory_of([0, 4], [(0, 0, 0)] * 2, [(0, 0, 0, 1), end])

    q = trajectory.at(stamps(3))[1][0]

    assert q[0] == pytest.approx(math.sin(0.75 * angle_rad / 2), rel=1e-7, abs=1e-300)


@given(trajectories())
def test_at_a_pose_the_pose_itself_comes_out(trajectory: Trajectory) -> None:
    translations, quaternions = trajectory.at(trajectory.stamps_ns)

    np.testing.assert_array_equal(translations, trajectory.translations_m)
    np.testing.assert_allclose(quaternions, trajectory.quaternions_xyzw, rtol=0, atol=1e-15)


def test_both_ends_are_inside_and_nothing_beyond_is() -> None:
    trajectory = trajectory_of([10, 20, 30], [(0, 0, 0)] * 3)

    covered = trajectory.covers(stamps(9, 10, 11, 29, 30, 31), max_gap_ns=100)

    assert covered.tolist() == [False, True, True, True, True, False]


@pytest.mark.parametrize("outside", [9, 31])
def test_nothing_is_extrapolated(outside: int) -> None:
    trajectory = trajectory_of([10, 30], [(0, 0, 0)] * 2)

    with pytest.raises(ValueError, match="nothing is extrapolated"):
        trajectory.at(stamps(15, outside))


def test_a_gap_hides_the_instants_within_it_but_not_its_edges() -> None:
    trajectory = trajectory_of([0, 10, 21, 31], [(0, 0, 0)] * 4)

    covered = trajectory.covers(stamps(0, 5, 10, 11, 20, 21, 22, 31), max_gap_ns=10)

    assert covered.tolist() == [True, True, True, False, False, True, True, True]


def test_a_gap_of_exactly_the_limit_is_interpolated_over() -> None:
    trajectory = trajectory_of([0, 250_000_000, 500_000_001], [(0, 0, 0)] * 3)

    covered = trajectory.covers(stamps(1, 250_000_001), max_gap_ns=250_000_000)

    assert covered.tolist() == [True, False]


@given(trajectories(), ANYWHERE, ANYWHERE, st.integers(1, 10**9))
def test_a_span_is_covered_when_every_instant_of_it_is(
    trajectory: Trajectory, one: float, other: float, max_gap_ns: int
) -> None:
    # A little beyond both ends, and often a pose itself.
    whole = trajectory.end_ns - trajectory.start_ns
    first, last = sorted(trajectory.start_ns - 2 + round(x * (whole + 4)) for x in (one, other))
    poses = trajectory.stamps_ns[(trajectory.stamps_ns >= first) & (trajectory.stamps_ns <= last)]
    edges = np.concatenate([poses - 1, poses, poses + 1, stamps(first, last)])
    instants = edges[(edges >= first) & (edges <= last)]

    covered = trajectory.covers_span(first, last, max_gap_ns=max_gap_ns)

    assert covered == trajectory.covers(instants, max_gap_ns=max_gap_ns).all()


@pytest.mark.parametrize(
    ("first", "last", "covered"),
    [
        (0, 10, True),
        (0, 11, False),
        (10, 10, True),
        (11, 11, False),
        (15, 21, False),
        (21, 31, True),
        (21, 32, False),
        (-1, 5, False),
    ],
)
def test_a_span_by_hand(first: int, last: int, *, covered: bool) -> None:
    trajectory = trajectory_of([0, 10, 21, 31], [(0, 0, 0)] * 4)

    assert trajectory.covers_span(first, last, max_gap_ns=10) is covered


def test_one_pose_covers_its_own_instant_only() -> None:
    trajectory = trajectory_of([10], [(1, 2, 3)])

    assert trajectory.covers(stamps(9, 10, 11), max_gap_ns=100).tolist() == [False, True, False]
    assert trajectory.at(stamps(10))[0].tolist() == [[1, 2, 3]]


def test_no_instants_give_no_poses() -> None:
    trajectory = trajectory_of([10, 20], [(1, 2, 3)] * 2)

    assert trajectory.transforms_at(stamps()).shape == (0, 4, 4)
    assert trajectory.covers(stamps(), max_gap_ns=1).shape == (0,)


def test_nanoseconds_since_1970_are_not_rounded() -> None:
    # float64 steps by 256 ns there: stamps must be subtracted before they are converted.
    epoch = 1_700_000_000_000_000_000
    trajectory = trajectory_of([epoch, epoch + 100], [(0, 0, 0), (100, 0, 0)])

    assert trajectory.at(stamps(epoch + 37))[0][0, 0] == pytest.approx(37, abs=1e-12)


IDENTITY = (0.0, 0.0, 0.0, 1.0)


@pytest.mark.parametrize(
    ("at", "positions", "quaternions", "words"),
    [
        ([], [], [], "holds no pose|translations"),
        ([1, 2, 2], [(0, 0, 0)] * 3, [IDENTITY] * 3, r"stamp 2 \(2 ns\) is the same as stamp 1"),
        ([1, 3, 2], [(0, 0, 0)] * 3, [IDENTITY] * 3, r"stamp 2 \(2 ns\) is before stamp 1"),
        ([1, 2], [(0, 0, 0)], [IDENTITY] * 2, "2 stamps, but translations"),
        ([1], [(0, math.nan, 0)], [IDENTITY], "translation is not finite"),
        ([1], [(0, 0, 0)], [(0, 0, 0, 1.00000001)], "not of norm 1"),
        ([1], [(0, 0, 0)], [(0, 0, 0, math.nan)], "not of norm 1"),
    ],
)
def test_impossible_trajectories_are_refused(
    at: list[int],
    positions: list[tuple[float, ...]],
    quaternions: list[tuple[float, ...]],
    words: str,
) -> None:
    with pytest.raises(ValueError, match=words):
        trajectory_of(at, positions, quaternions)


def test_the_quality_between_two_poses_is_the_worse_ones_and_at_a_pose_its_own() -> None:
    path = trajectory_of([10, 20, 30], [(0, 0, 0)] * 3)
    trajectory = replace(path, quality=np.array([0.5, 0.2, 0.9]))

    asked = stamps(9, 10, 11, 20, 21, 30, 31)

    assert trajectory.quality_at(asked).tolist() == [0.0, 0.5, 0.2, 0.2, 0.2, 0.9, 0.0]


def test_poses_that_nobody_judged_have_no_quality() -> None:
    with pytest.raises(ValueError, match="has no quality"):
        trajectory_of([10], [(0, 0, 0)]).quality_at(stamps(10))


@pytest.mark.parametrize(
    ("quality", "message"),
    [
        ([0.5], "2 stamps, but qualities"),
        ([0.1, -0.1], "negative"),
        ([0.1, math.nan], "not finite"),
    ],
)
def test_an_impossible_quality_is_refused(quality: list[float], message: str) -> None:
    path = trajectory_of([10, 20], [(0, 0, 0)] * 2)

    with pytest.raises(ValueError, match=message):
        replace(path, quality=np.array(quality))
