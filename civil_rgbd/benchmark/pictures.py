"""Pictures of predictions as data URIs: image, truth, prediction, and AbsRel as in Figure 6."""

from __future__ import annotations

import base64
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from civil_rgbd.format.images import encode_image

_DEPTHS: Final = cv2.COLORMAP_VIRIDIS
_ERRORS: Final = cv2.COLORMAP_JET  # dark blue is low, red is high: the paper's Figure 6
_RED: Final = 223  # of that map: beyond it grows dark again
_EMPTY: Final = 40  # grey of pixels without truth
_WIDTH_PX: Final = 384


def photo_uri(rgb: NDArray[np.uint8]) -> str:
    """Return an image (H, W, 3)."""
    return _uri(_sized(rgb, cv2.INTER_AREA))


def depth_uri(depth_m: NDArray[np.float32], near_far_m: tuple[float, float]) -> str:
    """Return depth in colours, near light, by its logarithm; where there is none, dark grey.

    Args:
        depth_m: (H, W) float32 metres; 0 or NaN is none.
        near_far_m: depths of the lightest and the darkest colour.
    """
    near_m, far_m = near_far_m
    there = np.isfinite(depth_m) & (depth_m > 0)
    share = np.log(far_m / np.where(there, depth_m, far_m)) / np.log(far_m / near_m)
    return _uri(_coloured(share, there, _DEPTHS))


def error_uri(prediction_m: NDArray[np.float32], truth_m: NDArray[np.float32]) -> str:
    """Return AbsRel of each measured pixel: dark blue is 0, red is 100 % and more.

    Args:
        prediction_m: (H, W) float32 metres.
        truth_m: (H, W) float32 metres, 0 = nothing measured.
    """
    there = truth_m > 0
    error = np.abs(prediction_m - truth_m) / np.where(there, truth_m, 1)
    return _uri(_coloured(np.nan_to_num(error, nan=1.0, posinf=1.0), there, _ERRORS))


def error_scale_uri() -> str:
    """Return the scale of errors, from 0 at the left to 100 % at the right."""
    ramp = np.linspace(0, 1, 256, dtype=np.float64)[np.newaxis]
    return _uri(_coloured(ramp, np.ones_like(ramp, dtype=bool), _ERRORS, grow=False))


def _coloured(
    share: NDArray[np.floating], there: NDArray[np.bool_], colours: int, *, grow: bool = True
) -> NDArray[np.uint8]:
    """Colour shares of 0 to 1; a lone pixel covers its empty neighbours, or nobody would see it."""
    top = _RED if colours == _ERRORS else 255
    levels = np.clip(top * share, 0, top).astype(np.uint8)
    if grow:
        known = cv2.boxFilter(there.astype(np.float32), -1, (3, 3), normalize=False)
        lone = np.where(there, levels, 0).astype(np.float32)
        total = cv2.boxFilter(lone, -1, (3, 3), normalize=False)
        # The mean of its neighbours: the largest would paint sparse truth redder than its metric.
        spread = total / np.maximum(known, 1)
        levels = np.where(there, levels, spread).astype(np.uint8)
        there = known > 0
    rgb = cv2.applyColorMap(levels, colours)[..., ::-1]
    painted = np.where(there[..., np.newaxis], rgb, np.uint8(_EMPTY)).astype(np.uint8)
    return _sized(painted, cv2.INTER_NEAREST) if grow else painted


def _sized(rgb: NDArray[np.uint8], way: int) -> NDArray[np.uint8]:
    height, width = rgb.shape[:2]
    if width <= _WIDTH_PX:
        return np.ascontiguousarray(rgb)
    size = (_WIDTH_PX, max(1, round(height * _WIDTH_PX / width)))
    return np.asarray(cv2.resize(rgb, size, interpolation=way), dtype=np.uint8)


def _uri(rgb: NDArray[np.uint8]) -> str:
    png = encode_image(np.ascontiguousarray(rgb), codec="png")
    return f"data:image/png;base64,{base64.b64encode(png).decode('ascii')}"
