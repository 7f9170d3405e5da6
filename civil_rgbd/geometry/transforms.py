"""Rigid transforms: ``T_a_b`` takes points of frame *b* to frame *a*; inner names cancel."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

RIGID_TOLERANCE = 1e-6
"""How far R R^T may be from the identity, and det R from 1, in a transform read from a file."""


def _matmul3(A: NDArray[np.float64], B: NDArray[np.float64]) -> NDArray[np.float64]:
    # (..., 3, 3) times (..., 3, n), spelt out: BLAS changes bits with the kernel that it picks.
    product: NDArray[np.float64] = (
        A[..., :, 0:1] * B[..., 0:1, :]
        + A[..., :, 1:2] * B[..., 1:2, :]
        + A[..., :, 2:3] * B[..., 2:3, :]
    )
    return product


def transform_from(rotation: ArrayLike, translation_m: ArrayLike) -> NDArray[np.float64]:
    """Join rotations and translations into homogeneous transforms.

    Args:
        rotation: (..., 3, 3) rotation matrices.
        translation_m: (..., 3) metres.

    Returns:
        (..., 4, 4) float64.
    """
    R, t = np.asarray(rotation, dtype=np.float64), np.asarray(translation_m, dtype=np.float64)
    T = np.zeros((*np.broadcast_shapes(R.shape[:-2], t.shape[:-1]), 4, 4))
    T[..., :3, :3], T[..., :3, 3], T[..., 3, 3] = R, t, 1.0
    return T


def compose(*transforms: NDArray[np.float64]) -> NDArray[np.float64]:
    """Chain ``T_a_b, T_b_c, ...`` into ``T_a_z``.

    Args:
        transforms: one or more (..., 4, 4) rigid transforms that broadcast.

    Returns:
        (..., 4, 4) float64.

    >>> T = transform_from(np.eye(3), [1.0, 2.0, 3.0])
    >>> compose(T, inverse(T))[:3, 3]
    array([0., 0., 0.])
    """
    T_a_b = transforms[0]
    for T_b_c in transforms[1:]:
        R = _matmul3(T_a_b[..., :3, :3], T_b_c[..., :3, :3])
        t = _matmul3(T_a_b[..., :3, :3], T_b_c[..., :3, 3:4])[..., 0] + T_a_b[..., :3, 3]
        T_a_b = transform_from(R, t)
    return T_a_b


def inverse(T_a_b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return ``T_b_a`` of (..., 4, 4) rigid transforms."""
    # Transpose rather than np.linalg.inv: stays exactly rigid over long chains.
    R_b_a = np.swapaxes(T_a_b[..., :3, :3], -1, -2)
    return transform_from(R_b_a, -_matmul3(R_b_a, T_a_b[..., :3, 3:4])[..., 0])


def transform_points(
    T_a_b: NDArray[np.float64], points_b: NDArray[np.floating]
) -> NDArray[np.float64]:
    """Move points from frame *b* to frame *a*.

    Args:
        T_a_b: (4, 4) rigid transform.
        points_b: (N, 3) metres, frame *b*.

    Returns:
        (N, 3) float64, metres, frame *a*.

    >>> transform_points(np.eye(4), np.zeros((1, 3)))
    array([[0., 0., 0.]])
    """
    x, y, z = (points_b[:, axis].astype(np.float64) for axis in range(3))
    R, t = T_a_b[:3, :3], T_a_b[:3, 3]
    return np.stack([R[i, 0] * x + R[i, 1] * y + R[i, 2] * z + t[i] for i in range(3)], axis=1)


def matrix_from_quaternion(quaternion_xyzw: ArrayLike) -> NDArray[np.float64]:
    """Turn unit quaternions (..., 4), order xyzw, into rotation matrices (..., 3, 3) float64."""
    x, y, z, w = np.moveaxis(np.asarray(quaternion_xyzw, dtype=np.float64), -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def quaternion_from_matrix(rotation: ArrayLike) -> NDArray[np.float64]:
    """Turn a rotation matrix into a unit quaternion.

    Args:
        rotation: (3, 3).

    Returns:
        (4,) float64, order xyzw, norm 1, w >= 0. Shepperd's method: the largest component first.
    """
    R = np.asarray(rotation, dtype=np.float64)
    trace = R[0, 0] + R[1, 1] + R[2, 2]
    squares = [R[0, 0], R[1, 1], R[2, 2], trace]
    largest = int(np.argmax(squares))
    q = np.empty(4)
    if largest == 3:
        q[:] = R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1], 1 + trace
    else:
        i, j, k = largest, (largest + 1) % 3, (largest + 2) % 3
        q[i] = 1 + 2 * R[i, i] - trace
        q[j] = R[j, i] + R[i, j]
        q[k] = R[k, i] + R[i, k]
        q[3] = R[k, j] - R[j, k]
    return unit_quaternion(q)


def unit_quaternion(quaternion_xyzw: ArrayLike) -> NDArray[np.float64]:
    """Scale quaternions (..., 4), order xyzw, to norm 1 and w >= 0.

    >>> unit_quaternion([0.0, 0.0, 0.0, -2.0])
    array([0., 0., 0., 1.])
    """
    q = np.asarray(quaternion_xyzw, dtype=np.float64)
    x, y, z, w = np.moveaxis(q, -1, 0)
    q = q / np.sqrt(x * x + y * y + z * z + w * w)[..., np.newaxis]
    signed: NDArray[np.float64] = np.where(q[..., 3:4] < 0, -q, q) + 0.0  # + 0.0: no -0.0
    return signed


def rotate(quaternion_xyzw: NDArray[np.float64], v: NDArray[np.floating]) -> NDArray[np.float64]:
    """Rotate vectors (N, 3) by unit quaternions (N, 4) or (4,), order xyzw: (N, 3) float64."""
    qx, qy, qz, w = np.moveaxis(quaternion_xyzw, -1, 0)
    vx, vy, vz = (v[:, axis].astype(np.float64) for axis in range(3))
    # v + 2 w (q x v) + 2 q x (q x v)
    tx = 2 * (qy * vz - qz * vy)
    ty = 2 * (qz * vx - qx * vz)
    tz = 2 * (qx * vy - qy * vx)
    return np.stack(
        [
            vx + w * tx + (qy * tz - qz * ty),
            vy + w * ty + (qz * tx - qx * tz),
            vz + w * tz + (qx * ty - qy * tx),
        ],
        axis=1,
    )


def rigid_fault(T_a_b: NDArray[np.float64], tolerance: float = RIGID_TOLERANCE) -> str | None:
    """Say in words why a (4, 4) array is no rigid transform; None when it is one."""
    if T_a_b.shape != (4, 4) or not np.isfinite(T_a_b).all():
        return f"it is not a finite 4 x 4 matrix but has shape {T_a_b.shape}"
    if not np.array_equal(T_a_b[3], [0.0, 0.0, 0.0, 1.0]):
        return f"its last row is {T_a_b[3].tolist()}, not [0, 0, 0, 1]"
    R = T_a_b[:3, :3]
    skew = float(np.abs(_matmul3(R, R.T) - np.eye(3)).max())
    if skew > tolerance:
        return f"its rotation is not orthonormal: |R R^T - 1| = {skew:.3g} > {tolerance:g}"
    det = float(np.dot(R[0], np.cross(R[1], R[2])))
    if det < 0:
        return f"its rotation mirrors: det R = {det:.6f}"
    return None
