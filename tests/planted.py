"""Variants of recordings, by fault: each at no less than twice its limit, some of it by chance."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from .recording_faults import (
    CAMERA_INFO,
    IMAGE,
    IMU,
    LIDAR,
    ODOMETRY,
    Edit,
    Extent,
    blur,
    brighten,
    chained,
    cut,
    drop,
    drop_share,
    keep_every,
    log_later,
    matrix_of,
    move_poses,
    quaternion_of,
    remount,
    repaint,
    restamp,
    rotation,
    scattered,
    silence,
    truncate,
)

CAMERA: Final = (IMAGE, CAMERA_INFO)
Rng = np.random.Generator


@dataclass(frozen=True)
class Variant:
    """One edit of a recording.

    Attributes:
        edit: of its messages.
        planted: the numbers, for the record.
    """

    edit: Edit
    planted: dict[str, float | list[float]]


def clean(extent: Extent, rng: Rng) -> Variant:
    """Nothing amiss: a part of the recording, logged a little late, a lost image here and there."""
    length = max(10.0, extent.seconds * rng.uniform(0.7, 1.0)) / extent.seconds
    start = rng.uniform(0, max(0.0, 1 - length))
    lost = rng.uniform(0, 0.02)
    late_ms = rng.uniform(0, 5)
    edits = (
        cut(extent.at(start), extent.at(min(1.0, start + length))),
        drop_share(CAMERA, lost, rng),
        log_later(lambda: round(rng.exponential(late_ms) * 1e6)),
    )
    return Variant(chained(*edits), {"start": start, "length": length, "late_ms": late_ms})


def _scans_dropped(extent: Extent, rng: Rng) -> Variant:
    del extent
    share = rng.uniform(0.04, 0.2)
    chosen = scattered(share, rng)
    return Variant(drop((LIDAR,), lambda m: chosen(m.stamp_ns)), {"share": share})


def _images_dropped(extent: Extent, rng: Rng) -> Variant:
    del extent
    share = rng.uniform(0.2, 0.45)
    return Variant(drop_share(CAMERA, share, rng), {"share": share})


def _imu_dropped(extent: Extent, rng: Rng) -> Variant:
    del extent
    share = rng.uniform(0.05, 0.3)
    return Variant(drop_share((IMU,), share, rng), {"share": share})


def _gap(
    topics: tuple[str, ...], least_s: float, most_s: float
) -> Callable[[Extent, Rng], Variant]:
    def plant(extent: Extent, rng: Rng) -> Variant:
        seconds, at = rng.uniform(least_s, most_s), rng.uniform(0.2, 0.7)
        return Variant(silence(topics, extent.at(at), seconds), {"seconds": seconds, "at": at})

    return plant


def _image_rate(extent: Extent, rng: Rng) -> Variant:
    del extent
    step = int(rng.integers(10, 15))
    return Variant(keep_every(CAMERA, step), {"step": step})


def _thinned(topics: tuple[str, ...], least: int, most: int) -> Callable[[Extent, Rng], Variant]:
    def plant(extent: Extent, rng: Rng) -> Variant:
        del extent
        step = int(rng.integers(least, most))
        return Variant(keep_every(topics, step), {"step": step})

    return plant


def _end(
    topics: tuple[str, ...], least_s: float, most_s: float
) -> Callable[[Extent, Rng], Variant]:
    def plant(extent: Extent, rng: Rng) -> Variant:
        seconds, late = rng.uniform(least_s, most_s), bool(rng.random() < 0.5)
        start_ns = extent.first_ns if late else extent.last_ns - round(seconds * 1e9)
        edit = silence(topics, start_ns, seconds + 0.1)
        return Variant(edit, {"seconds": seconds, "at": 0.0 if late else 1.0})

    return plant


def _either(*plants: Callable[[Extent, Rng], Variant]) -> Callable[[Extent, Rng], Variant]:
    def plant(extent: Extent, rng: Rng) -> Variant:
        return plants[int(rng.integers(len(plants)))](extent, rng)

    return plant


def _clock_drift(extent: Extent, rng: Rng) -> Variant:
    drift_ms = float(rng.choice([-1, 1]) * rng.uniform(20, 60))
    topics = CAMERA if rng.random() < 0.5 else (IMU,)
    share = drift_ms * 1e6 / (extent.last_ns - extent.first_ns)

    def late(stamp_ns: int) -> int:
        return stamp_ns + round(share * (stamp_ns - extent.first_ns))

    return Variant(restamp(topics, late), {"drift_ms": drift_ms})


def _overexposed_start(extent: Extent, rng: Rng) -> Variant:
    del extent
    seconds, factor = rng.uniform(0.2, 1.8), rng.uniform(15, 60)
    if rng.random() < 0.2:
        seconds = rng.uniform(1.8, 7.0)
    first_ns: list[int] = []

    def since(stamp_ns: int) -> float:
        first_ns[:] = first_ns or [stamp_ns]
        return (stamp_ns - first_ns[0]) / 1e9 / seconds

    def paint(pixels, stamp_ns):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202  # as repaint's
        return brighten(pixels, factor ** (1 - 0.3 * since(stamp_ns)))

    edit = repaint(lambda ns: since(ns) < 1, paint)
    return Variant(edit, {"seconds": seconds, "factor": factor})


def _some(extent: Extent, rng: Rng) -> tuple[float, Callable[[int], bool]]:
    """Choose a tenth of the images at least: at a stretch, or here and there."""
    share = rng.uniform(0.1, 0.4)
    if rng.random() < 0.5:
        return share, scattered(share, rng)
    start = rng.uniform(0.3, 1 - share)
    first, last = extent.at(start), extent.at(start + share)
    return share, lambda ns: first <= ns < last


def _images_broken(extent: Extent, rng: Rng) -> Variant:
    share, chosen = _some(extent, rng)
    size = int(rng.integers(0, 4000))
    return Variant(truncate(chosen, size), {"share": share, "size": size})


def _overexposed(extent: Extent, rng: Rng) -> Variant:
    share, chosen = _some(extent, rng)
    factor = rng.uniform(20, 60)
    edit = repaint(chosen, lambda pixels, _: brighten(pixels, factor))
    return Variant(edit, {"share": share, "factor": factor})


def _too_dark(extent: Extent, rng: Rng) -> Variant:
    share, chosen = _some(extent, rng)
    factor = 1 / rng.uniform(400, 4000)
    edit = repaint(chosen, lambda pixels, _: brighten(pixels, factor))
    return Variant(edit, {"share": share, "factor": factor})


def _blurred(extent: Extent, rng: Rng) -> Variant:
    share, chosen = _some(extent, rng)
    sigma = rng.uniform(2.0, 4.0)
    angle = None if rng.random() < 0.5 else float(rng.uniform(0, np.pi))
    edit = repaint(chosen, lambda pixels, _: blur(pixels, sigma, angle))
    return Variant(
        edit, {"share": share, "sigma_px": sigma, "angle": -1.0 if angle is None else angle}
    )


def _time_offset(extent: Extent, rng: Rng) -> Variant:
    del extent
    ms = float(rng.choice([-1, 1]) * rng.uniform(30, 100))
    # What is to be added to the images' stamps is what was taken from them.
    return Variant(restamp(CAMERA, lambda ns: ns - round(ms * 1e6)), {"offset_ms": ms})


def _extrinsics(extent: Extent, rng: Rng) -> Variant:
    del extent
    axis, degrees = rng.normal(size=3), float(rng.uniform(1, 2))
    turn = rotation(axis, degrees)
    # The stated camera is to be turned back by what was put on.
    back = -degrees * axis / np.sqrt((axis**2).sum())
    return Variant(remount(lambda T: T @ turn), {"turn_deg": back.tolist()})


def _rig_inverted(extent: Extent, rng: Rng) -> Variant:
    del extent, rng
    return Variant(remount(np.linalg.inv), {})


def _coverage(extent: Extent, rng: Rng) -> Variant:
    del extent
    # Backwards: to the side there are points of when the walker looked there, a second before.
    degrees = float(rng.choice([-1, 1]) * rng.uniform(150, 180))
    turn = rotation(np.array([0.0, 1.0, 0.0]), degrees)
    return Variant(remount(lambda T: T @ turn), {"degrees": degrees})


def _pose_jump(extent: Extent, rng: Rng) -> Variant:
    metres, at_ns = rng.uniform(0.2, 1.0), extent.at(rng.uniform(0.2, 0.8))
    way = rng.normal(size=3)
    moves_m = metres * way / np.sqrt((way**2).sum())

    def moved(stamp_ns, place, turn):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202  # as move_poses'
        return [*(place + moves_m * (stamp_ns >= at_ns)), *turn]

    step = int(rng.integers(1, 15))  # 14 to 200 Hz
    edit = chained(keep_every((ODOMETRY,), step), move_poses(moved))
    return Variant(edit, {"metres": metres, "step": step})


def _pose_jerk(extent: Extent, rng: Rng) -> Variant:
    degrees, at_ns = rng.uniform(2, 6), extent.at(rng.uniform(0.2, 0.8))
    R = rotation(rng.normal(size=3), degrees)[:3, :3]

    def moved(stamp_ns, place, turn):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202  # as move_poses'
        new = turn if stamp_ns < at_ns else quaternion_of(matrix_of(turn) @ R)
        return [*place, *new]

    step = int(rng.integers(1, 6))  # below 40 Hz a walk's own turns hide some
    edit = chained(keep_every((ODOMETRY,), step), move_poses(moved))
    return Variant(edit, {"degrees": degrees, "step": step})


def _pose_drift(extent: Extent, rng: Rng) -> Variant:
    speed = rng.uniform(0.06, 0.12)
    way = rng.normal(size=3)
    way *= speed / np.sqrt((way**2).sum())

    def moved(stamp_ns, place, turn):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202  # as move_poses'
        return [*(place + way * (stamp_ns - extent.first_ns) / 1e9), *turn]

    return Variant(move_poses(moved), {"m_per_s": speed, "way": way.tolist()})


FAULTS: Final[dict[str, Callable[[Extent, Rng], Variant]]] = {
    "lidar-rate": _thinned((LIDAR,), 4, 7),
    "image-rate": _image_rate,
    "imu-rate": _thinned((IMU,), 4, 8),
    "pose-rate": _thinned((ODOMETRY,), 80, 160),
    "scans-dropped": _scans_dropped,
    "images-dropped": _images_dropped,
    "imu-dropped": _imu_dropped,
    "lidar-gap": _either(_gap((LIDAR,), 0.8, 2.0), _end((LIDAR,), 2.4, 5.0)),
    "image-gap": _either(_gap(CAMERA, 1.1, 2.5), _end(CAMERA, 2.4, 5.0)),
    "imu-gap": _either(_gap((IMU,), 0.2, 1.0), _end((IMU,), 2.4, 5.0)),
    "pose-gap": _either(_gap((ODOMETRY,), 0.55, 1.5), _end((ODOMETRY,), 4.4, 6.0)),
    "clock-drift": _clock_drift,
    "images-broken": _images_broken,
    "overexposed-start": _overexposed_start,
    "overexposed": _overexposed,
    "too-dark": _too_dark,
    "blurred": _blurred,
    "time-offset": _time_offset,
    "extrinsics": _extrinsics,
    "rig-inverted": _rig_inverted,
    "coverage": _coverage,
    "pose-jump": _pose_jump,
    "pose-jerk": _pose_jerk,
    "pose-drift": _pose_drift,
}
"""What plants each fault, by the code of the check that is to find it."""
