"""OpenCalib's JSON (PJLab-ADG/SensorsCalibration): ``A-to-B-extrinsic`` and ``A-intrinsic``.

Source: its lidar2camera/README.md and sample data: ``sensor_calib`` takes points of
``sensor_name`` to ``target_sensor_name``.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.domain.rig import RigFile
from civil_rgbd.errors import UsageError
from civil_rgbd.geometry.camera import LensCamera
from civil_rgbd.geometry.transforms import inverse
from civil_rgbd.geometry.words import extrinsics_in_words
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


def fits(document: Document) -> bool:
    """Whether this is such a file."""
    return _block(document) is not None


def rig_from(documents: list[Document], request: Request) -> ImportedRig:
    """Read extrinsics, camera, or both from two files.

    Raises:
        UsageError: there is neither, they are between other sensors, or a value is none.
    """
    camera, camera_name, lidar_name = None, None, None
    extrinsics: dict[tuple[str, str], NDArray[np.float64]] = {}
    remarks: list[str] = []
    for document in documents:
        block, where = _block(document), str(document.path)
        if block is None:
            raise UsageError("it is no OpenCalib file", where=where, fix="leave it out")
        param = block["param"]
        if "cam_K" in param:
            camera = _camera(param, request, where)
            camera_name = str(block.get("sensor_name", "")) or None
        if "sensor_calib" in param:
            names = str(block.get("sensor_name")), str(block.get("target_sensor_name"))
            T_target_sensor = rigid_from_rows(param["sensor_calib"], where=where)
            forward = _from_lidar_to_camera(names, where)
            T_lidar_camera = inverse(T_target_sensor) if forward else T_target_sensor
            lidar_name = names[0] if forward else names[1]
            extrinsics["lidar", "camera"] = T_lidar_camera
            remarks.append(
                f"the matrix takes points of {names[0]} to {names[1]}"
                + ("; turned round: " if forward else ": ")
                + extrinsics_in_words(T_lidar_camera)
            )
            if number(param.get("time_lag", 0), where=f"{where}: time_lag"):
                remarks.append(f"time_lag {param['time_lag']} is left out: its sign is not stated")
    if camera is None:
        remarks.append("no file gives the camera: name the -intrinsic.json as well")
    if not extrinsics:
        remarks.append("no file says where the camera sits: name the -extrinsic.json as well")
    rig = RigFile(
        camera=camera, extrinsics=extrinsics, camera_name=camera_name, lidar_name=lidar_name
    )
    return ImportedRig(rig, tuple(remarks))


def _block(document: Document) -> dict[str, Any] | None:
    for block in document.table.values():
        if isinstance(block, dict) and isinstance(block.get("param"), dict):
            param = block["param"]
            if "cam_K" in param or "sensor_calib" in param:
                return block
    return None


def _camera(param: dict[str, Any], request: Request, where: str) -> LensCamera:
    size = size_from(param.get("img_dist_w"), param.get("img_dist_h"), request, where=where)
    return camera_from(
        size,
        numbers(param["cam_K"], 9, where=f"{where}: cam_K"),
        numbers(param.get("cam_dist", []), None, where=f"{where}: cam_dist"),
        where=where,
    )


def _from_lidar_to_camera(names: tuple[str, str], where: str) -> bool:
    kinds = ["lidar" in name.lower() for name in names], ["cam" in name.lower() for name in names]
    if kinds == ([True, False], [False, True]):
        return True
    if kinds == ([False, True], [True, False]):
        return False
    raise UsageError(
        f"it relates {names[0]!r} with {names[1]!r}: which is the LiDAR and which the camera?",
        where=where,
        fix="give an extrinsic between a lidar and a camera",
    )
