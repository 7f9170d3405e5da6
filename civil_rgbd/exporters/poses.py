"""Poses of frames, as exporters write them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.domain.frame import FrameRow
from civil_rgbd.geometry.transforms import matrix_from_quaternion, transform_from


def transform_of(row: FrameRow) -> NDArray[np.float64]:
    """Return a frame's ``T_map_camera``: (4, 4) float64."""
    R = matrix_from_quaternion([row.qx, row.qy, row.qz, row.qw])
    return transform_from(R, [row.tx, row.ty, row.tz])


def stamp_text(stamp_ns: int) -> str:
    """Write a stamp as seconds with nine decimals, exactly.

    >>> stamp_text(1305031102175304001), stamp_text(-1)
    ('1305031102.175304001', '-0.000000001')
    """
    sign, whole = ("-" if stamp_ns < 0 else ""), abs(stamp_ns)
    return f"{sign}{whole // 10**9}.{whole % 10**9:09d}"
