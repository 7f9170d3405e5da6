"""What is checked before leaving a site: a stable code, a figure, a limit, what to do."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final


@dataclass(frozen=True, slots=True)
class Check:
    """One thing that is checked.

    Attributes:
        what: is measured, in words.
        unit: of figure and limit.
        limit: beyond it the recording is not fit.
        fix: what to do then.
        at_least: the figure must not be below the limit; otherwise not above it.
    """

    what: str
    unit: str
    limit: float
    fix: str
    at_least: bool = False


CHECKS: Final[Mapping[str, Check]] = MappingProxyType({
    "lidar-rate": Check(
        "rate of the point clouds", "Hz", 5.0,
        "see the driver's publishing frequency; scan again", at_least=True,
    ),
    "image-rate": Check(
        "rate of the images", "Hz", 3.0,
        "see the camera's frame rate and the recorder's disk; scan again", at_least=True,
    ),
    "imu-rate": Check(
        "rate of the IMU", "Hz", 100.0,
        "see the driver's settings; scan again if poses are yet to be computed", at_least=True,
    ),
    "pose-rate": Check(
        "rate of the poses", "Hz", 5.0,
        "let the odometry write every pose, or compute them again", at_least=True,
    ),
    "scans-dropped": Check(
        "point clouds missing", "%", 2.0,
        "record to a faster disk or with fewer topics, and scan again: points are lost",
    ),
    "images-dropped": Check(
        "images missing", "%", 10.0,
        "record compressed images, or to a faster disk, and scan again",
    ),
    "imu-dropped": Check(
        "IMU readings missing", "%", 2.0,
        "see the LiDAR's cable and the recorder's load; odometry may break: scan again",
    ),
    "lidar-gap": Check(
        "longest silence of the point clouds", "s", 0.35,
        "scan that part again; frames near the gap see older points, or too few",
    ),
    "image-gap": Check(
        "longest silence of the images", "s", 0.5,
        "scan that part again; no frame is made inside the gap",
    ),
    "imu-gap": Check(
        "longest silence of the IMU", "s", 0.1,
        "scan again: odometry does not bridge it",
    ),
    "pose-gap": Check(
        "longest silence of the poses", "s", 0.25,
        "compute the poses again; images and points inside such a gap are dropped",
    ),
    "clock-drift": Check(
        "clocks drifting apart over the recording", "ms", 10.0,
        "synchronise the sensors (PTP, or the host's clock in both drivers), and scan again",
    ),
    "images-broken": Check(
        "images that cannot be decoded", "%", 5.0,
        "see the recorder's disk and the camera's cable; scan again: no frame is made of them",
    ),
    "overexposed-start": Check(
        "over-exposed images at the start", "s", 0.1,
        "",
    ),
    "overexposed": Check(
        "over-exposed images", "%", 5.0,
        "lower the exposure or let the camera choose it, and scan again",
    ),
    "too-dark": Check(
        "images with nothing but black in them", "%", 5.0,
        "take the cap off the lens, bring light or lengthen the exposure, and scan again",
    ),
    "blurred": Check(
        "blurred images", "%", 5.0,
        "shorten the exposure, walk slower, clean and focus the lens; scan again",
    ),
    "time-offset": Check(
        "images off the LiDAR's clock", "ms", 15.0,
        "",
    ),
    "extrinsics": Check(
        "camera turned against the rig", "deg", 0.5,
        "",
    ),
    "rig-inverted": Check(
        "images explained better by the inverse of the mounting", "", 0.0,
        "turn T_lidar_camera round: `civil-rgbd rig check` prints the line for the rig file",
    ),
    "pose-jump": Check(
        "largest jump of the poses", "m", 0.1,
        "compute the poses again, or cut the recording there",
    ),
    "pose-jerk": Check(
        "largest sudden turn of the poses", "deg", 1.0,
        "compute the poses again, or cut the recording there",
    ),
    "pose-drift": Check(
        "points of different times moving apart", "m/s", 0.03,
        "see that the LiDAR's stamps and the poses are of one clock: an offset between them looks "
        "like this; else compute the poses again with a loop closed, or walk slower in sight of "
        "more structure",
    ),
    "frames": Check(
        "frames expected with the recipe", "", 1.0,
        "walk: a recipe keeps an image when the camera has moved", at_least=True,
    ),
    "coverage": Check(
        "pixels with depth expected with the recipe", "%", 10.0,
        "see that LiDAR and camera look the same way; or take a recipe of more points",
        at_least=True,
    ),
})  # fmt: skip
"""Every check by its code; scripts may rely on the codes. An empty remedy comes with the figure."""


@dataclass(frozen=True, slots=True)
class Figure:
    """What a check measured.

    Attributes:
        code: key of :data:`CHECKS`.
        value: in the check's unit; None where it cannot be observed.
        detail: of what and where, in words; where it cannot be observed, why.
        fix: what to do about a finding; by default the check's remedy.
        sigma: standard error, where it is known.
    """

    code: str
    value: float | None
    detail: str = ""
    fix: str = ""
    sigma: float | None = None

    def __post_init__(self) -> None:
        # Frozen: a default that depends on another field goes in by the back door, once.
        object.__setattr__(self, "fix", self.fix or CHECKS[self.code].fix)

    @property
    def check(self) -> Check:
        """What was asked."""
        return CHECKS[self.code]

    @property
    def found(self) -> bool:
        """Whether it is a finding: beyond its limit."""
        if self.value is None:
            return False
        if self.check.at_least:
            return self.value < self.check.limit
        return self.value > self.check.limit

    @property
    def state(self) -> str:
        """``finding``, ``fit`` or ``not observable``."""
        if self.value is None:
            return "not observable"
        return "finding" if self.found else "fit"

    def to_document(self) -> dict[str, object]:
        """Return it for machines."""
        check = self.check
        return {
            "code": self.code,
            "state": self.state,
            "what": check.what,
            "value": self.value,
            "sigma": self.sigma,
            "unit": check.unit,
            "limit": check.limit,
            "at_least": check.at_least,
            "detail": self.detail,
            "fix": self.fix if self.found else None,
        }
