"""How raw points and images become RGB-D frames: every choice that touches a stored pixel."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final


@dataclass(frozen=True, slots=True)
class SelectStage:
    """Which images become frames.

    Attributes:
        min_displacement_m: an image is kept when the camera has moved strictly more than this
            since the previously kept one; 0 keeps every image.
    """

    min_displacement_m: float = 0.10


@dataclass(frozen=True, slots=True)
class FilterStage:
    """Which points count.

    Attributes:
        min_range_m: nearer returns (Euclidean, from the LiDAR) do not count.
        max_range_m: further returns do not count.
        drop_noise: returns that the sensor itself doubts (Livox tags) do not count.
    """

    min_range_m: float = 0.5
    max_range_m: float = 200.0
    drop_noise: bool = True


@dataclass(frozen=True, slots=True)
class AccumulateStage:
    """Which points a frame sees.

    Attributes:
        points: how many.
        window: ``past``, ``centred`` or ``future`` of the image's stamp.
        min_fill: a frame with fewer than ``min_fill * points`` points is dropped and counted.
        max_age_s: points further from the image's stamp do not count; 0 = no limit.
        deskew: move each point by the pose at its own time, not at the scan's stamp.
    """

    points: int = 250_000
    window: str = "past"
    min_fill: float = 1.0
    max_age_s: float = 0.0
    deskew: bool = True


@dataclass(frozen=True, slots=True)
class PosesStage:
    """How far poses are trusted.

    Attributes:
        max_gap_s: points and images between two poses further apart are dropped and counted.
        min_quality: images and points at poses of lower quality are dropped and counted; 0 asks
            for none.
    """

    max_gap_s: float = 0.25
    min_quality: float = 0.0


@dataclass(frozen=True, slots=True)
class ImageStage:
    """How the stored image is made.

    Attributes:
        scale: stored size / raw size.
        undistort: take the lens distortion out.
        codec: ``jpeg`` or ``png``.
        quality: of JPEG, 1 to 100.
        subsampling: of JPEG, ``4:4:4``, ``4:2:2`` or ``4:2:0``.
    """

    scale: float = 0.6
    undistort: bool = True
    codec: str = "jpeg"
    quality: int = 95
    subsampling: str = "4:4:4"


@dataclass(frozen=True, slots=True)
class DepthStage:
    """How the stored depth is made.

    Attributes:
        min_m: nearer points (along the optical axis) are not drawn.
        max_m: further points are not drawn.
        step_m: depth is rounded to this; a power of two, or 0 for none.
    """

    min_m: float = 0.5
    max_m: float = 200.0
    step_m: float = 1.0 / 1024.0


CLOSING_FX_PX: Final = 382.0
"""Focal length at which :attr:`VisibilityStage.closing_px` holds: a D455's at 768 x 432."""


@dataclass(frozen=True, slots=True)
class VisibilityStage:
    """Which pixels are empty after all, because something stands before what they show.

    Attributes:
        points: how many points may hide others: the frame's, which always do, and older ones.
        max_age_s: points further from the image's stamp hide nothing; 0 = no limit.
        closing_px: holes of a front up to this wide are closed, in pixels at a focal length of
            :data:`CLOSING_FX_PX`, and as much wider or narrower as the stored image's is; odd.
        rim_px: how far beyond a pixel a front must reach on every side to hide it, in pixels of
            the stored image.
        gone_px: an older point hides nothing where all of the frame's own points in a square of
            this side lie behind it: what it was of has moved away. In pixels as ``closing_px``;
            odd, or 0: nothing is taken for gone.
        margin_m: a pixel is hidden when it lies behind the front by more than this, and
        margin_share: more than this share of the front's depth.
    """

    points: int = 500_000
    max_age_s: float = 0.0
    closing_px: int = 5
    rim_px: int = 1
    gone_px: int = 0
    margin_m: float = 0.2
    margin_share: float = 0.05


@dataclass(frozen=True, slots=True)
class QualityStage:
    """Which quality planes are stored beside the depth, and how the LiDAR errs.

    Attributes:
        planes: names of :data:`civil_rgbd.domain.frame.QUALITY_PLANES`.
        range_noise_m: standard deviation of a short range to a surface that faces the beam.
        weak_noise_share: of a range, what a weak signal adds to its deviation; the variance that it
            adds grows with the square of the range, and is inverse to the cosine of the angle.
        slant_noise_rad: on slanting surfaces the range errs by this times range times the tangent
            of the angle between beam and normal as well: how far the echo's place wanders within
            the beam's footprint.
        pose_noise_m: standard deviation of where points of one window lie among each other.
    """

    planes: tuple[str, ...] = ("age_s", "bias_m", "empty", "returns", "sigma_m")
    range_noise_m: float = 0.02
    weak_noise_share: float = 0.00033
    slant_noise_rad: float = 0.00035
    pose_noise_m: float = 0.0


@dataclass(frozen=True, slots=True)
class Recipe:
    """All of it. The defaults are the paper's: the recipe ``250k``.

    Stages that are None are not asked for.
    """

    name: str
    description: str = ""
    select: SelectStage = field(default_factory=SelectStage)
    filter: FilterStage = field(default_factory=FilterStage)
    accumulate: AccumulateStage = field(default_factory=AccumulateStage)
    poses: PosesStage = field(default_factory=PosesStage)
    image: ImageStage = field(default_factory=ImageStage)
    depth: DepthStage = field(default_factory=DepthStage)
    visibility: VisibilityStage | None = None
    quality: QualityStage | None = None
