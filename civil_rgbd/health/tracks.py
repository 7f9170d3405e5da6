"""Features followed from image to image, with the depths that the LiDAR gives them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from civil_rgbd.geometry.camera import PinholeCamera
from civil_rgbd.geometry.transforms import inverse
from civil_rgbd.health.nearest import nearest_a_cell
from civil_rgbd.health.sampling import Posed, Stretch, camera_poses, image_stamps
from civil_rgbd.health.views import Views

Floats = NDArray[np.float64]

FEWEST_FEATURES: Final = 25
"""With fewer, two images say nothing."""

_FEATURES: Final = 250
_LONGEST_NS: Final = 350_000_000
_EVERY: Final = 8  # points that give coarse depths
_CELL_PX: Final = 8
_USUAL_DEPTH_M: Final = 12.0


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """Features followed from one image to the next.

    Attributes:
        from_ns: stamp of the earlier image, LiDAR clock as far as it is known.
        to_ns: of the later one.
        rays: (F, 3) directions in the earlier camera, z = 1.
        seen: (F, 3) in the later one.
        depths_m: (F,) along z, by the LiDAR.
    """

    from_ns: int
    to_ns: int
    rays: Floats
    seen: Floats
    depths_m: Floats


@dataclass(frozen=True, slots=True, eq=False)
class Pair:
    """Features followed from one image to the next, as pixels.

    Attributes:
        stretch: that they belong to.
        images: indices of both.
        pixels: (2, F, 2) column and row, in the earlier image and in the later one.
        camera: whose pixels they are.
    """

    stretch: Stretch
    images: tuple[int, int]
    pixels: Floats
    camera: PinholeCamera


def pairs_of(recording: Posed, stretches: Sequence[Stretch], views: Views) -> tuple[Pair, ...]:
    """Follow features through the images of each stretch."""
    stamps_ns = image_stamps(recording)
    found: list[Pair] = []
    for stretch in stretches:
        before: int | None = None
        for index in stretch.images:
            grey = views.at(index)
            if grey is None:
                continue
            earlier = None if before is None else views.at(before)
            if before is not None and earlier is not None:
                near = 0 < stamps_ns[index] - stamps_ns[before] < _LONGEST_NS
                pixels = _followed(earlier, grey, views) if near else None
                if pixels is not None:
                    found.append(Pair(stretch, (before, index), pixels, views.camera))
            before = index
    return tuple(found)


def tracks_of(recording: Posed, pairs: Sequence[Pair]) -> tuple[Track, ...]:
    """Give the features depths, from where the rig says that the camera was.

    Args:
        recording: with poses.
        pairs: from :func:`pairs_of`.
    """
    stamps_ns, tracks = image_stamps(recording), []
    for pair in pairs:
        from_ns, to_ns = (int(stamps_ns[index]) for index in pair.images)
        T_map_camera = camera_poses(recording, np.array([from_ns]))[0]
        points_map = pair.stretch.points_map[::_EVERY]
        depths = _depths(points_map, inverse(T_map_camera), pair.camera, pair.pixels[0])
        rays, seen = (_rays(pixels, pair.camera) for pixels in pair.pixels)
        tracks.append(Track(from_ns, to_ns, rays, seen, depths))
    return tuple(tracks)


def _followed(first: NDArray[np.uint8], second: NDArray[np.uint8], views: Views) -> Floats | None:
    mask = views.viewer.exists.astype(np.uint8)
    corners = cv2.goodFeaturesToTrack(first, _FEATURES, 0.01, 10, mask=mask)
    if corners is None or len(corners) < FEWEST_FEATURES:
        return None
    found, status, _ = cv2.calcOpticalFlowPyrLK(
        first, second, corners, None, winSize=(15, 15), maxLevel=4
    )
    last = views.camera.width_px - 1, views.camera.height_px - 1
    inside = ((found[:, 0] >= 0) & (found[:, 0] < last)).all(axis=1)
    good = (status[:, 0] == 1) & inside
    if good.sum() < FEWEST_FEATURES:
        return None
    return np.stack([corners[good, 0], found[good, 0]]).astype(np.float64)


def _depths(
    points_map: Floats, T_camera_map: Floats, camera: PinholeCamera, pixels: Floats
) -> Floats:
    """Return a coarse depth for each of (F, 2) pixels: the nearest point's about it."""
    depth_m = nearest_a_cell(points_map, T_camera_map, camera, _CELL_PX)[2]
    near = np.divide(1, depth_m, out=np.zeros_like(depth_m), where=depth_m > 0)
    usual = float(np.median(near[near > 0])) if (near > 0).any() else 1 / _USUAL_DEPTH_M
    spread = cv2.dilate(near, np.ones((3, 3)))
    filled: Floats = 1 / np.where(near > 0, near, np.where(spread > 0, spread, usual))
    columns, rows = (pixels / _CELL_PX).astype(int).T
    chosen: Floats = filled[rows, columns]
    return chosen


def _rays(pixels: Floats, camera: PinholeCamera) -> Floats:
    return np.column_stack([
        (pixels[:, 0] - camera.cx_px) / camera.fx_px,
        (pixels[:, 1] - camera.cy_px) / camera.fy_px,
        np.ones(len(pixels)),
    ])  # fmt: skip
