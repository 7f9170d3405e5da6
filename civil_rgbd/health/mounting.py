"""How is the camera mounted? What its images turn by is compared with what the poses turn by."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from civil_rgbd.geometry.transforms import compose, transform_from
from civil_rgbd.health.rotations import (
    DOUBT_RAD,
    mounting_rows,
    rotation_vector,
    turned,
    turns_at,
)
from civil_rgbd.health.sampling import Posed, Supposed
from civil_rgbd.health.tracks import Pair, Track, tracks_of

Floats = NDArray[np.float64]

_PASSES: Final = 2
_ROUNDS: Final = 8


def turn_of_mounting(
    recording: Posed, pairs: Sequence[Pair], shift_s: float
) -> tuple[Floats, Floats]:
    """Say how the camera is turned, from how images and poses turn: about axes across the turning.

    Args:
        recording: with poses.
        pairs: features followed, from :func:`civil_rgbd.health.tracks.pairs_of`.
        shift_s: to be added to the images' stamps beyond what the rig says.

    Returns:
        rotation vector (3,) by which the stated camera is to be turned, and standard errors (3,).
    """
    rig = recording.rig
    late_s = rig.camera_time_offset_s + shift_s
    whole, sigma = np.eye(3), np.zeros(3)
    # Then once more from where the camera turns out to be: as stated, features get the depths of
    # points beside them, and the camera's way is taken out askew.
    for _ in range(_PASSES):
        T_body_camera = compose(rig.T_body_camera, transform_from(whole, np.zeros(3)))
        supposed = Supposed(
            replace(rig, camera_time_offset_s=late_s, T_body_camera=T_body_camera),
            recording.trajectory,
            recording.image_stamps_ns,
        )
        turn, sigma = _turn_once(supposed, tracks_of(supposed, pairs))
        matrix, _ = cv2.Rodrigues(turn)
        whole = whole @ np.asarray(matrix, dtype=np.float64)
    return rotation_vector(whole), sigma


def _turn_once(recording: Posed, tracks: Sequence[Track]) -> tuple[Floats, Floats]:
    turns = turns_at(recording, tracks, 0.0)
    said = turned(recording, turns, 0.0)
    rows, left = mounting_rows(said), turns.seen_rad - said
    mount, scale = np.zeros(3), 1.0
    for _ in range(_ROUNDS):
        size2 = ((left - rows @ mount) ** 2).sum(axis=1)
        scale = 1.4826 * float(np.median(np.sqrt(size2))) + 1e-5
        weight = 1 / (1 + size2 / (2 * scale) ** 2)
        normal = np.einsum("nij,n,nik->jk", rows, weight, rows)
        normal += np.eye(3) * (scale / DOUBT_RAD) ** 2
        mount = np.linalg.solve(normal, np.einsum("nij,n,ni->j", rows, weight, left))
    return -mount, scale * np.sqrt(np.diag(np.linalg.inv(normal)))
