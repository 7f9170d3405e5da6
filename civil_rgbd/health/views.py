"""The images of a recording, looked at small, grey and undistorted."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from civil_rgbd.domain.recording import Recording, SmallGreys
from civil_rgbd.errors import CivilRgbdError
from civil_rgbd.geometry.camera import LensCamera, PinholeCamera, source_pixels

WIDTH_PX: Final = 640
"""Images are looked at in this width: an edge is then some two pixels wide."""


@dataclass(frozen=True, slots=True, eq=False)
class Viewer:
    """Undistorts small grey images, all into one pinhole.

    Attributes:
        camera: that pinhole, at most :data:`WIDTH_PX` wide.
        reduction: 1, 2, 4 or 8: what images are shrunk by while they are decoded.
        columns: (H, W) float32, where each pixel lies in the small raw image.
        rows: likewise.
        exists: (H, W) bool, whether it has a source.
    """

    camera: PinholeCamera
    reduction: int
    columns: NDArray[np.float32]
    rows: NDArray[np.float32]
    exists: NDArray[np.bool_]

    def look(self, small: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Undistort one small grey image."""
        blurred = small
        if small.shape[1] > 1.5 * self.camera.width_px:
            blurred = cv2.GaussianBlur(small, (0, 0), 0.4 * small.shape[1] / self.camera.width_px)
        seen: NDArray[np.uint8] = cv2.remap(blurred, self.columns, self.rows, cv2.INTER_LINEAR)
        return seen


def viewer_of(camera: LensCamera) -> Viewer:
    """Prepare to look at the images of a camera."""
    pinhole = camera.pinhole
    stored = pinhole.scaled(min(1.0, WIDTH_PX / pinhole.width_px))
    source = source_pixels(camera, stored)
    shrink = pinhole.width_px / stored.width_px
    reduction = max(r for r in (1, 2, 4, 8) if r <= shrink + 1e-9)
    columns = ((source.columns + 0.5) / reduction - 0.5).astype(np.float32)
    rows = ((source.rows + 0.5) / reduction - 0.5).astype(np.float32)
    return Viewer(stored, reduction, columns, rows, source.exists)


def small_grey(recording: Recording, index: int, reduction: int) -> NDArray[np.uint8] | None:
    """Decode one image small and grey; None where it cannot be decoded.

    Args:
        recording: decodes small at once where it is able to, else whole.
        index: of the image.
        reduction: 1, 2, 4 or 8.
    """
    try:
        if isinstance(recording, SmallGreys):
            return recording.read_small_grey(index, reduction)
        grey = cv2.cvtColor(recording.read_image(index).rgb, cv2.COLOR_RGB2GRAY)
    except CivilRgbdError:
        return None
    size = (-(-grey.shape[1] // reduction), -(-grey.shape[0] // reduction))
    small: NDArray[np.uint8] = cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
    return small


class Views:
    """The images of a recording as one pinhole sees them; each is decoded once.

    Attributes:
        viewer: that undistorts them.
        camera: its pinhole.
    """

    def __init__(self, recording: Recording) -> None:
        self.viewer = viewer_of(recording.rig.camera)
        self.camera = self.viewer.camera
        self._recording = recording
        self._seen: dict[int, NDArray[np.uint8] | None] = {}

    def through(self, recording: Recording) -> Views:
        """Return views of a copy of the recording, read beside it; what is seen is shared."""
        other = Views(recording)
        other._seen = self._seen
        return other

    def at(self, index: int) -> NDArray[np.uint8] | None:
        """Return one image, (H, W) uint8, grey; None where it cannot be decoded."""
        if index not in self._seen:
            small = small_grey(self._recording, index, self.viewer.reduction)
            self._seen[index] = None if small is None else self.viewer.look(small)
        return self._seen[index]
