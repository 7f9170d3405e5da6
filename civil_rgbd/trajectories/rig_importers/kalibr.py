"""Kalibr's ``camchain.yaml`` and ``camchain-imucam.yaml``.

Source: ethz-asl/kalibr, wiki "yaml formats": ``T_cam_imu`` takes IMU points to the camera, and
``t_imu = t_cam + timeshift_cam_imu``; wiki "supported models": radtan is OpenCV's k1 k2 p1 p2,
equidistant its fisheye. Others write ``T_imu_cam`` (OpenVINS) or ``T_cam_lidar`` there.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.domain.rig import RigFile
from civil_rgbd.errors import UsageError
from civil_rgbd.geometry.camera import LensCamera
from civil_rgbd.geometry.transforms import inverse
from civil_rgbd.geometry.words import extrinsics_in_words
from civil_rgbd.resources import nearest
from civil_rgbd.trajectories.rig_importers.documents import Document
from civil_rgbd.trajectories.rig_importers.values import (
    ImportedRig,
    Request,
    camera_from,
    number,
    numbers,
    rigid_from_rows,
    size_from,
)

_FISHEYE: Final = {"radtan": False, "none": False, "equidistant": True}
"""Distortion models that are read, and whether they are fisheyes."""


def fits(document: Document) -> bool:
    """Whether this is such a file."""
    return bool(_cameras(document))


def rig_from(documents: list[Document], request: Request) -> ImportedRig:
    """Read one camera of the chain, where it sits and how its clock is off.

    Raises:
        UsageError: which camera is not clear, its model is not read, or a value is none.
    """
    document = documents[0]
    cameras = _cameras(document)
    name = request.camera or (next(iter(cameras)) if len(cameras) == 1 else None)
    if name is None or name not in cameras:
        said = f"no camera is called {name!r}" if name else f"it has {len(cameras)} cameras"
        fix = nearest(name, cameras) if name else f"choose one: --camera {', '.join(cameras)}"
        raise UsageError(said, where=document.path, fix=fix)
    table = cameras[name]
    where = f"{document.path}: {name}"
    remarks: list[str] = []
    extrinsics = _extrinsics(table, where, remarks)
    offset_s = None
    if table.get("timeshift_cam_imu") is not None:
        offset_s = number(table["timeshift_cam_imu"], where=f"{where}.timeshift_cam_imu")
        remarks.append(
            f"timeshift_cam_imu is added to image stamps: {offset_s:g} s; it holds for a LiDAR "
            "that shares the IMU's clock"
        )
    rig = RigFile(
        camera=_camera(table, request, where),
        extrinsics=extrinsics,
        camera_time_offset_s=offset_s,
    )
    return ImportedRig(rig, tuple(remarks))


def _cameras(document: Document) -> dict[str, dict[str, Any]]:
    return {
        name: table
        for name, table in document.table.items()
        if isinstance(table, dict)
        and ("camera_model" in table or any(key in table for key in ("T_cam_imu", "T_cam_lidar")))
    }


def _extrinsics(
    table: dict[str, Any], where: str, remarks: list[str]
) -> dict[tuple[str, str], NDArray[np.float64]]:
    found: dict[tuple[str, str], NDArray[np.float64]] = {}
    for key, other, turned in (
        ("T_cam_imu", "imu", True),
        ("T_imu_cam", "imu", False),
        ("T_cam_lidar", "lidar", True),
    ):
        if key not in table or (other, "camera") in found:
            continue
        T = rigid_from_rows(table[key], where=f"{where}.{key}")
        T = inverse(T) if turned else T
        found[other, "camera"] = T
        seen_from = {"imu": "IMU", "lidar": "LiDAR"}[other]
        said = (
            f"{key} takes {seen_from} points to the camera; turned round"
            if turned
            else f"{key} is the camera's pose in the {seen_from} frame"
        )
        remarks.append(f"{said}: {extrinsics_in_words(T, seen_from=seen_from)}")
    if ("imu", "camera") not in found and ("lidar", "camera") not in found:
        remarks.append("the file does not say where the camera sits: only its lens is taken")
    elif ("lidar", "camera") not in found:
        remarks.append("the file does not say where the LiDAR sits: add T_imu_lidar")
    return found


def _camera(table: dict[str, Any], request: Request, where: str) -> LensCamera | None:
    if "intrinsics" not in table:
        return None
    model = str(table.get("camera_model", "pinhole"))
    distortion = str(table.get("distortion_model", "none"))
    if model != "pinhole" or distortion not in _FISHEYE:
        raise UsageError(
            f"camera model {model!r} with distortion {distortion!r} is not read",
            where=where,
            fix="calibrate as pinhole-radtan, or as pinhole-equi for a wide lens",
        )
    width, height = None, None
    if table.get("resolution") is not None:
        width, height = numbers(table["resolution"], 2, where=f"{where}.resolution")
    return camera_from(
        size_from(width, height, request, where=f"{where}.resolution"),
        numbers(table["intrinsics"], 4, where=f"{where}.intrinsics"),
        numbers(table.get("distortion_coeffs") or [], None, where=f"{where}.distortion_coeffs"),
        fisheye=_FISHEYE[distortion],
        where=where,
    )
