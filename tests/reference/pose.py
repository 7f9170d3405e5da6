"""The pose at an instant, by SciPy."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp


def pose_at(
    stamps_ns: Sequence[int],
    translations_m: Sequence[Sequence[float]],
    quaternions_xyzw: Sequence[Sequence[float]],
    stamp_ns: int,
) -> NDArray[np.float64]:
    """Return ``T_map_body`` (4, 4) at one instant inside the trajectory."""
    # Seconds since the first pose: float64 does not hold nanoseconds since 1970.
    seconds = [(stamp - stamps_ns[0]) / 1e9 for stamp in stamps_ns]
    now = (stamp_ns - stamps_ns[0]) / 1e9
    T = np.eye(4)
    T[:3, 3] = [np.interp(now, seconds, axis) for axis in zip(*translations_m, strict=True)]
    T[:3, :3] = Slerp(seconds, Rotation.from_quat(quaternions_xyzw))(now).as_matrix()
    return T
