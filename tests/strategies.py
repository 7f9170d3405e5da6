"""Hypothesis strategies of the nouns; a new noun adds its strategy here."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import strategies as st
from numpy.typing import NDArray

from civil_rgbd.domain.scan import LidarScan
from civil_rgbd.geometry.camera import LensCamera, PinholeCamera
from civil_rgbd.geometry.trajectory import Trajectory

from .recordings import trajectory_of

seeds = st.integers(0, 2**32 - 1)


def finite(low: float, high: float) -> st.SearchStrategy[float]:
    """Finite floats between two bounds, inclusive."""
    return st.floats(low, high, allow_nan=False, allow_infinity=False, allow_subnormal=False)


@st.composite
def unit_quaternions(draw: st.DrawFn) -> NDArray[np.float64]:
    """(4,) unit quaternion xyzw with w >= 0, over all rotations; identity and half turns too."""
    special = draw(st.integers(0, 7))
    if special < 4:
        q = np.zeros(4)
        q[special] = 1.0
        return q
    rng = np.random.default_rng(draw(seeds))
    q = rng.normal(size=4)
    q /= math.sqrt(float((q * q).sum()))
    return -q if q[3] < 0 else q


@st.composite
def rigid_transforms(draw: st.DrawFn, *, reach_m: float = 50.0) -> NDArray[np.float64]:
    """(4, 4) rigid transforms, written from the quaternion by the textbook, not by geometry."""
    x, y, z, w = draw(unit_quaternions())
    T = np.eye(4)
    T[:3, :3] = [
        [w * w + x * x - y * y - z * z, 2 * x * y - 2 * w * z, 2 * x * z + 2 * w * y],
        [2 * x * y + 2 * w * z, w * w - x * x + y * y - z * z, 2 * y * z - 2 * w * x],
        [2 * x * z - 2 * w * y, 2 * y * z + 2 * w * x, w * w - x * x - y * y + z * z],
    ]
    T[:3, 3] = [draw(finite(-reach_m, reach_m)) for _ in range(3)]
    return T


@st.composite
def pinhole_cameras(draw: st.DrawFn, *, largest_px: int = 80) -> PinholeCamera:
    """Pinholes whose axes differ in everything, so that a swap shows."""
    width_px, height_px = draw(st.integers(1, largest_px)), draw(st.integers(1, largest_px))
    return PinholeCamera(
        width_px=width_px,
        height_px=height_px,
        fx_px=draw(finite(0.3, 2.0)) * width_px,
        fy_px=draw(finite(0.3, 2.0)) * height_px,
        cx_px=draw(finite(-0.2, 1.2)) * width_px,
        cy_px=draw(finite(-0.2, 1.2)) * height_px,
    )


_LENSES = [
    ("none", 0),
    ("plumb_bob", 4),
    ("plumb_bob", 5),
    ("rational_polynomial", 8),
    ("rational_polynomial", 12),
    ("fisheye", 4),
]


@st.composite
def lens_cameras(draw: st.DrawFn) -> LensCamera:
    """Lenses of every model, about as strong as those of real cameras."""
    lens, count = draw(st.sampled_from(_LENSES))
    limits = [0.2, 0.08, 0.01, 0.01, 0.03, 0.1, 0.05, 0.01, 0.01, 0.01, 0.01, 0.01]
    if lens == "fisheye":
        limits = [0.1, 0.03, 0.01, 0.005]
    coefficients = tuple(draw(finite(-limit, limit)) for limit in limits[:count])
    return LensCamera(draw(pinhole_cameras()), lens, coefficients)


@st.composite
def trajectories(draw: st.DrawFn, *, most_poses: int = 6) -> Trajectory:
    """Trajectories with uneven steps and free rotations."""
    count = draw(st.integers(1, most_poses))
    steps = draw(st.lists(st.integers(1, 10**9), min_size=count, max_size=count))
    start = draw(st.sampled_from([0, 1_700_000_000_000_000_000]))
    return trajectory_of(
        [start + sum(steps[: i + 1]) for i in range(count)],
        [[draw(finite(-100.0, 100.0)) for _ in range(3)] for _ in range(count)],
        [draw(unit_quaternions()) for _ in range(count)],
    )


@st.composite
def scans(draw: st.DrawFn, *, around_ns: int = 0, most_points: int = 12) -> LidarScan:
    """Scans of few points with coarse stamps: equal stamps and overlaps are the rule."""
    count = draw(st.integers(0, most_points))
    stamp_ns = around_ns + draw(st.integers(-8, 8))
    offsets = draw(st.none() | st.lists(st.integers(-6, 10), min_size=count, max_size=count))
    rng = np.random.default_rng(draw(seeds))
    return LidarScan(
        stamp_ns=stamp_ns,
        points=rng.uniform(-20, 20, size=(count, 3)).astype(np.float32),
        point_stamps_ns=None if offsets is None else np.array(offsets, dtype=np.int64) + stamp_ns,
    )


@st.composite
def recordings_of_scans(draw: st.DrawFn, *, most_scans: int = 8) -> list[LidarScan]:
    """Messages whose headers may be out of order and whose points overlap."""
    count = draw(st.integers(0, most_scans))
    strays = draw(st.lists(st.booleans(), min_size=count, max_size=count))
    return [
        draw(scans(around_ns=draw(st.integers(0, 6 * most_scans)) if stray else 6 * i))
        for i, stray in enumerate(strays)
    ]
