"""A camera like the RealSense D455: pictures through its lens, and the exact depth behind them."""

from __future__ import annotations

from functools import cache, lru_cache
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from civil_rgbd.constants import NS_PER_S
from civil_rgbd.geometry.camera import LensCamera, PinholeCamera, distort
from civil_rgbd.simulator.catalogue import caster_for, painter_for
from civil_rgbd.simulator.exposure import exposed
from civil_rgbd.simulator.scene import RayCaster
from civil_rgbd.simulator.site_rays import InstantCaster
from civil_rgbd.simulator.spec import ScanSpec
from civil_rgbd.simulator.walk import START_NS, camera_poses, image_instants_ns

D455: Final = LensCamera(
    PinholeCamera(
        width_px=1280,
        height_px=720,
        fx_px=636.5245361328125,
        fy_px=634.7903442382812,
        cx_px=635.6729736328125,
        cy_px=366.147705078125,
    ),
    "plumb_bob",
    (
        -0.05449240654706955,
        0.06359218806028366,
        0.00016181448881980032,
        -0.0009868403431028128,
        -0.02028072439134121,
    ),
)
"""A real D455's colour camera, as its CameraInfo states it."""

_INVERSION_PX = 1e-8
_MOST_STEPS = 60


@cache
def raw_camera(image_scale: float) -> LensCamera:
    """Return the camera of the raw images; the lens is the same at every size."""
    return LensCamera(D455.pinhole.scaled(image_scale), D455.lens, D455.coefficients)


@lru_cache(maxsize=4)
def lens_rays(camera: LensCamera) -> NDArray[np.float64]:
    """Return where each raw pixel looks: the lens inverted to better than 1e-6 px.

    Args:
        camera: the raw camera.

    Returns:
        (2, H, W) float64: X / Z and Y / Z in the camera's optical frame. Shared: do not write.

    Raises:
        ValueError: the lens model cannot be inverted over the whole image.
    """
    pinhole = camera.pinhole
    aim_x, aim_y = pinhole_rays(pinhole)
    x, y = aim_x, aim_y
    for _ in range(_MOST_STEPS):
        seen_x, seen_y = distort(camera, x, y)
        miss_x, miss_y = aim_x - seen_x, aim_y - seen_y
        x, y = x + miss_x, y + miss_y
        worst = max(float(np.abs(miss_x).max()), float(np.abs(miss_y).max()))
        if worst * max(pinhole.fx_px, pinhole.fy_px) < _INVERSION_PX:
            rays = np.stack([x, y])
            rays.flags.writeable = False
            return rays
    raise ValueError(f"the lens model {camera.coefficients} cannot be inverted: off by {worst:.3g}")


def pinhole_rays(camera: PinholeCamera) -> NDArray[np.float64]:
    """Return where each pixel of an ideal pinhole looks: (2, H, W) float64, X / Z and Y / Z."""
    x = (np.arange(camera.width_px, dtype=np.float64) - camera.cx_px) / camera.fx_px
    y = (np.arange(camera.height_px, dtype=np.float64) - camera.cy_px) / camera.fy_px
    return np.stack(np.meshgrid(x, y))


def render_depth(
    caster: RayCaster | InstantCaster, camera: PinholeCamera, T_scene_camera: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the exact depth that an ideal pinhole sees.

    Args:
        caster: of the scene, or of a site at an instant.
        camera: the pinhole.
        T_scene_camera: (4, 4).

    Returns:
        (H, W) float64, metres along the optical axis, 0 where the sky is.
    """
    x, y = (plane.ravel() for plane in pinhole_rays(camera))
    R = T_scene_camera[:3, :3]
    # Z = 1 in the camera: the multiple of such a ray is the depth itself.
    directions = np.stack([R[i, 0] * x + R[i, 1] * y + R[i, 2] for i in range(3)], axis=1)
    depth_m, _ = caster.distances(T_scene_camera[np.newaxis, :3, 3], directions)
    return depth_m.reshape(camera.height_px, camera.width_px)


def true_camera_pose(spec: ScanSpec, image_index: int) -> NDArray[np.float64]:
    """Return the true ``T_map_camera`` (4, 4) float64 at the instant of image ``image_index``."""
    pose: NDArray[np.float64] = camera_poses(
        spec, image_instants_ns(spec)[image_index : image_index + 1]
    )[0]
    return pose


def true_depth(spec: ScanSpec, image_index: int, camera: PinholeCamera) -> NDArray[np.float64]:
    """Return the true depth of an image, for an ideal pinhole in the camera's place.

    Args:
        spec: the scan.
        image_index: of the image.
        camera: the pinhole to see it with, such as that of the stored frames.

    Returns:
        (H, W) float64, metres along the optical axis, 0 where the sky is.
    """
    caster = caster_for(spec).at(_instant_s(spec, image_index))
    return render_depth(caster, camera, _in_scene(spec, image_index))


def simulate_jpeg(spec: ScanSpec, image_index: int) -> bytes:
    """Return raw image ``image_index`` as the camera compresses it."""
    painter = painter_for(spec)
    camera = raw_camera(spec.image_scale)
    rng = np.random.default_rng([spec.seed, 2, image_index])
    rgb = painter.paint(
        lens_rays(camera),
        camera.pinhole.fx_px,
        _in_scene(spec, image_index),
        rng,
        t_s=_instant_s(spec, image_index),
    )
    instant_ns = int(image_instants_ns(spec)[image_index])
    rgb = exposed(rgb, spec, instant_ns, camera.pinhole)
    bgr = cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR)
    _, jpeg = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, spec.jpeg_quality])
    return bytes(jpeg)


def _instant_s(spec: ScanSpec, image_index: int) -> float:
    """Return when an image is taken, in seconds since the walk began."""
    return (int(image_instants_ns(spec)[image_index]) - START_NS) / NS_PER_S


def _in_scene(spec: ScanSpec, image_index: int) -> NDArray[np.float64]:
    T_scene_camera = true_camera_pose(spec, image_index)
    T_scene_camera[:3, 3] -= np.asarray(spec.map_offset_m)
    return T_scene_camera
