"""One RGB-D frame, and its row in ``frames.parquet``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.geometry.camera import PinholeCamera

EMPTY: Final[Mapping[str, int]] = {
    "depth": 0,
    "no-return": 1,
    "hidden": 2,
    "out-of-range": 3,
    "no-source": 4,
}
"""Codes of the quality plane ``empty``: it has depth; no return fell into it; the depth was removed
because something stands before it; returns fell into it, all out of the recipe's depth range; the
raw image does not have it."""

QUALITY_PLANES: Final[Mapping[str, tuple[str, str]]] = {
    "age_s": (
        "s",
        (
            "How much older than the image the return is that won the pixel; negative = younger. 0 "
            "without depth."
        ),
    ),
    "bias_m": (
        "m",
        (
            "Expected depth - truth: not above 0, for of many returns in one pixel the nearest "
            "wins. (depth - bias_m - truth) / sigma_m is a standard score. 0 without depth."
        ),
    ),
    "empty": (
        "1",
        (
            "Why the pixel has no depth: 0 = it has; 1 = no return fell into it; 2 = its depth was "
            "removed by the stage visibility; 3 = returns fell into it, all of them nearer or "
            "further than depth.min_m and depth.max_m allow; 4 = the raw image does not have it."
        ),
    ),
    "returns": (
        "1",
        (
            "How many returns of the frame's points fell into the pixel, at most 2048 are counted; "
            "also where the depth was removed."
        ),
    ),
    "sigma_m": (
        "m",
        (
            "Expected standard deviation of depth - truth, along the optical axis, as the recipe's "
            "stage quality describes the sensor. 0 without depth."
        ),
    ),
}
"""Unit and meaning of each quality plane, by name, in the order of their names."""


def frame_id_from(source_index: int) -> str:
    """Return the id of the image with this index in its recording.

    >>> frame_id_from(42)
    '000042'
    """
    return f"{source_index:06d}"


@dataclass(frozen=True, slots=True, eq=False)
class RgbdFrame:
    """One image with its depth.

    Attributes:
        source_index: the image's place in the recording.
        stamp_ns: corrected stamp, LiDAR clock.
        source_stamp_ns: original stamp, camera clock.
        rgb: (H, W, 3) uint8, undistorted.
        depth_m: (H, W) float32, metres along the optical axis, 0 = nothing measured.
        camera: the pinhole of both.
        T_map_camera: (4, 4) float64.
        quality: (H, W) float16 each, by name, in the order of their names; see
            :data:`QUALITY_PLANES`. None where nobody asked.
    """

    source_index: int
    stamp_ns: int
    source_stamp_ns: int
    rgb: NDArray[np.uint8]
    depth_m: NDArray[np.float32]
    camera: PinholeCamera
    T_map_camera: NDArray[np.float64]
    quality: Mapping[str, NDArray[np.float16]] | None = None

    def __post_init__(self) -> None:
        size = (self.camera.height_px, self.camera.width_px)
        if self.rgb.shape != (*size, 3) or self.depth_m.shape != size:
            raise ValueError(
                f"rgb {self.rgb.shape} and depth {self.depth_m.shape} do not fit the camera {size}"
            )
        for name, plane in (self.quality or {}).items():
            if plane.shape != size or plane.dtype != np.float16:
                raise ValueError(f"quality plane {name!r} is {plane.dtype} {plane.shape}")

    @property
    def frame_id(self) -> str:
        """Six digits."""
        return frame_id_from(self.source_index)


@dataclass(frozen=True, slots=True)
class FrameRow:
    """One row of ``frames.parquet``; the column names are the field names.

    Paths are relative to the bridge folder, with forward slashes. ``tx .. qw`` is T_map_camera.
    """

    frame_id: str
    source_index: int
    stamp_ns: int
    source_stamp_ns: int
    rgb_path: str
    depth_path: str
    quality_path: str | None
    tx: float
    ty: float
    tz: float
    qx: float
    qy: float
    qz: float
    qw: float
    valid_share: float
    depth_min_m: float
    depth_max_m: float
    rgb_file_sha256: str
    rgb_pixel_sha256: str
    depth_file_sha256: str
    depth_pixel_sha256: str
    quality_file_sha256: str | None
    quality_pixel_sha256: str | None
