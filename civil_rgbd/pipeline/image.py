"""The stored image: lens distortion out and resized, in one lookup."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from civil_rgbd.domain.recipe import ImageStage
from civil_rgbd.geometry.camera import LensCamera, PinholeCamera, SourcePixels, source_pixels

_AREA_BELOW = 0.5  # bilinear lookups skip source pixels below this scale: average areas first
_PARTS_OF_A_PIXEL = 32  # cv2.remap's own, cv2.INTER_TAB_SIZE


class ImageMaker:
    """Makes stored images of one camera; the lookup is computed once.

    Attributes:
        camera: the pinhole of what it makes.
        exists: (H, W) bool; False where the raw image or its lens model has no pixel: rgb and
            depth are 0 there.
    """

    def __init__(self, raw: LensCamera, stage: ImageStage) -> None:
        self.camera: PinholeCamera = raw.pinhole.scaled(stage.scale)
        self._shrinks_first = stage.scale < _AREA_BELOW
        looked_up = replace(raw, pinhole=self.camera) if self._shrinks_first else raw
        self._moves_pixels = looked_up.distorts or looked_up.pinhole != self.camera
        source = source_pixels(looked_up, self.camera)
        self._pixels, self._weights = _whole_pixels_and_weights(source)
        self.exists = source.exists
        self._missing = ~self.exists if not self.exists.all() else None

    @property
    def missing_pixels(self) -> int:
        """Pixels of every image that have no source."""
        return 0 if self._missing is None else int(self._missing.sum())

    def make(self, raw_rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Undistort and resize.

        Args:
            raw_rgb: (H_raw, W_raw, 3) uint8.

        Returns:
            (H, W, 3) uint8.
        """
        size = (self.camera.width_px, self.camera.height_px)
        rgb = (
            cv2.resize(raw_rgb, size, interpolation=cv2.INTER_AREA)
            if self._shrinks_first
            else raw_rgb
        )
        if self._moves_pixels:
            rgb = cv2.remap(
                rgb,
                self._pixels,
                self._weights,
                interpolation=cv2.INTER_LINEAR,
                borderMode=cv2.BORDER_REPLICATE,
            )
        if self._missing is not None:
            rgb = rgb.copy() if rgb is raw_rgb else rgb
            rgb[self._missing] = 0
        made: NDArray[np.uint8] = rgb
        return made


@lru_cache(maxsize=4)
def image_maker(raw: LensCamera, stage: ImageStage) -> ImageMaker:
    """Return the maker of a camera's stored images; every chunk of a build uses the same one."""
    return ImageMaker(raw, stage)


def _whole_pixels_and_weights(
    source: SourcePixels,
) -> tuple[NDArray[np.int16], NDArray[np.uint16]]:
    """Return the places in cv2.remap's fixed-point form: (H, W, 2) pixels, (H, W) weights.

    With float32 places cv2.remap interpolates in float32, and where the processor can fuse a
    product with a sum some pixels are a grey level off. In fixed point it counts in integers.
    """
    column, row = (
        np.floor(places.astype(np.float64) * _PARTS_OF_A_PIXEL + 0.5)
        .clip(-(2**15) * _PARTS_OF_A_PIXEL, 2**15 * _PARTS_OF_A_PIXEL - 1)
        .astype(np.int32)
        for places in (source.columns, source.rows)
    )
    pixels = np.stack([column // _PARTS_OF_A_PIXEL, row // _PARTS_OF_A_PIXEL], axis=-1)
    weights = row % _PARTS_OF_A_PIXEL * _PARTS_OF_A_PIXEL + column % _PARTS_OF_A_PIXEL
    return pixels.astype(np.int16), weights.astype(np.uint16)
