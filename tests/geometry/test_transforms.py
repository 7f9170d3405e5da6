"""Rigid transforms: against plain matrix products and SciPy."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from civil_rgbd.geometry.transforms import (
    compose,
    inverse,
    matrix_from_quaternion,
    quaternion_from_matrix,
    rigid_fault,
    rotate,
    transform_from,
    transform_points,
    unit_quaternion,
)

from ..strategies import rigid_transforms, seeds, unit_quaternions

EXACT = {"rtol": 0, "atol": 1e-12}


@given(rigid_transforms(), rigid_transforms(), rigid_transforms())
def test_compose_is_the_matrix_product_in_the_order_written(
    T_a_b: NDArray[np.float64], T_b_c: NDArray[np.float64], T_c_d: NDArray[np.float64]
) -> None:
    np.testing.assert_allclose(compose(T_a_b, T_b_c, T_c_d), T_a_b @ T_b_c @ T_c_d, **EXACT)


def test_compose_moves_first_what_is_written_last() -> None:
    # b sits 1 m along x of a and is turned a quarter to the left; c sits 2 m along x of b.
    T_a_b = transform_from([[0, -1, 0], [1, 0, 0], [0, 0, 1]], [1, 0, 0])
    T_b_c = transform_from(np.eye(3), [2, 0, 0])

    assert compose(T_a_b, T_b_c)[:3, 3].tolist() == [1, 2, 0]


@given(rigid_transforms(), seeds)
def test_compose_and_inverse_take_stacks(T_a_b: NDArray[np.float64], seed: int) -> None:
    rotations = Rotation.random(5, rng=np.random.default_rng(seed)).as_matrix()
    stack = transform_from(rotations, np.arange(15.0).reshape(5, 3))

    np.testing.assert_allclose(compose(stack, T_a_b), stack @ T_a_b, **EXACT)
    np.testing.assert_allclose(compose(T_a_b, stack), T_a_b @ stack, **EXACT)
    np.testing.assert_allclose(inverse(stack), np.linalg.inv(stack), **EXACT)


@given(rigid_transforms())
def test_inverse_undoes_on_both_sides(T_a_b: NDArray[np.float64]) -> None:
    np.testing.assert_allclose(compose(T_a_b, inverse(T_a_b)), np.eye(4), **EXACT)
    np.testing.assert_allclose(compose(inverse(T_a_b), T_a_b), np.eye(4), **EXACT)


@given(rigid_transforms(), seeds)
def test_points_move_as_homogeneous_columns_do(T_a_b: NDArray[np.float64], seed: int) -> None:
    points_b = np.random.default_rng(seed).uniform(-50, 50, size=(7, 3)).astype(np.float32)
    columns = np.vstack([points_b.T.astype(np.float64), np.ones(7)])

    moved = transform_points(T_a_b, points_b)

    assert moved.dtype == np.float64
    np.testing.assert_allclose(moved, (T_a_b @ columns)[:3].T, **EXACT)


@given(unit_quaternions())
def test_the_matrix_of_a_quaternion_is_scipys(q: NDArray[np.float64]) -> None:
    np.testing.assert_allclose(
        matrix_from_quaternion(q), Rotation.from_quat(q).as_matrix(), **EXACT
    )


@given(unit_quaternions())
def test_the_quaternion_of_a_matrix_is_scipys(q: NDArray[np.float64]) -> None:
    R = Rotation.from_quat(q).as_matrix()

    found = quaternion_from_matrix(R)

    assert found[3] >= 0
    assert math.isclose(float((found**2).sum()), 1, abs_tol=1e-15)
    expected = Rotation.from_matrix(R).as_quat(canonical=True)
    # A half turn has two quaternions with w = 0; both are right.
    same = min(np.abs(found - expected).max(), np.abs(found + expected).max() + 2 * expected[3])
    assert same < 1e-12


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("angle_deg", [90, 179.9999, 180, -180, 181, 359])
def test_large_turns_survive_the_way_to_a_quaternion_and_back(axis: int, angle_deg: float) -> None:
    R = Rotation.from_euler("xyz"[axis], angle_deg, degrees=True).as_matrix()

    np.testing.assert_allclose(matrix_from_quaternion(quaternion_from_matrix(R)), R, **EXACT)


def test_quaternions_are_xyzw() -> None:
    half = math.sqrt(0.5)
    quarter_turn_about_z = [0.0, 0.0, half, half]

    np.testing.assert_allclose(
        matrix_from_quaternion(quarter_turn_about_z), [[0, -1, 0], [1, 0, 0], [0, 0, 1]], **EXACT
    )


@given(unit_quaternions(), st.sampled_from([2.0, -3.0, 1e-3]))
def test_a_unit_quaternion_has_norm_1_and_w_not_below_0(
    q: NDArray[np.float64], factor: float
) -> None:
    unit = unit_quaternion(q * factor)

    np.testing.assert_allclose(
        matrix_from_quaternion(unit), Rotation.from_quat(q).as_matrix(), **EXACT
    )
    assert unit[3] >= 0
    assert not np.signbit(unit[unit == 0]).any()


@given(unit_quaternions(), seeds)
def test_rotate_is_scipys_apply(q: NDArray[np.float64], seed: int) -> None:
    v = np.random.default_rng(seed).uniform(-50, 50, size=(6, 3))

    np.testing.assert_allclose(rotate(q, v), Rotation.from_quat(q).apply(v), **EXACT)


@given(seeds)
def test_rotate_takes_one_quaternion_a_vector(seed: int) -> None:
    rng = np.random.default_rng(seed)
    q = Rotation.random(6, rng=rng).as_quat()
    v = rng.uniform(-50, 50, size=(6, 3))

    np.testing.assert_allclose(rotate(q, v), Rotation.from_quat(q).apply(v), **EXACT)


def _with(value: float, *, at: tuple[int, int]) -> NDArray[np.float64]:
    T = np.eye(4)
    T[at] = value
    return T


@pytest.mark.parametrize(
    ("T", "words"),
    [
        (np.eye(3), r"shape \(3, 3\)"),
        (_with(math.nan, at=(0, 3)), "not a finite"),
        (_with(1.0, at=(3, 0)), "last row"),
        (_with(1.001, at=(0, 0)), "not orthonormal"),
        (_with(-1.0, at=(1, 1)), "mirrors: det R = -1"),
    ],
)
def test_what_is_not_rigid_is_said_in_words(T: NDArray[np.float64], words: str) -> None:
    fault = rigid_fault(T)

    assert fault is not None
    with pytest.raises(ValueError, match=words):
        raise ValueError(fault)


@given(rigid_transforms())
def test_rigid_transforms_have_no_fault(T_a_b: NDArray[np.float64]) -> None:
    assert rigid_fault(T_a_b) is None
    assert rigid_fault(inverse(T_a_b)) is None
