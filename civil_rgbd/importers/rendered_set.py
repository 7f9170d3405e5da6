"""An already rendered set: which images, which depth, from where, behind which camera."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.geometry.camera import LensCamera, PinholeCamera

DIRECTIONS: Final = ("camera-to-map", "map-to-camera")
"""What a pose file's matrices do to a point."""

LENSES: Final = ("undistort", "ignore")
"""Take the lens distortion out of images and depth; or its coefficients are history already."""

DEPTH_AXES: Final = ("z", "ray")
"""Depth along the optical axis, or along each pixel's ray."""


@dataclass(frozen=True, slots=True)
class ImportOptions:
    """What a user says about a set that the set does not say itself.

    Attributes:
        poses: the poses' file or folder, where it is not found or several are.
        intrinsics: the camera's file, or ``fx,fy,cx,cy``.
        stamps: the file of the images' time stamps.
        depth_scale: stored units a metre; None lets the importer and the poses tell.
        depth_along: one of :data:`DEPTH_AXES`.
        direction: one of :data:`DIRECTIONS`.
        lens: one of :data:`LENSES`; None refuses a camera with distortion.
    """

    poses: Path | None = None
    intrinsics: str | None = None
    stamps: Path | None = None
    depth_scale: float | None = None
    depth_along: str = "z"
    direction: str = "camera-to-map"
    lens: str | None = None


@dataclass(frozen=True, slots=True)
class Intrinsics:
    """A camera as its file has it: fy may be negative, and the size may be missing.

    Attributes:
        fx_px: focal length along x.
        fy_px: focal length along y; negative where the camera's y axis points up.
        cx_px: column of the principal point; pixel (0, 0) is a pixel's centre.
        cy_px: row of the principal point.
        width_px: columns; None where the file does not say.
        height_px: rows; None where the file does not say.
        coefficients: of the lens, OpenCV's order; () for none.
    """

    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    width_px: int | None = None
    height_px: int | None = None
    coefficients: tuple[float, ...] = ()

    @property
    def distorts(self) -> bool:
        """Whether the lens moves any pixel."""
        return any(self.coefficients)

    def sized(self, width_px: int, height_px: int) -> LensCamera:
        """Return the camera of an image of this size; fy becomes positive.

        Each axis is scaled by its own factor, as a resized image is: ``cx' = (cx + 0.5) s - 0.5``.
        """
        sx = width_px / (self.width_px or width_px)
        sy = height_px / (self.height_px or height_px)
        pinhole = PinholeCamera(
            width_px=width_px,
            height_px=height_px,
            fx_px=self.fx_px * sx,
            fy_px=abs(self.fy_px) * sy,
            cx_px=_resized(self.cx_px, sx),
            cy_px=_resized(self.cy_px, sy),
        )
        if not self.distorts:
            return LensCamera(pinhole)
        model = "plumb_bob" if len(self.coefficients) <= 5 else "rational_polynomial"
        return LensCamera(pinhole, model, self.coefficients)


def _resized(centre_px: float, scale: float) -> float:
    # Unscaled it stays to the last bit, which adding and taking away half a pixel may change.
    return centre_px if scale == 1 else (centre_px + 0.5) * scale - 0.5


@dataclass(frozen=True, slots=True, eq=False)
class SetFrame:
    """One image with its depth and its pose; the files are not read yet.

    Attributes:
        source_index: the image's number in the set.
        stamp_ns: nanoseconds.
        rgb: the colour image.
        depth: the depth image.
        T_map_camera: (4, 4) float64, rigid.
    """

    source_index: int
    stamp_ns: int
    rgb: Path
    depth: Path
    T_map_camera: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class RenderedSet:
    """A set that an importer understood.

    Attributes:
        root: its folder.
        importer: who understood it.
        frames: those with image, depth and pose; ids and stamps ascend.
        intrinsics: of the colour images.
        depth_intrinsics: of the depth images, where they have their own.
        declared_scale: stored depth units a metre, as the layout has it.
        files: every file that says something: documents, images, depth.
        images_seen: colour images in the set.
        dropped: images that become no frame, by reason.
        skipped: other things that are left out, by name.
        warnings: what a reader of the bridge must know, in words.
    """

    root: Path
    importer: str
    frames: tuple[SetFrame, ...]
    intrinsics: Intrinsics
    depth_intrinsics: Intrinsics | None
    declared_scale: float
    files: tuple[Path, ...]
    images_seen: int
    dropped: Mapping[str, int] = field(default_factory=dict)
    skipped: Mapping[str, int] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
