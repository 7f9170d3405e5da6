"""Cameras: the ideal pinhole of stored images, and the lens of raw ones."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

LENS_COEFFICIENTS: Final = {
    "none": (0,),
    "plumb_bob": (4, 5),
    "rational_polynomial": (8, 12),
    "fisheye": (4,),
}
"""How many distortion coefficients each lens model takes, in OpenCV's order."""

_RADIUS_SAMPLES = 8192  # fine enough: the valid radius is found to 1/8192 of the image's corner
_ATAN_TERMS = 60


@dataclass(frozen=True, slots=True)
class PinholeCamera:
    """An ideal pinhole. Axes: x right, y down, z forward. Pixel (0, 0) is a pixel's centre.

    Attributes:
        width_px: columns of the image.
        height_px: rows of the image.
        fx_px: focal length along x.
        fy_px: focal length along y.
        cx_px: column of the principal point.
        cy_px: row of the principal point.
    """

    width_px: int
    height_px: int
    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float

    def __post_init__(self) -> None:
        if min(self.width_px, self.height_px) < 1:
            raise ValueError(f"the image has no pixels: {self.width_px} x {self.height_px}")
        if not all(map(math.isfinite, (self.fx_px, self.fy_px, self.cx_px, self.cy_px))):
            raise ValueError("focal lengths and principal point are not finite")
        if min(self.fx_px, self.fy_px) <= 0:
            raise ValueError(f"focal lengths are not positive: {self.fx_px}, {self.fy_px}")

    @property
    def matrix(self) -> NDArray[np.float64]:
        """The intrinsic matrix K, (3, 3) float64."""
        return np.array(
            [[self.fx_px, 0.0, self.cx_px], [0.0, self.fy_px, self.cy_px], [0.0, 0.0, 1.0]]
        )

    def scaled(self, scale: float) -> PinholeCamera:
        """Return the camera of the image resized by ``scale``.

        The size is rounded half up; each axis then has its own exact factor, and the centre of
        the pixel (0, 0) moves: ``cx' = (cx + 0.5) sx - 0.5``.

        >>> camera = PinholeCamera(1280, 720, 640.0, 640.0, 639.5, 359.5).scaled(0.6)
        >>> camera.width_px, camera.fx_px, camera.cx_px
        (768, 384.0, 383.5)
        """
        width_px = max(1, math.floor(self.width_px * scale + 0.5))
        height_px = max(1, math.floor(self.height_px * scale + 0.5))
        sx, sy = width_px / self.width_px, height_px / self.height_px
        return PinholeCamera(
            width_px=width_px,
            height_px=height_px,
            fx_px=self.fx_px * sx,
            fy_px=self.fy_px * sy,
            cx_px=(self.cx_px + 0.5) * sx - 0.5,
            cy_px=(self.cy_px + 0.5) * sy - 0.5,
        )

    def cropped(self, *, left_px: int, top_px: int, width_px: int, height_px: int) -> PinholeCamera:
        """Return the camera of the given window of the image; it may reach over the edge."""
        return replace(
            self,
            width_px=width_px,
            height_px=height_px,
            cx_px=self.cx_px - left_px,
            cy_px=self.cy_px - top_px,
        )


@dataclass(frozen=True, slots=True)
class LensCamera:
    """A raw camera: a pinhole behind a lens.

    Attributes:
        pinhole: size and intrinsics of the raw image (K of CameraInfo).
        lens: key of :data:`LENS_COEFFICIENTS`; OpenCV's models of those names, where
            ``fisheye`` is the equidistant (Kannala-Brandt) one.
        coefficients: distortion coefficients in OpenCV's order, k1 k2 p1 p2 k3 k4 k5 k6 s1..s4,
            or k1..k4 for ``fisheye``.
    """

    pinhole: PinholeCamera
    lens: str = "none"
    coefficients: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if self.lens not in LENS_COEFFICIENTS:
            raise ValueError(f"lens model {self.lens!r} is none of {', '.join(LENS_COEFFICIENTS)}")
        if len(self.coefficients) not in LENS_COEFFICIENTS[self.lens]:
            raise ValueError(
                f"lens model {self.lens!r} takes {LENS_COEFFICIENTS[self.lens]} coefficients, "
                f"not {len(self.coefficients)}"
            )
        if not all(map(math.isfinite, self.coefficients)):
            raise ValueError("a distortion coefficient is not finite")

    @property
    def distorts(self) -> bool:
        """Whether the lens moves any pixel."""
        return self.lens == "fisheye" or any(self.coefficients)


def distort(
    camera: LensCamera, x: NDArray[np.float64], y: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Move ideal normalised image coordinates to where the lens puts them.

    Args:
        camera: the lens.
        x: any shape, X / Z.
        y: same shape, Y / Z.

    Returns:
        distorted x and y, same shape. Formulas: OpenCV, "Camera Calibration and 3D
        Reconstruction" and "Fisheye camera model".
    """
    if not camera.distorts:
        return x, y
    if camera.lens == "fisheye":
        r = np.sqrt(x * x + y * y)
        factor = np.where(r > 0, _distorted_radius(camera, r) / np.where(r > 0, r, 1.0), 1.0)
        return x * factor, y * factor
    k = (*camera.coefficients, *(0.0,) * (12 - len(camera.coefficients)))
    p1, p2, s1, s2, s3, s4 = k[2], k[3], k[8], k[9], k[10], k[11]
    r2 = x * x + y * y
    factor = _radial_factor(k, r2)
    return (
        x * factor + 2 * p1 * x * y + p2 * (r2 + 2 * x * x) + s1 * r2 + s2 * r2 * r2,
        y * factor + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y + s3 * r2 + s4 * r2 * r2,
    )


def _radial_factor(k: tuple[float, ...], r2: NDArray[np.float64]) -> NDArray[np.float64]:
    k1, k2, k3, k4, k5, k6 = k[0], k[1], k[4], k[5], k[6], k[7]
    above = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    below = 1 + r2 * (k4 + r2 * (k5 + r2 * k6))
    factor: NDArray[np.float64] = above / np.where(below == 0, np.inf, below)
    return factor


def _distorted_radius(camera: LensCamera, r: NDArray[np.float64]) -> NDArray[np.float64]:
    """The radial part of the lens: ideal radius to distorted radius, both normalised."""
    if camera.lens == "fisheye":
        k1, k2, k3, k4 = camera.coefficients
        theta = _arctan(r)
        t2 = theta * theta
        return theta * (1 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4))))
    k = (*camera.coefficients, *(0.0,) * (12 - len(camera.coefficients)))
    return r * _radial_factor(k, r * r)


def _arctan(x: NDArray[np.float64]) -> NDArray[np.float64]:
    # Spelt out, as libraries differ in the last bit: halve the angle three times, then the series.
    for _ in range(3):
        x = x / (1 + np.sqrt(1 + x * x))
    square = x * x
    series = np.zeros_like(x)
    for n in range(_ATAN_TERMS, -1, -1):
        series = (1.0 if n % 2 == 0 else -1.0) / (2 * n + 1) + square * series
    return 8 * x * series


def valid_radius(camera: LensCamera, furthest: float) -> float:
    """Return the ideal radius up to which the lens model can be inverted.

    Beyond the first radius where the distorted radius stops growing, two rays share a pixel and
    the polynomial means nothing: points there must not be drawn.

    Args:
        camera: the lens.
        furthest: the largest ideal radius of interest, normalised (X / Z).

    Returns:
        a radius of at most ``furthest``, normalised.
    """
    if not camera.distorts:
        return furthest
    r = np.linspace(0.0, furthest, _RADIUS_SAMPLES)
    turned = np.flatnonzero(np.diff(_distorted_radius(camera, r)) <= 0)
    return float(r[turned[0]]) if len(turned) else furthest


@dataclass(frozen=True, slots=True, eq=False)
class SourcePixels:
    """Where each pixel of a stored image comes from in the raw one.

    Attributes:
        columns: (H, W) float32, raw image, pixel centres at whole numbers.
        rows: (H, W) float32.
        exists: (H, W) bool; False where the raw image or the lens model has no such pixel.
    """

    columns: NDArray[np.float32]
    rows: NDArray[np.float32]
    exists: NDArray[np.bool_]


def source_pixels(raw: LensCamera, stored: PinholeCamera) -> SourcePixels:
    """Undistort and resize as one lookup.

    Args:
        raw: the camera that took the image.
        stored: the pinhole of the image to make; it looks the same way.

    Returns:
        for every pixel of ``stored`` its place in the raw image.
    """
    u = (np.arange(stored.width_px, dtype=np.float64) - stored.cx_px) / stored.fx_px
    v = (np.arange(stored.height_px, dtype=np.float64) - stored.cy_px) / stored.fy_px
    x, y = np.meshgrid(u, v)
    radius = np.sqrt(x * x + y * y)
    distorted_x, distorted_y = distort(raw, x, y)
    columns = distorted_x * raw.pinhole.fx_px + raw.pinhole.cx_px
    rows = distorted_y * raw.pinhole.fy_px + raw.pinhole.cy_px
    exists = (
        (radius <= valid_radius(raw, float(radius.max())))
        & (columns >= -0.5)
        & (columns <= raw.pinhole.width_px - 0.5)
        & (rows >= -0.5)
        & (rows <= raw.pinhole.height_px - 0.5)
    )
    return SourcePixels(columns.astype(np.float32), rows.astype(np.float32), exists)
