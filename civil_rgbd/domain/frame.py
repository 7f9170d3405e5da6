"""One RGB-D frame, and its row in ``frames.parquet``."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.geometry.camera import PinholeCamera


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
    """

    source_index: int
    stamp_ns: int
    source_stamp_ns: int
    rgb: NDArray[np.uint8]
    depth_m: NDArray[np.float32]
    camera: PinholeCamera
    T_map_camera: NDArray[np.float64]

    def __post_init__(self) -> None:
        size = (self.camera.height_px, self.camera.width_px)
        if self.rgb.shape != (*size, 3) or self.depth_m.shape != size:
            raise ValueError(
                f"rgb {self.rgb.shape} and depth {self.depth_m.shape} do not fit the camera {size}"
            )

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
