"""How the sensors of a recording are mounted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.constants import MAX_CLOCK_OFFSET_S
from civil_rgbd.geometry.camera import LensCamera
from civil_rgbd.geometry.transforms import compose, inverse, rigid_fault


@dataclass(frozen=True, slots=True, eq=False)
class Rig:
    """Camera, LiDAR, and the body that the trajectory speaks of.

    Attributes:
        camera: the raw camera.
        T_body_camera: (4, 4), camera optical frame to body.
        T_body_lidar: (4, 4), LiDAR frame to body.
        camera_time_offset_s: added to image stamps to reach the LiDAR clock.
        body: what the poses move, in the recording's own words (its frame id).
        lidar_name: the sensor's name, for the manifest.
        camera_name: the sensor's name, for the manifest.
    """

    camera: LensCamera
    T_body_camera: NDArray[np.float64]
    T_body_lidar: NDArray[np.float64]
    camera_time_offset_s: float = 0.0
    body: str = "lidar"
    lidar_name: str = "unknown"
    camera_name: str = "unknown"

    def __post_init__(self) -> None:
        for name in ("T_body_camera", "T_body_lidar"):
            fault = rigid_fault(getattr(self, name))
            if fault:
                raise ValueError(f"{name} is no rigid transform: {fault}")
        if not abs(self.camera_time_offset_s) <= MAX_CLOCK_OFFSET_S:
            raise ValueError(f"camera_time_offset_s is {self.camera_time_offset_s!r}")

    @property
    def T_lidar_camera(self) -> NDArray[np.float64]:
        """(4, 4), camera optical frame to LiDAR frame."""
        return compose(inverse(self.T_body_lidar), self.T_body_camera)

    @property
    def camera_time_offset_ns(self) -> int:
        """``camera_time_offset_s`` in whole nanoseconds, rounded to nearest."""
        return round(self.camera_time_offset_s * 1e9)


@dataclass(frozen=True, slots=True, eq=False)
class RigFile:
    """What a rig file says; None and absent where it says nothing.

    Attributes:
        camera: the raw camera.
        rectified: the images are rectified already.
        extrinsics: ``T_a_b`` (4, 4) by (a, b); frames are lidar, camera, imu and body.
        camera_time_offset_s: added to image stamps to reach the LiDAR clock.
        camera_name: the camera's name.
        lidar_name: the LiDAR's name.
        map_up: unit vector against gravity, map frame.
    """

    camera: LensCamera | None = None
    rectified: bool = False
    extrinsics: Mapping[tuple[str, str], NDArray[np.float64]] = field(default_factory=dict)
    camera_time_offset_s: float | None = None
    camera_name: str | None = None
    lidar_name: str | None = None
    map_up: tuple[float, float, float] | None = None
