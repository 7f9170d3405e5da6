"""What the shutter does to a picture: too much light after the start, and motion blur."""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from civil_rgbd.constants import NS_PER_S
from civil_rgbd.geometry.camera import PinholeCamera
from civil_rgbd.geometry.transforms import compose, inverse
from civil_rgbd.simulator.spec import ScanSpec
from civil_rgbd.simulator.walk import START_NS, camera_poses

Picture = NDArray[np.uint8]

_BRIGHTEST: Final = 2.2  # times the grey values at the start; light goes with their square
_BLUR_DISTANCE_M: Final = 6.0  # whatever is seen blurs as if it were so far away
_LEAST_BLUR_PX: Final = 0.3
_STEP_PX: Final = 1.5
_MOST_STEPS: Final = 15


def exposed(rgb: Picture, spec: ScanSpec, instant_ns: int, camera: PinholeCamera) -> Picture:
    """Return the picture as the camera's shutter and its exposure control leave it.

    Args:
        rgb: (H, W, 3) uint8, perfectly exposed in an instant.
        spec: the scan.
        instant_ns: middle of the exposure, LiDAR clock.
        camera: the pinhole behind the lens, whose distortion blurs do not notice.
    """
    if spec.exposure_s:
        rgb = _blurred(rgb, _views(spec, instant_ns, camera))
    if spec.exposure_settles_s:
        rgb = _brightened(rgb, (instant_ns - START_NS) / NS_PER_S / spec.exposure_settles_s)
    return rgb


def _brightened(rgb: Picture, settled: float) -> Picture:
    """Brighten: ``settled`` is 0 at the start, 1 when the exposure control has found its way."""
    missing = max(1 - settled, 0.0)
    table = np.arange(256) * (1 + (_BRIGHTEST - 1) * missing * missing)
    bright: Picture = cv2.LUT(rgb, np.minimum(table + 0.5, 255).astype(np.uint8))
    return bright


def _views(spec: ScanSpec, instant_ns: int, camera: PinholeCamera) -> NDArray[np.float64]:
    """Return homographies (V, 3, 3): the picture as seen at instants all through the exposure."""
    half_ns = round(spec.exposure_s * NS_PER_S / 2)
    ends = _homographies(spec, instant_ns, np.array([-half_ns, half_ns]), camera)
    moved = np.abs(_mapped(ends[1], camera) - _mapped(ends[0], camera)).max()
    if moved < _LEAST_BLUR_PX:
        return ends[:0]
    count = min(int(moved / _STEP_PX) + 2, _MOST_STEPS)
    within = np.rint(((np.arange(count) + 0.5) / count * 2 - 1) * half_ns).astype(np.int64)
    return _homographies(spec, instant_ns, within, camera)


def _homographies(
    spec: ScanSpec, instant_ns: int, later_ns: NDArray[np.int64], camera: PinholeCamera
) -> NDArray[np.float64]:
    poses = camera_poses(spec, np.append(instant_ns, instant_ns + later_ns))
    moved = compose(inverse(poses[1:]), poses[:1])
    turn = moved[:, :3, :3].copy()
    turn[:, :, 2] += moved[:, :3, 3] / _BLUR_DISTANCE_M  # of a plane that faces the camera
    # K turn K^-1, spelt out: no BLAS on the way to pixels.
    fx, fy, cx, cy = camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px
    left = np.stack(
        [
            fx * turn[:, 0] + cx * turn[:, 2],
            fy * turn[:, 1] + cy * turn[:, 2],
            turn[:, 2],
        ],
        axis=1,
    )
    x, y, z = left[:, :, 0] / fx, left[:, :, 1] / fy, left[:, :, 2]
    return np.stack([x, y, z - cx * x - cy * y], axis=2)


def _mapped(homography: NDArray[np.float64], camera: PinholeCamera) -> NDArray[np.float64]:
    """Return where the picture's corners and middle go: (2, 5)."""
    right, low = camera.width_px - 1.0, camera.height_px - 1.0
    u = np.array([0.0, right, 0.0, right, right / 2])
    v = np.array([0.0, 0.0, low, low, low / 2])
    x, y, z = (row[0] * u + row[1] * v + row[2] for row in homography)
    return np.stack([x / z, y / z])


def _blurred(rgb: Picture, views: NDArray[np.float64]) -> Picture:
    if not len(views):
        return rgb
    total = np.zeros(rgb.shape, dtype=np.uint16)
    size = rgb.shape[1], rgb.shape[0]
    for view in views:
        total += cv2.warpPerspective(rgb, view, size, borderMode=cv2.BORDER_REPLICATE)
    blurred: Picture = ((total + len(views) // 2) // len(views)).astype(np.uint8)
    return blurred
