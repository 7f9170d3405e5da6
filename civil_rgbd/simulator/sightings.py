"""Which image sees each spall best: whole, unhidden, and large."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.constants import NS_PER_S
from civil_rgbd.domain.defect import DefectMeasure, DefectRecord
from civil_rgbd.domain.frame import frame_id_from
from civil_rgbd.geometry.camera import PinholeCamera
from civil_rgbd.simulator.catalogue import caster_for
from civil_rgbd.simulator.scene import dots
from civil_rgbd.simulator.spall import Spall
from civil_rgbd.simulator.spec import ScanSpec
from civil_rgbd.simulator.walk import START_NS, camera_poses, image_instants_ns

_OFF_FACE_M = 0.01  # looked for so far off the face, where only something else can be in the way
_TRIES = 20
_LEAST_FACING = 0.15  # cosine: more slanting views measure nothing


def seen_spalls(spec: ScanSpec, camera: PinholeCamera) -> tuple[DefectRecord, ...]:
    """Return every spall that an image sees whole, in the image that sees it largest.

    Args:
        spec: the scan.
        camera: the pinhole whose pixels outlines are given in.

    Returns:
        at most one record a spall, with its true size in mm and mm2; outlines are polygons.
    """
    instants = image_instants_ns(spec)
    poses = camera_poses(spec, instants)
    poses[:, :3, 3] -= np.asarray(spec.map_offset_m)
    times_s = (instants - START_NS) / NS_PER_S
    found = []
    for spall in caster_for(spec).site.spalls:
        sizes = np.array([_size_px2(spall, camera, pose) for pose in poses])
        for index in np.argsort(-sizes, kind="stable")[:_TRIES].tolist():
            if sizes[index] > 0 and _unhidden(spec, spall, poses[index], float(times_s[index])):
                found.append(_record(spall, index, _pixels(spall, camera, poses[index])[0]))
                break
    return tuple(found)


def _pixels(
    spall: Spall, camera: PinholeCamera, T_scene_camera: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the outline's pixels (K, 2) and depths (K,)."""
    away = spall.outline_m - T_scene_camera[:3, 3]
    x, y, z = (dots(away, T_scene_camera[np.newaxis, :3, i]) for i in range(3))
    safe = np.where(z > 0, z, 1.0)
    u = camera.fx_px * x / safe + camera.cx_px
    v = camera.fy_px * y / safe + camera.cy_px
    return np.stack([u, v], axis=1), z


def _size_px2(spall: Spall, camera: PinholeCamera, T_scene_camera: NDArray[np.float64]) -> float:
    """Return the area of the outline in the image; 0 where it is not seen whole, or askew."""
    pixels, z = _pixels(spall, camera, T_scene_camera)
    u, v = pixels.T
    towards = T_scene_camera[:3, 3] - spall.centre_m
    length = float(np.sqrt((towards * towards).sum()))
    facing = float((towards * spall.normal).sum()) / length
    inside = (u >= 0) & (u <= camera.width_px - 1) & (v >= 0) & (v <= camera.height_px - 1)
    if facing < _LEAST_FACING or not (inside & (z > 0)).all():
        return 0.0
    return abs(float((u * np.roll(v, -1) - np.roll(u, -1) * v).sum())) / 2


def _unhidden(
    spec: ScanSpec, spall: Spall, T_scene_camera: NDArray[np.float64], t_s: float
) -> bool:
    spots = np.concatenate([spall.outline_m, spall.centre_m[np.newaxis]])
    spots = spots + _OFF_FACE_M * spall.normal
    here = T_scene_camera[np.newaxis, :3, 3]
    distances, _ = caster_for(spec).at(t_s).distances(here, spots - here)
    return bool(((distances == 0) | (distances >= 1)).all())


def _record(spall: Spall, index: int, pixels: NDArray[np.float64]) -> DefectRecord:
    return DefectRecord(
        defect_id=spall.name,
        frame_id=frame_id_from(index),
        type="spalling",
        outline="polygon",
        uv_px=tuple((round(u, 3), round(v, 3)) for u, v in pixels.tolist()),
        measures=(
            DefectMeasure("length", round(spall.length_m * 1e3, 6), "mm"),
            DefectMeasure("width", round(spall.width_m * 1e3, 6), "mm"),
            DefectMeasure("area", round(spall.area_m2 * 1e6, 3), "mm2"),
            DefectMeasure("depth", round(spall.depth_m * 1e3, 6), "mm"),
        ),
        severity=spall.severity,
    )
