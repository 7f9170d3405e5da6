"""FAST-LIVO2's ``avia.yaml`` with its ``camera_pinhole.yaml``, for ROS 1 and ROS 2.

Source: hku-mars/FAST-LIVO2, config/. ``extrinsic_R/T`` is the LiDAR's pose in the IMU frame,
``Rcl/Pcl`` takes LiDAR points to the camera, and its image callback adds ``img_time_offset`` to
image stamps. The camera file is vikit's: size and intrinsics are of the full image, ``scale`` is
what FAST-LIVO2 shrinks it by for itself.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.domain.rig import RigFile
from civil_rgbd.errors import UsageError
from civil_rgbd.geometry.camera import LensCamera
from civil_rgbd.geometry.transforms import inverse
from civil_rgbd.geometry.words import extrinsics_in_words, mounting_in_words
from civil_rgbd.trajectories.rig_importers.documents import Document, table_with, tables_within
from civil_rgbd.trajectories.rig_importers.values import (
    ImportedRig,
    Request,
    camera_from,
    first_of,
    number,
    numbers,
    rigid,
    size_from,
)

_MODELS: Final = {"pinhole": False, "equidistantcamera": True, "equidistant": True}
"""vikit's camera models that are read, and whether they are fisheyes."""


def fits(document: Document) -> bool:
    """Whether this is such a file, or its companion with the camera."""
    return (
        table_with([document], "Rcl", "Pcl") is not None
        or table_with([document], "extrinsic_T", "extrinsic_R") is not None
        or _camera_table([document]) is not None
    )


def rig_from(documents: list[Document], request: Request) -> ImportedRig:
    """Read LiDAR pose, LiDAR to camera, time offset and camera.

    Raises:
        UsageError: there is none of them, or a value is none.
    """
    extrinsics: dict[tuple[str, str], NDArray[np.float64]] = {}
    remarks: list[str] = []
    found = table_with(documents, "Rcl", "Pcl")
    if found is not None:
        T_camera_lidar = _joined(found, "Rcl", "Pcl")
        extrinsics["lidar", "camera"] = inverse(T_camera_lidar)
        remarks.append(
            "Rcl and Pcl take LiDAR points to the camera; turned round: "
            + extrinsics_in_words(extrinsics["lidar", "camera"])
        )
    found = table_with(documents, "extrinsic_R", "extrinsic_T")
    if found is not None:
        extrinsics["imu", "lidar"] = _joined(found, "extrinsic_R", "extrinsic_T")
        remarks.append(
            "extrinsic_R and extrinsic_T are the LiDAR's pose in the IMU frame: "
            + mounting_in_words(extrinsics["imu", "lidar"], what="LiDAR", seen_from="IMU")
        )
    camera = _camera(documents, request, remarks)
    if not extrinsics and camera is None:
        raise UsageError(
            "there is neither Rcl and Pcl nor a camera in it",
            where=documents[0].path,
            fix="give FAST-LIVO2's yaml and its camera yaml, one after the other",
        )
    if not extrinsics or camera is None:
        what = "the camera" if camera is None else "extrinsics"
        remarks.append(f"no file gives {what}: name FAST-LIVO2's other yaml as well")
    offset_s = _time_offset(documents, remarks)
    rig = RigFile(camera=camera, extrinsics=extrinsics, camera_time_offset_s=offset_s)
    return ImportedRig(rig, tuple(remarks))


def _joined(found: tuple[Document, dict[str, Any]], R: str, t: str) -> NDArray[np.float64]:
    document, table = found
    rotation = numbers(table[R], 9, where=f"{document.path}: {R}")
    translation = numbers(table[t], 3, where=f"{document.path}: {t}")
    return rigid(rotation, translation, where=f"{document.path}: {R}")


def _time_offset(documents: list[Document], remarks: list[str]) -> float | None:
    found = table_with(documents, "img_time_offset")
    if found is None:
        return None
    offset_s = number(found[1]["img_time_offset"], where=f"{found[0].path}: img_time_offset")
    remarks.append(f"img_time_offset is added to image stamps: {offset_s:g} s")
    return offset_s


def _camera_table(documents: list[Document]) -> tuple[Document, dict[str, Any]] | None:
    for document in documents:
        for table in tables_within(document.table):
            model = first_of(table, "cam_model", "model")
            if isinstance(model, str) and first_of(table, "cam_fx", "fx") is not None:
                return document, table
    return None


def _camera(documents: list[Document], request: Request, remarks: list[str]) -> LensCamera | None:
    found = _camera_table(documents)
    if found is None:
        return None
    document, table = found
    where = str(document.path)
    model = str(first_of(table, "cam_model", "model"))
    if model.lower() not in _MODELS:
        raise UsageError(
            f"camera model {model!r} is not read",
            where=where,
            fix=f"calibrate as one of {', '.join(_MODELS)}",
        )
    fisheye = _MODELS[model.lower()]
    intrinsics = [
        number(first_of(table, f"cam_{name}", name), where=f"{where}: {name}")
        for name in ("fx", "fy", "cx", "cy")
    ]
    names = ["k1", "k2", "k3", "k4"] if fisheye else [f"d{i}" for i in range(14)]
    given = [first_of(table, f"cam_{name}", name) for name in names]
    coefficients = [number(value, where=where) for value in given if value is not None]
    width, height = first_of(table, "cam_width", "width"), first_of(table, "cam_height", "height")
    if table.get("scale", 1) != 1:
        remarks.append(
            f"scale {table['scale']} is how far FAST-LIVO2 shrinks images for itself; the camera "
            "here is that of the full image"
        )
    return camera_from(
        size_from(width, height, request, where=where),
        intrinsics,
        coefficients,
        fisheye=fisheye,
        where=where,
    )
