"""Pictures of a bridge as data URIs: frames with their depth laid over, and where depth lies."""

from __future__ import annotations

import base64
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from civil_rgbd.format.images import encode_image

WIDTH_PX: Final = 560
_COLOURS: Final = cv2.COLORMAP_VIRIDIS  # its lightness ascends: it survives grey print and eyes
_JPEG_QUALITY: Final = 80


def frame_uri(rgb: NDArray[np.uint8]) -> str:
    """Return an image (H, W, 3) as a JPEG of the report's size."""
    return _jpeg_uri(_sized(rgb))


def overlay_uri(
    rgb: NDArray[np.uint8], depth_m: NDArray[np.float32], near_far_m: tuple[float, float]
) -> str:
    """Return depth in colours over the darkened image, as a JPEG of the report's size.

    Args:
        rgb: (H, W, 3) uint8.
        depth_m: (H, W) float32, metres, 0 = nothing measured.
        near_far_m: depths of the lightest and the darkest colour.
    """
    levels = _levels(depth_m, near_far_m)
    # A single point vanishes when the picture shrinks: each covers its neighbours, the near wins.
    size = max(1, round(2 * depth_m.shape[1] / WIDTH_PX)) + 1
    grown = cv2.dilate(levels, np.ones((size, size), np.uint8))
    colours = _coloured(grown)
    grey = (cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY) * np.float32(0.45)).astype(np.uint8)
    laid = np.where((grown > 0)[..., np.newaxis], colours, grey[..., np.newaxis])
    return _jpeg_uri(_sized(laid.astype(np.uint8)))


def _levels(depth_m: NDArray[np.float32], near_far_m: tuple[float, float]) -> NDArray[np.uint8]:
    """Near is 255, far is 1, nothing measured is 0; by the logarithm of depth."""
    near_m, far_m = near_far_m
    valid = depth_m > 0
    share = np.log(far_m / np.where(valid, depth_m, far_m)) / np.log(far_m / near_m)
    return np.where(valid, 1 + 254 * np.clip(share, 0, 1), 0).astype(np.uint8)


def _coloured(levels: NDArray[np.uint8]) -> NDArray[np.uint8]:
    bgr = cv2.applyColorMap(np.ascontiguousarray(levels), _COLOURS)
    return np.ascontiguousarray(bgr[..., ::-1]).astype(np.uint8)


def _sized(rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
    height_px, width_px = rgb.shape[:2]
    if width_px <= WIDTH_PX:
        return np.ascontiguousarray(rgb)
    size = (WIDTH_PX, max(1, round(height_px * WIDTH_PX / width_px)))
    return np.asarray(cv2.resize(rgb, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def share_map_uri(shares: NDArray[np.float64], highest: float) -> str:
    """Return a map of shares (rows, columns) as a PNG of one pixel a cell: light is much.

    Args:
        shares: 0 to ``highest``.
        highest: what the lightest colour stands for.
    """
    levels = np.clip(255 * shares / max(highest, 1e-9), 0, 255).astype(np.uint8)
    return _uri("png", encode_image(_coloured(levels), codec="png"))


def scale_uri() -> str:
    """Return the scale of colours, from dark to light, as a PNG to be stretched."""
    ramp = np.arange(256, dtype=np.uint8)[np.newaxis]
    return _uri("png", encode_image(_coloured(ramp), codec="png"))


def scale_colours(count: int) -> list[str]:
    """Return colours from dark to a light that still shows on white, as ``#rrggbb``."""
    levels = np.linspace(0, 215, count).astype(np.uint8)[np.newaxis]
    return ["#{:02x}{:02x}{:02x}".format(*rgb) for rgb in _coloured(levels)[0].tolist()]


def _jpeg_uri(rgb: NDArray[np.uint8]) -> str:
    data = encode_image(rgb, codec="jpeg", quality=_JPEG_QUALITY, subsampling="4:2:0")
    return _uri("jpeg", data)


def _uri(kind: str, data: bytes) -> str:
    return f"data:image/{kind};base64,{base64.b64encode(data).decode('ascii')}"
