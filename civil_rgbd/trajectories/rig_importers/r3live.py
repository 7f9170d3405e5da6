"""R3LIVE's ``r3live_config.yaml``.

Source: hku-mars/r3live, config/r3live_config.yaml, and the authors' word in its issue 16 that the
extrinsics are the camera's pose with respect to the IMU: ``p_imu = R p_camera + t``.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from civil_rgbd.domain.rig import RigFile
from civil_rgbd.errors import UsageError
from civil_rgbd.geometry.transforms import transform_from
from civil_rgbd.geometry.words import extrinsics_in_words
from civil_rgbd.trajectories.rig_importers.documents import Document, table_with
from civil_rgbd.trajectories.rig_importers.values import (
    ImportedRig,
    Request,
    camera_from,
    number,
    numbers,
    rigid,
    size_from,
)

# Livox Avia user manual: origin of the point cloud in the frame of the IMU inside, metres.
_AVIA_IN_ITS_IMU_M: Final = (0.04165, 0.02326, -0.0284)
_AVIA: Final = 1  # lidar_type in Lidar_front_end


def fits(document: Document) -> bool:
    """Whether this is such a file."""
    return table_with([document], "camera_ext_R", "camera_ext_t") is not None


def rig_from(documents: list[Document], request: Request) -> ImportedRig:
    """Read camera and camera pose; of the LiDAR it says its type at most.

    Raises:
        UsageError: a value is missing or is none.
    """
    found = table_with(documents, "camera_ext_R", "camera_ext_t")
    if found is None:
        raise UsageError(
            "it has no camera_ext_R and camera_ext_t",
            where=documents[0].path,
            fix="give r3live_config.yaml; its camera and extrinsics stand under r3live_vio",
        )
    document, table = found
    where = f"{document.path}: camera_ext"
    rotation = numbers(table["camera_ext_R"], 9, where=f"{where}_R")
    T_imu_camera = rigid(
        rotation, numbers(table["camera_ext_t"], 3, where=f"{where}_t"), where=where
    )
    remarks = [
        "camera_ext_R and camera_ext_t are the camera's pose in the IMU frame: "
        + extrinsics_in_words(T_imu_camera, seen_from="IMU")
    ]
    extrinsics = {("imu", "camera"): T_imu_camera}
    front = table_with(documents, "lidar_type")
    if front is not None and number(front[1]["lidar_type"], where="lidar_type") == _AVIA:
        extrinsics["imu", "lidar"] = transform_from(np.eye(3), _AVIA_IN_ITS_IMU_M)
        remarks.append(
            "the file does not say where the LiDAR sits; lidar_type 1 is taken for a Livox Avia, "
            "whose manual puts it at x 0.042, y 0.023, z -0.028 m of its own IMU, axes parallel: "
            "correct T_imu_lidar for another LiDAR or IMU"
        )
    else:
        remarks.append("the file does not say where the LiDAR sits: add T_imu_lidar")
    camera = None
    if "camera_intrinsic" in table:
        place = str(document.path)
        size = size_from(table.get("image_width"), table.get("image_height"), request, where=place)
        camera = camera_from(
            size,
            numbers(table["camera_intrinsic"], 9, where=f"{place}: camera_intrinsic"),
            numbers(
                table.get("camera_dist_coeffs", []), None, where=f"{place}: camera_dist_coeffs"
            ),
            where=place,
        )
    return ImportedRig(RigFile(camera=camera, extrinsics=extrinsics), tuple(remarks))
