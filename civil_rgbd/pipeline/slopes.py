"""How surfaces slant, from their sparse depth alone.

The inverse depth of a plane is linear in the pixel: 1 / Z = A x + B y + C, where x and y are
normalised coordinates and (A, B, C) is along its normal. So planes are fitted to inverse depths.
Neighbours of about the same depth may still be of another surface, a bush before a wall: where they
miss their plane by more than noise explains, those of nearer depths are tried.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numba
import numpy as np
from numpy.typing import NDArray

from civil_rgbd.domain.recipe import QualityStage
from civil_rgbd.geometry.camera import PinholeCamera

STEEPEST: Final = 10.0
"""Tangent: 84 degrees; beams that slant more hardly ever return."""
_REACH_PX: Final = 5  # neighbours that speak for a pixel's surface
_SAME_SURFACE: Final = (0.15, 0.04, 0.015)
"""Of the depth, widest first: a surface seen at 5 degrees changes by 0.15 over 5 px."""
_SMOOTH: Final = 2.5  # times the noise by which neighbours may miss a plane that is one
_FEWEST: Final = 6  # neighbours; fewer say nothing
_UNKNOWN: Final = 8.0  # tangent where nobody can tell: edges, twigs and grazing ground far away


@dataclass(frozen=True, slots=True, eq=False)
class Slopes:
    """How the surface behind each pixel slants; that of a slanting surface where nobody can tell.

    Attributes:
        tangent: (H, W) float64, of the angle between ray and normal: 0 = head on.
        spread_m: (H, W) float64, standard deviation of the surface's depth over the pixel.
        rough_m: (H, W) float64, root of the mean square by which neighbours miss the plane; 0
            where nobody can tell.
        narrowed: (H, W) float64, mean over the neighbours of what :func:`slopes_of` was told.
    """

    tangent: NDArray[np.float64]
    spread_m: NDArray[np.float64]
    rough_m: NDArray[np.float64]
    narrowed: NDArray[np.float64]


def slopes_of(
    depth_m: NDArray[np.float32],
    camera: PinholeCamera,
    *,
    narrowed: NDArray[np.float64],
    stage: QualityStage,
) -> Slopes:
    """Fit a plane to each pixel with depth and its neighbours of about the same depth.

    Noise looks like slant: what the neighbours' own deviations from the plane would give on average
    is taken off.

    Args:
        depth_m: (H, W) float32, metres, 0 = nothing measured.
        camera: the pinhole.
        narrowed: (H, W) float64, variance of each depth over that of one return: it is that of the
            nearest of several.
        stage: how the sensor errs, to tell planes from what only looks like one.
    """
    planes = np.zeros((4, *depth_m.shape))
    with np.errstate(divide="ignore"):
        inverses = np.where(depth_m > 0, 1.0 / depth_m.astype(np.float64), 0.0)
    pinhole = (camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px)
    errs2 = tuple(
        np.float64(value) ** 2
        for value in (
            stage.range_noise_m,
            stage.weak_noise_share,
            stage.slant_noise_rad,
            stage.pose_noise_m,
        )
    )
    _fit(inverses, narrowed, pinhole, errs2, planes)
    return Slopes(*planes)


@numba.njit(cache=True, nogil=True)
def _fit(inverses, narrowed, pinhole, errs2, out):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202  # a kernel: numba infers
    tangent, spread_m, rough_m, mean_narrowed = out
    height, width = inverses.shape
    fx, fy, cx, cy = pinhole
    constant2, weak2, slant2, pose2 = errs2
    for v in range(height):
        for u in range(width):
            inverse = inverses[v, u]
            if inverse <= 0.0:
                continue
            tangent[v, u] = _UNKNOWN
            here_x, here_y = (u - cx) / fx, (v - cy) / fy
            ray2 = here_x * here_x + here_y * here_y + 1.0
            depth2 = 1.0 / (inverse * inverse)
            for i in range(len(_SAME_SURFACE)):
                found, b, c, missed, share = _plane(inverses, narrowed, v, u, _SAME_SURFACE[i])
                if not found:
                    break
                n_x, n_y = b * fx, c * fy
                n_z = inverse - n_x * here_x - n_y * here_y
                normal2 = n_x * n_x + n_y * n_y + n_z * n_z
                tangent2 = max(normal2 * ray2 * depth2 - 1.0, 0.0)
                spread2 = depth2 * depth2 * (b * b + c * c) / 12.0
                rough2 = depth2 * depth2 * missed
                slanting2 = slant2 * min(tangent2, STEEPEST * STEEPEST)
                far2 = depth2 * (weak2 * np.sqrt(1.0 + tangent2) + slanting2)
                noise2 = constant2 / ray2 + far2 + pose2
                smooth = rough2 <= _SMOOTH * _SMOOTH * (noise2 + spread2)
                if i == 0 or smooth:
                    tangent[v, u] = np.sqrt(tangent2)
                    spread_m[v, u], rough_m[v, u] = np.sqrt(spread2), np.sqrt(rough2)
                    mean_narrowed[v, u] = share
                if smooth:
                    break


@numba.njit(cache=True, nogil=True)
def _plane(inverses, narrowed, v, u, same):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202  # a kernel: numba infers
    """Tell whether there is one, its slopes, and its neighbours' variance and mean narrowing."""
    height, width = inverses.shape
    low, high = inverses[v, u] / (1.0 + same), inverses[v, u] / (1.0 - same)
    count = share = su = sv = suu = suv = svv = sq = suq = svq = sqq = 0.0
    for y in range(max(v - _REACH_PX, 0), min(v + _REACH_PX + 1, height)):
        for x in range(max(u - _REACH_PX, 0), min(u + _REACH_PX + 1, width)):
            q = inverses[y, x]
            if low <= q <= high:
                du, dv = np.float64(x - u), np.float64(y - v)
                count, share = count + 1.0, share + narrowed[y, x]
                su, sv, sq = su + du, sv + dv, sq + q
                suu, suv, svv = suu + du * du, suv + du * dv, svv + dv * dv
                suq, svq, sqq = suq + du * q, svq + dv * q, sqq + q * q
    if count < _FEWEST:
        return False, 0.0, 0.0, 0.0, 0.0
    suu, suv, svv = suu - su * su / count, suv - su * sv / count, svv - sv * sv / count
    suq, svq = suq - su * sq / count, svq - sv * sq / count
    determinant = suu * svv - suv * suv
    if determinant <= 1e-3 * suu * svv:
        return False, 0.0, 0.0, 0.0, 0.0  # neighbours in one line
    b = (svv * suq - suv * svq) / determinant
    c = (suu * svq - suv * suq) / determinant
    missed = max(sqq - sq * sq / count - b * suq - c * svq, 0.0) / (count - 3.0)
    # What noise alone would give, on average; at least nothing is left of b and c.
    slope2, noise2 = b * b + c * c, missed * (suu + svv) / determinant
    shrink = np.sqrt(max(slope2 - noise2, 0.0) / slope2) if slope2 > 0.0 else 0.0
    return True, b * shrink, c * shrink, missed, share / count
