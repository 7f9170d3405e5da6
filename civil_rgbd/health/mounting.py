"""How is the camera mounted? What its images turn by is compared with what the poses turn by."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.geometry.transforms import compose, transform_from
from civil_rgbd.health.rotations import (
    DOUBT_RAD,
    mounting_rows,
    rotation,
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
    late_s = recording.rig.camera_time_offset_s + shift_s
    whole, sigma = np.eye(3), np.zeros(3)
    # Then once more from where the camera turns out to be: as stated, features get the depths of
    # points beside them, and the camera's way is taken out askew.
    for _ in range(_PASSES):
        supposed = with_camera_turned(recording, rotation_vector(whole))
        supposed = replace(supposed, rig=replace(supposed.rig, camera_time_offset_s=late_s))
        turn, sigma = _turn_once(supposed, tracks_of(supposed, pairs))
        whole = whole @ rotation(turn)
    return rotation_vector(whole), sigma


def with_camera_turned(recording: Posed, turn: Floats) -> Supposed:
    """Suppose that the camera is turned against what the rig says.

    Args:
        recording: with poses.
        turn: rotation vector (3,) about the camera's axes, rad.
    """
    rig = recording.rig
    T_body_camera = compose(rig.T_body_camera, transform_from(rotation(turn), np.zeros(3)))
    return Supposed(
        replace(rig, T_body_camera=T_body_camera),
        recording.trajectory,
        recording.image_stamps_ns,
    )


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
