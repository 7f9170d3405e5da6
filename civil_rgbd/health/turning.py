"""When were images really taken? Their turning from one to the next is compared with the poses'.

Features are followed from image to image. What the poses say of the camera's way, and the LiDAR of
the features' depths, is taken out; what is left is a rotation, which the poses must have made too
at the image's instant. The shift of the images' stamps at which both agree is their time offset.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from civil_rgbd.domain.recording import Recording
from civil_rgbd.geometry.transforms import compose, inverse
from civil_rgbd.health.sampling import camera_poses
from civil_rgbd.health.tracks import FEWEST_FEATURES, Track

Floats = NDArray[np.float64]

TURNS_ENOUGH_RAD_S: Final = 0.2
"""Below this rate (RMS) the instant of an image makes no difference that could be seen."""

_SEARCH_S: Final = 0.25
_STEP_S: Final = 0.01
_FEWEST_TURNS: Final = 12
_ROUNDS: Final = 2
_DOUBT_RAD: Final = 0.05  # of the extrinsics, one sigma: they are estimated along
_MOUNT_ROUNDS: Final = 8
_SURE_S: Final = 0.004


@dataclass(frozen=True, slots=True, eq=False)
class _Turns:
    """Rotations between neighbouring images: stamps (T,) int64, rotation vectors (T, 3)."""

    from_ns: NDArray[np.int64]
    to_ns: NDArray[np.int64]
    seen_rad: Floats


@dataclass(frozen=True, slots=True)
class TimeOffset:
    """What is to be added to the images' stamps beyond what the rig says.

    Attributes:
        offset_s: None where it cannot be observed.
        sigma_s: its standard error.
        rate_rad_s: RMS of the rate at which the sensors turn.
        why_not: in words, where it cannot be observed.
    """

    offset_s: float | None
    sigma_s: float
    rate_rad_s: float
    why_not: str = ""


def _turns_at(recording: Recording, tracks: Sequence[Track], shift_s: float) -> _Turns:
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
            rows.append((track.from_ns, track.to_ns, rotation_vector(_rotation(left) @ R)))
    stamps = np.array([row[:2] for row in rows], dtype=np.int64).reshape(-1, 2)
    seen = np.array([row[2] for row in rows], dtype=np.float64).reshape(-1, 3)
    return _Turns(stamps[:, 0], stamps[:, 1], seen)


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


def _rotation(vector: Floats) -> Floats:
    matrix, _ = cv2.Rodrigues(vector)
    return np.asarray(matrix, dtype=np.float64)


def time_offset(recording: Recording, tracks: Sequence[Track]) -> TimeOffset:
    """Find the shift of the images' stamps at which the poses turn as the images do.

    Args:
        recording: with poses.
        tracks: from :func:`tracks_of`.
    """
    found = TimeOffset(0.0, 0.0, 0.0)
    for _ in range(_ROUNDS):  # the camera's way between two images depends on their instants, too
        if found.offset_s is None:
            return found
        turns = _turns_at(recording, tracks, found.offset_s)
        rates = _rates(recording, turns)
        rate = float(np.sqrt((rates**2).sum(axis=1).mean())) if len(rates) else 0.0
        refused = _why_not(rates, rate)
        if refused:
            return TimeOffset(None, 0.0, rate, refused)
        found = _best_shift(recording, turns, rate)
    if found.offset_s is not None and found.sigma_s > _SURE_S:
        words = f"image motion and poses agree too loosely: +- {1000 * found.sigma_s:.0f} ms"
        return TimeOffset(None, found.sigma_s, found.rate_rad_s, words)
    return found


def _best_shift(recording: Recording, turns: _Turns, rate_rad_s: float) -> TimeOffset:
    shifts = np.arange(-_SEARCH_S, _SEARCH_S + _STEP_S / 2, _STEP_S)
    scale = 0.002
    for _ in range(2):  # the second time what does not fit is known
        costs = np.array([_misfit(recording, turns, shift, scale)[0] for shift in shifts])
        best = int(costs.argmin())
        _, left = _misfit(recording, turns, float(shifts[best]), scale)
        scale = 1.4826 * float(np.median(np.sqrt((left**2).sum(axis=1)))) + 1e-5
    if best in {0, len(shifts) - 1}:
        words = f"no shift within {_SEARCH_S:g} s makes image motion and poses agree"
        return TimeOffset(None, 0.0, rate_rad_s, words)
    fine = np.linspace(-_STEP_S, _STEP_S, 9)
    costs = np.array(
        [_misfit(recording, turns, float(shifts[best] + step), scale)[0] for step in fine]
    )
    bend, slope, _ = np.polyfit(fine, costs, 2)
    if bend <= 0:
        return TimeOffset(None, 0.0, rate_rad_s, "no shift fits better than its neighbours")
    offset_s = float(shifts[best] + np.clip(-slope / (2 * bend), -_STEP_S, _STEP_S))
    sigma_s = float(np.sqrt(costs.min() / max(len(turns.seen_rad) - 4, 1) / bend))
    return TimeOffset(offset_s, sigma_s, rate_rad_s)


def _rates(recording: Recording, turns: _Turns) -> Floats:
    if not len(turns.from_ns):
        return np.zeros((0, 3))
    span_s = (turns.to_ns - turns.from_ns)[:, np.newaxis] / 1e9
    return _turned(recording, turns, 0.0) / span_s


def _why_not(rates: Floats, rate_rad_s: float) -> str:
    if len(rates) < _FEWEST_TURNS:
        return f"only {len(rates)} pairs of images show their turning"
    if rate_rad_s < TURNS_ENOUGH_RAD_S:
        return (
            f"the sensors turn at {rate_rad_s:.2f} rad/s RMS; {TURNS_ENOUGH_RAD_S:g} with changing "
            "sign are needed"
        )
    strongest = rates[:, int((rates**2).sum(axis=0).argmax())]
    fast = np.abs(strongest) > TURNS_ENOUGH_RAD_S / 4
    share = float((strongest[fast] > 0).mean()) if fast.any() else 0.0
    if not 0.1 < share < 0.9:
        return "the sensors turn one way only; a turn with changing sign is needed"
    return ""


def _turned(recording: Recording, turns: _Turns, shift_s: float) -> Floats:
    shift_ns = round(shift_s * 1e9)
    first = camera_poses(recording, turns.from_ns + shift_ns)[:, :3, :3]
    second = camera_poses(recording, turns.to_ns + shift_ns)[:, :3, :3]
    return rotation_vector(np.swapaxes(second, 1, 2) @ first)


def turn_of_mounting(
    recording: Recording, tracks: Sequence[Track], shift_s: float
) -> tuple[Floats, Floats]:
    """Say how the camera is turned, from how images and poses turn: about axes across the turning.

    Args:
        recording: with poses.
        tracks: from :func:`civil_rgbd.health.tracks.tracks_of`.
        shift_s: to be added to the images' stamps beyond what the rig says.

    Returns:
        rotation vector (3,) by which the stated camera is to be turned, and standard errors (3,).
    """
    turns = _turns_at(recording, tracks, shift_s)
    said = _turned(recording, turns, shift_s)
    rows, left = _mounting_rows(said), turns.seen_rad - said
    mount, scale = np.zeros(3), 1.0
    for _ in range(_MOUNT_ROUNDS):
        size2 = ((left - rows @ mount) ** 2).sum(axis=1)
        scale = 1.4826 * float(np.median(np.sqrt(size2))) + 1e-5
        weight = 1 / (1 + size2 / (2 * scale) ** 2)
        normal = np.einsum("nij,n,nik->jk", rows, weight, rows)
        normal += np.eye(3) * (scale / _DOUBT_RAD) ** 2
        mount = np.linalg.solve(normal, np.einsum("nij,n,ni->j", rows, weight, left))
    return -mount, scale * np.sqrt(np.diag(np.linalg.inv(normal)))


def _mounting_rows(said: Floats) -> Floats:
    """Return (T, 3, 3): what a small turn of the mounting adds to each rotation vector."""
    x, y, z = said.T
    zero = np.zeros_like(x)
    rows: Floats = np.stack(
        [np.stack([zero, z, -y], 1), np.stack([-z, zero, x], 1), np.stack([y, -x, zero], 1)], axis=1
    )
    return rows


def _misfit(
    recording: Recording, turns: _Turns, shift_s: float, scale: float
) -> tuple[float, Floats]:
    """Return the robust misfit of a shift, and what is left; a wrong mounting turns all alike."""
    said = _turned(recording, turns, shift_s)
    left = turns.seen_rad - said
    rows = _mounting_rows(said)
    mount = np.zeros(3)
    for _ in range(3):
        now = left - rows @ mount
        weight = 1 / (1 + (now**2).sum(axis=1) / (3 * scale) ** 2)
        normal = np.einsum("nij,n,nik->jk", rows, weight, rows)
        prior = np.eye(3) * (min(scale, 0.01) / _DOUBT_RAD) ** 2
        mount = np.linalg.solve(normal + prior, np.einsum("nij,n,ni->j", rows, weight, left))
    now = left - rows @ mount
    size2 = (now**2).sum(axis=1)
    return float((9 * scale**2 * np.log1p(size2 / (9 * scale**2))).sum()), now
