"""Where one pixel of a stored image comes from, one number at a time."""

from __future__ import annotations

import math
from collections.abc import Sequence


def distorted(lens: str, k: Sequence[float], x: float, y: float) -> tuple[float, float]:
    """Return where a lens puts the ideal normalised point (x, y); the manual of OpenCV says how."""
    if lens == "none":
        return x, y
    if lens == "fisheye":
        r = math.hypot(x, y)
        theta = math.atan(r)
        bent = theta + k[0] * theta**3 + k[1] * theta**5 + k[2] * theta**7 + k[3] * theta**9
        return (x * bent / r, y * bent / r) if r else (x, y)
    k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4 = (*k, *[0.0] * (12 - len(k)))
    r = math.hypot(x, y)
    radial = (1 + k1 * r**2 + k2 * r**4 + k3 * r**6) / (1 + k4 * r**2 + k5 * r**4 + k6 * r**6)
    return (
        x * radial + 2 * p1 * x * y + p2 * (r**2 + 2 * x**2) + s1 * r**2 + s2 * r**4,
        y * radial + p1 * (r**2 + 2 * y**2) + 2 * p2 * x * y + s3 * r**2 + s4 * r**4,
    )


def source_of(
    column: int,
    row: int,
    *,
    size: tuple[int, int],
    K: Sequence[float],
    lens: str,
    k: Sequence[float],
    scale: float,
) -> tuple[float, float]:
    """Return the place in the raw image of a pixel of the undistorted image resized by ``scale``.

    Args:
        column: of the stored pixel.
        row: of the stored pixel.
        size: width and height of the raw image.
        K: fx, fy, cx, cy of the raw image.
        lens: the lens model.
        k: its coefficients.
        scale: stored size / raw size.
    """
    fx, fy, cx, cy = K
    # A pixel's centre is half a pixel from its edge, and resizing maps edges to edges.
    sx = max(1, math.floor(size[0] * scale + 0.5)) / size[0]
    sy = max(1, math.floor(size[1] * scale + 0.5)) / size[1]
    undistorted = (column + 0.5) / sx - 0.5, (row + 0.5) / sy - 0.5
    x, y = distorted(lens, k, (undistorted[0] - cx) / fx, (undistorted[1] - cy) / fy)
    return x * fx + cx, y * fy + cy
