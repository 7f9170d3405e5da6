"""Rotations from one image to the next: as the features turn, and as the poses say."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from civil_rgbd.geometry.transforms import compose, inverse
from civil_rgbd.health.sampling import Posed, camera_poses
from civil_rgbd.health.tracks import FEWEST_FEATURES, Track

Floats = NDArray[np.float64]

DOUBT_RAD: Final = 0.05
"""Of the extrinsics, one sigma: they are estimated along."""


@dataclass(frozen=True, slots=True, eq=False)
class Turns:
    """Rotations between neighbouring images: stamps (T,) int64, rotation vectors (T, 3)."""

    from_ns: NDArray[np.int64]
    to_ns: NDArray[np.int64]
    seen_rad: Floats


def turns_at(recording: Posed, tracks: Sequence[Track], shift_s: float) -> Turns:
    """Take the camera's way out of the tracks, as the poses give it for shifted stamps."""
    rows = []
    shift_ns = round(shift_s * 1e9)
    for track in tracks:
        stamps_ns = np.array([track.from_ns, track.to_ns])
        T_map_camera = camera_poses(recording, stamps_ns + shift_ns)
        T_second_first = compose(inverse(T_map_camera[1]), T_map_camera[0])
        R, t = T_second_first[:3, :3], T_second_first[:3, 3]
        left = _rotation_left(track.rays @ R.T + t / track.depths_m[:, np.newaxis], track.seen)
        if left is not None:
            rows.append((track.from_ns, track.to_ns, rotation_vector(rotation(left) @ R)))
    stamps = np.array([row[:2] for row in rows], dtype=np.int64).reshape(-1, 2)
    seen = np.array([row[2] for row in rows], dtype=np.float64).reshape(-1, 3)
    return Turns(stamps[:, 0], stamps[:, 1], seen)


def _rotation_left(expected: Floats, seen: Floats) -> Floats | None:
    """Return the rotation vector that takes expected directions to those seen, robustly."""
    x, y = expected[:, 0] / expected[:, 2], expected[:, 1] / expected[:, 2]
    off = np.stack([seen[:, 0] - x, seen[:, 1] - y])
    rows = np.stack([
        np.column_stack([-x * y, 1 + x * x, -y]),
        np.column_stack([-(1 + y * y), x * y, x]),
    ])  # fmt: skip
    turn = np.array([np.median(-off[1]), np.median(off[0]), 0.0])
    for _ in range(8):
        left = off - rows @ turn
        size = np.sqrt((left**2).sum(axis=0))
        scale = 1.4826 * float(np.median(size)) + 1e-5
        weight = 1 / (1 + (size / (2 * scale)) ** 2) ** 2
        weighted = rows * weight[:, np.newaxis]
        normal = sum(weighted[k].T @ rows[k] for k in (0, 1))
        change = np.linalg.solve(normal, sum(weighted[k].T @ left[k] for k in (0, 1)))
        turn = turn + change
    inliers = size < 3 * scale
    return turn if inliers.sum() >= FEWEST_FEATURES and scale < 0.02 else None


def rotation_vector(R: Floats) -> Floats:
    """Return axis times angle of (..., 3, 3) rotations that are far from half a turn."""
    skew = np.stack([R[..., 2, 1] - R[..., 1, 2], R[..., 0, 2] - R[..., 2, 0],
                     R[..., 1, 0] - R[..., 0, 1]], axis=-1) / 2  # fmt: skip
    sine = np.sqrt((skew**2).sum(axis=-1, keepdims=True))
    cosine = (np.trace(R, axis1=-2, axis2=-1)[..., np.newaxis] - 1) / 2
    angle = np.arctan2(sine, cosine)
    vector: Floats = skew * np.where(sine > 1e-9, angle / np.maximum(sine, 1e-9), 1.0)
    return vector


def rotation(vector: Floats) -> Floats:
    """Return the rotation (3, 3) about an axis by its length."""
    matrix, _ = cv2.Rodrigues(vector)
    return np.asarray(matrix, dtype=np.float64)


def turned(recording: Posed, turns: Turns, shift_s: float) -> Floats:
    """Return the rotation vectors (T, 3) that the poses say, of stamps shifted by so much."""
    shift_ns = round(shift_s * 1e9)
    first = camera_poses(recording, turns.from_ns + shift_ns)[:, :3, :3]
    second = camera_poses(recording, turns.to_ns + shift_ns)[:, :3, :3]
    return rotation_vector(np.swapaxes(second, 1, 2) @ first)


def mounting_rows(said: Floats) -> Floats:
    """Return (T, 3, 3): what a small turn of the mounting adds to each rotation vector."""
    x, y, z = said.T
    zero = np.zeros_like(x)
    rows: Floats = np.stack(
        [np.stack([zero, z, -y], 1), np.stack([-z, zero, x], 1), np.stack([y, -x, zero], 1)], axis=1
    )
    return rows
