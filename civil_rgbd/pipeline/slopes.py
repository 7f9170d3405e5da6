"""How surfaces slant, from their sparse depth alone.

The inverse depth of a plane is linear in the pixel: 1 / Z = A x + B y + C, where x and y are
normalised coordinates and (A, B, C) is along its normal. So planes are fitted to inverse depths.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numba
import numpy as np
from numpy.typing import NDArray

from civil_rgbd.geometry.camera import PinholeCamera

_REACH_PX: Final = 5  # neighbours that speak for a pixel's surface
_SAME_SURFACE: Final = 0.15  # of the depth: a surface seen at 5 degrees changes so much over 5 px
_FEWEST: Final = 6  # neighbours; fewer say nothing
_UNKNOWN: Final = 3.0  # tangent where nobody can tell: edges, leaves and grazing ground far away


@dataclass(frozen=True, slots=True, eq=False)
class Slopes:
    """How the surface behind each pixel slants; that of a slanting surface where nobody can tell.

    Attributes:
        tangent: (H, W) float64, of the angle between ray and normal: 0 = head on.
        spread_m: (H, W) float64, standard deviation of the surface's depth over the pixel.
        rough_m: (H, W) float64, root of the mean square by which neighbours miss the plane.
    """

    tangent: NDArray[np.float64]
    spread_m: NDArray[np.float64]
    rough_m: NDArray[np.float64]


def slopes_of(depth_m: NDArray[np.float32], camera: PinholeCamera, *, noise_m: float) -> Slopes:
    """Fit a plane to each pixel with depth and its neighbours of about the same depth.

    Args:
        depth_m: (H, W) float32, metres, 0 = nothing measured.
        camera: the pinhole.
        noise_m: standard deviation of a depth: noise looks like slant, and is taken off.
    """
    planes = np.zeros((3, *depth_m.shape))
    pinhole = (camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px)
    _fit(depth_m, pinhole, noise_m, planes)
    return Slopes(*planes)


@numba.njit(cache=True, nogil=True)
def _fit(depth_m, pinhole, noise_m, out):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202  # a kernel: numba infers
    tangent, spread_m, rough_m = out
    height, width = depth_m.shape
    fx, fy, cx, cy = pinhole
    for v in range(height):
        for u in range(width):
            depth = np.float64(depth_m[v, u])
            if depth <= 0.0:
                continue
            tangent[v, u] = _UNKNOWN
            low, high = depth * (1.0 - _SAME_SURFACE), depth * (1.0 + _SAME_SURFACE)
            count = su = sv = suu = suv = svv = sq = suq = svq = sqq = 0.0
            for y in range(max(v - _REACH_PX, 0), min(v + _REACH_PX + 1, height)):
                for x in range(max(u - _REACH_PX, 0), min(u + _REACH_PX + 1, width)):
                    other = np.float64(depth_m[y, x])
                    if low <= other <= high:
                        du, dv, q = np.float64(x - u), np.float64(y - v), 1.0 / other
                        count += 1.0
                        su, sv, sq = su + du, sv + dv, sq + q
                        suu, suv, svv = suu + du * du, suv + du * dv, svv + dv * dv
                        suq, svq, sqq = suq + du * q, svq + dv * q, sqq + q * q
            if count < _FEWEST:
                continue
            suu, suv, svv = suu - su * su / count, suv - su * sv / count, svv - sv * sv / count
            suq, svq = suq - su * sq / count, svq - sv * sq / count
            determinant = suu * svv - suv * suv
            if determinant <= 1e-3 * suu * svv:
                continue  # neighbours in one line
            b = (svv * suq - suv * svq) / determinant
            c = (suu * svq - suv * suq) / determinant
            missed = max(sqq - sq * sq / count - b * suq - c * svq, 0.0) / (count - 3.0)
            rough_m[v, u] = depth * depth * np.sqrt(missed)
            # What noise alone would give, on average; at least nothing is left of b and c.
            per_depth2 = noise_m / (depth * depth)
            noise_b = per_depth2 * per_depth2 * svv / determinant
            noise_c = per_depth2 * per_depth2 * suu / determinant
            slope2 = b * b + c * c
            left = max(slope2 - noise_b - noise_c, 0.0) / slope2 if slope2 > 0.0 else 0.0
            shrink = np.sqrt(left)
            b, c = b * shrink, c * shrink
            here_x, here_y = (u - cx) / fx, (v - cy) / fy
            n_x, n_y, inverse = b * fx, c * fy, 1.0 / depth
            n_z = inverse - n_x * here_x - n_y * here_y
            ray2 = here_x * here_x + here_y * here_y + 1.0
            cosine2 = inverse * inverse / ((n_x * n_x + n_y * n_y + n_z * n_z) * ray2)
            tangent[v, u] = np.sqrt(max(1.0 / cosine2 - 1.0, 0.0))
            spread_m[v, u] = depth * depth * np.sqrt((b * b + c * c) / 12.0)
