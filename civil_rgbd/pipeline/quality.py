"""How good each depth is: expected error, returns behind it, their age; and why pixels are empty.

A LiDAR's range errs by a constant, and by more where the beam slants, for its footprint then spans
many ranges. Of n returns in one pixel the nearest wins: on a facing surface that is the one whose
noise brings it nearest, so that depth is too small on average; on a slanting one the pixel's own
spread of depth decides, and the noise hardly matters. With surface depth and noise both normal, of
deviations s and e, the winner's noise has mean -c_n e^2 / r and variance e^2 - (1 - v_n) e^4 / r^2,
where r^2 = e^2 + s^2, and c_n and v_n are mean and variance of the largest of n normal numbers.
Neighbours miss their plane by v_n r^2 as well: what they show corrects what a recipe states of e.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.constants import NO_DEPTH_M
from civil_rgbd.domain.frame import EMPTY
from civil_rgbd.domain.recipe import DepthStage, QualityStage
from civil_rgbd.geometry.camera import PinholeCamera
from civil_rgbd.pipeline.slopes import STEEPEST, Slopes, slopes_of
from civil_rgbd.pipeline.winners import NO_WINNER, Winners, returns_within

_SAME_SURFACE_SIGMAS: Final = 6.0  # all of many returns from one surface lie so near the nearest
_PLANE, _NO_PLANE, _LEAVES = 2.0, 3.0, 5.5
"""Times the noise by which neighbours miss the plane: up to the first they show how large it really
is, from the second on they do not, from the third on it is leaves and no plane at all."""
_LEAF_TURNS: Final = 0.4  # leaves slant more than the plane through them, by so much of its tangent
_LEAF_TANGENT: Final = 1.0  # and by this even where that plane faces the beam
_DOUBT: Final = 0.6  # of what neighbours show, as a share of the doubt about what a recipe states
_MOST_OVER: Final = 4.0  # times the stated variance that neighbours can make of it
_TINY2: Final = 1e-12  # no variance is less, so that none is 0
_MOST_RETURNS: Final = 2048  # half floats count no further without gaps

# n, and mean and variance of the largest of n standard normal numbers, by numerical integration.
_LARGEST_OF: Final = np.array(
    [
        (1, 0.0, 1.0),
        (2, 0.56419, 0.68169),
        (3, 0.84628, 0.55947),
        (4, 1.02938, 0.49172),
        (5, 1.16296, 0.44753),
        (6, 1.26721, 0.41593),
        (8, 1.42360, 0.37290),
        (10, 1.53875, 0.34434),
        (15, 1.73591, 0.30104),
        (20, 1.86748, 0.27570),
        (30, 2.04276, 0.24584),
        (50, 2.24907, 0.21571),
        (100, 2.50759, 0.18440),
        (200, 2.74604, 0.16072),
        (500, 3.03670, 0.13720),
        (1000, 3.24144, 0.12346),
        (2000, 3.43534, 0.11218),
    ]
)


@dataclass(frozen=True, slots=True, eq=False)
class ExpectedError:
    """What is to be expected of depth - truth, where there is depth; elsewhere 0.

    Attributes:
        sigma_m: (H, W) float64, standard deviation.
        bias_m: (H, W) float64, mean: not above 0.
    """

    sigma_m: NDArray[np.float64]
    bias_m: NDArray[np.float64]


def quality_planes(
    depth_m: NDArray[np.float32],
    winners: Winners,
    *,
    ages_s: NDArray[np.float64],
    before_m: NDArray[np.float32],
    exists: NDArray[np.bool_],
    camera: PinholeCamera,
    depth: DepthStage,
    stage: QualityStage,
) -> Mapping[str, NDArray[np.float16]]:
    """Return the planes that a recipe asks for.

    Args:
        depth_m: (H, W) float32, metres, as it is stored.
        winners: of the window that was rendered.
        ages_s: (P,) float64, of each of the window's points: positive = older than the image.
        before_m: (H, W) float32, the depth before anything was removed for being hidden.
        exists: (H, W) bool, pixels that the raw image has.
        camera: the pinhole.
        depth: how depth is rounded.
        stage: which planes, and how the sensor errs.

    Returns:
        (H, W) float16 each, by name, in the order of their names.
    """
    measured = depth_m != NO_DEPTH_M
    made: dict[str, NDArray[np.floating | np.integer]] = {}
    if {"sigma_m", "bias_m"} & set(stage.planes):
        error = expected_error(depth_m, winners, camera=camera, depth=depth, stage=stage)
        made |= {"sigma_m": error.sigma_m, "bias_m": error.bias_m}
    made["returns"] = np.minimum(winners.returns, _MOST_RETURNS)
    won = np.where(winners.point == NO_WINNER, 0, winners.point)
    made["age_s"] = np.where(measured, ages_s[won] if len(ages_s) else 0.0, 0.0)
    made["empty"] = _why_empty(measured, before_m != NO_DEPTH_M, exists, winners)
    # Adding 0 turns -0.0 into 0.0: equal planes have equal bytes.
    return MappingProxyType(
        {name: (made[name] + 0.0).astype(np.float16) for name in sorted(stage.planes)}
    )


def expected_error(
    depth_m: NDArray[np.float32],
    winners: Winners,
    *,
    camera: PinholeCamera,
    depth: DepthStage,
    stage: QualityStage,
) -> ExpectedError:
    """Return mean and standard deviation of depth - truth, for (H, W) pixels with depth."""
    of, means, variances = _LARGEST_OF.T
    narrowed = np.interp(winners.returns, of, variances)
    slopes = slopes_of(depth_m, camera, narrowed=narrowed, stage=stage)
    one2 = _one_return2(depth_m, slopes, camera=camera, depth=depth, stage=stage)
    both2 = one2 + slopes.spread_m**2 + np.maximum(slopes.rough_m**2 - one2, 0.0)
    count = returns_within(winners, _SAME_SURFACE_SIGMAS * np.sqrt(both2))
    mean, variance = np.interp(count, of, means), np.interp(count, of, variances)
    with np.errstate(divide="ignore", invalid="ignore"):  # 0 / 0 where there is no depth
        bias_m = -mean * one2 / np.sqrt(both2)
        left2 = one2 - (1 - variance) * one2 * one2 / both2
    measured = depth_m != NO_DEPTH_M
    return ExpectedError(
        np.where(measured, np.sqrt(left2), 0.0),
        np.where(measured, bias_m, 0.0),
    )


def _one_return2(
    depth_m: NDArray[np.float32],
    slopes: Slopes,
    *,
    camera: PinholeCamera,
    depth: DepthStage,
    stage: QualityStage,
) -> NDArray[np.float64]:
    """Variance of the depth of one return that falls into a pixel."""
    x = (np.arange(camera.width_px) - camera.cx_px) / camera.fx_px
    y = (np.arange(camera.height_px) - camera.cy_px) / camera.fy_px
    ray2 = 1.0 + x[np.newaxis, :] ** 2 + y[:, np.newaxis] ** 2  # (range / depth)^2
    least2 = stage.range_noise_m**2 / ray2 + stage.pose_noise_m**2 + depth.step_m**2 / 12

    def stated2(tangent: NDArray[np.float64]) -> NDArray[np.float64]:
        slant2 = (stage.slant_noise_rad * np.minimum(tangent, STEEPEST)) ** 2
        # The signal weakens with the square of the range, and with the cosine of the angle.
        weak2 = stage.weak_noise_share**2 * np.sqrt(1.0 + tangent**2)
        return np.asarray(least2 + (weak2 + slant2) * depth_m.astype(np.float64) ** 2)

    spread2 = slopes.spread_m**2
    rough = slopes.rough_m / np.sqrt(stated2(slopes.tangent) + spread2 + _TINY2)
    leaves = np.clip((rough - _PLANE) / (_LEAVES - _PLANE), 0.0, 1.0)
    turned = slopes.tangent * (1.0 + _LEAF_TURNS * leaves)
    one2 = stated2(np.sqrt(turned**2 + (_LEAF_TANGENT * leaves) ** 2))
    # What neighbours show is of use where they lie in a plane, whose own spread does not hide it.
    both2 = one2 + spread2 + _TINY2
    known = slopes.rough_m > 0
    narrowed = np.where(known, slopes.narrowed, 1.0)
    shown2 = np.minimum(slopes.rough_m**2 / narrowed, _MOST_OVER * both2)
    plane = np.clip((_NO_PLANE - rough / np.sqrt(narrowed)) / (_NO_PLANE - _PLANE), 0.0, 1.0)
    weight = plane * one2**2 / (one2**2 + (_DOUBT * both2) ** 2)
    corrected2 = np.clip(one2 + weight * (shown2 - both2), least2, _MOST_OVER * one2)
    return np.where(known, corrected2, one2)


def _why_empty(
    measured: NDArray[np.bool_],
    before: NDArray[np.bool_],
    exists: NDArray[np.bool_],
    winners: Winners,
) -> NDArray[np.integer]:
    return np.select(
        [measured, ~exists, before, winners.out_of_range],
        [EMPTY["depth"], EMPTY["no-source"], EMPTY["hidden"], EMPTY["out-of-range"]],
        EMPTY["no-return"],
    )
