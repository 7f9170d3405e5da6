"""Findings about a recording: a stable code, a level, what there is, what to do."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

CODES: Final = {
    "build-refuses": ("error", ""),
    "camera-size": (
        "error",
        "choose the CameraInfo of this camera (--camera-info-topic), or give it by --rig",
    ),
    "camera-uncalibrated": ("error", "give the camera in a rig file (--rig)"),
    "clocks-apart": (
        "error",
        "give the difference: --rig's camera_time_offset_s moves images, --trajectory-offset poses",
    ),
    "cloud-gap": ("warning", "frames near it see older points, or too few"),
    "damage-salvaged": ("warning", "what is lost goes into the manifest"),
    "damaged": ("error", "record or copy it again, or go on with what is readable: --salvage"),
    "first-image-broken": ("warning", "a build counts such images and goes on"),
    "image-encoding": ("error", "convert the images, or choose another topic with --image-topic"),
    "image-gap": ("warning", "no frame is made inside it"),
    "message-broken": (
        "error",
        "go on without what is broken: --salvage; or choose another topic, or record again",
    ),
    "no-camera-link": (
        "error",
        "give T_lidar_camera in a rig file (--rig); `civil-rgbd rig import` reads calibrations",
    ),
    "no-camera-model": (
        "error",
        "give the camera in a rig file (--rig); `civil-rgbd rig import` reads calibrations",
    ),
    "no-images": ("error", "give --images FOLDER --image-times FILE, or record images"),
    "no-lidar-link": ("error", "give T_body_lidar in a rig file (--rig), or say --pose-of"),
    "no-point-clouds": ("error", "record sensor_msgs/PointCloud2 or a Livox CustomMsg"),
    "no-point-time": ("warning", "the build goes on without de-skewing"),
    "no-poses": ("error", "give --trajectory FILE; `civil-rgbd poses` makes one"),
    "no-scan-times": (
        "error",
        "give --scan-times FILE: a stamp in seconds a line, in order of the files, or NAME,SECONDS",
    ),
    "point-time-unclear": ("error", "say what it means: --point-time FIELD:UNIT:REFERENCE"),
    "pose-gap": ("warning", "images and points inside a gap above poses.max_gap_s are dropped"),
    "pose-of-unknown": ("error", "say so: --pose-of camera, lidar or imu"),
    "power-on-clock": ("warning", "other clocks must agree with it: see `clocks`"),
    "scans-in-unknown": (
        "error",
        "say so: --scans-in lidar for scans as measured, map for registered ones",
    ),
    "several-camera-info-topics": ("error", ""),
    "several-image-topics": ("error", ""),
    "several-lidar-frames": ("error", "record each LiDAR under a topic of its own"),
    "several-lidar-topics": ("error", ""),
    "several-pose-frames": ("error", "choose other poses with --pose-topic"),
    "several-pose-topics": ("error", ""),
    "stamps-backward": ("warning", "a build refuses this of poses; elsewhere it is harmless"),
    "stamps-zero": ("warning", "headers carry no time: set the driver's stamps and record again"),
}
"""Level and remedy of every finding, by code; an empty remedy comes with the finding itself."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that is missing, or odd.

    Attributes:
        code: key of :data:`CODES`; scripts may rely on it.
        message: what is there, with values.
        fix: what to do about it; by default the code's remedy.
    """

    code: str
    message: str
    fix: str = ""

    def __post_init__(self) -> None:
        # Frozen: a default that depends on another field goes in by the back door, once.
        object.__setattr__(self, "fix", self.fix or CODES[self.code][1])

    @property
    def level(self) -> str:
        """``error``: no build starts; ``warning``: one does."""
        return CODES[self.code][0]

    def to_document(self) -> dict[str, str]:
        """Return it for machines."""
        return {
            "code": self.code,
            "level": self.level,
            "message": self.message,
            "fix": self.fix,
        }
