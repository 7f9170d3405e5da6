"""livox_camera_calib's ``extrinsic.txt``, with its ``calib.yaml`` or ``camera.yaml``.

Source: hku-mars/livox_camera_calib, result/extrinsic.txt: four rows between commas that take LiDAR
points to the camera. ``ExtrinsicMat`` in its configuration is the first guess, not the result.
"""

from __future__ import annotations

from typing import Any

from civil_rgbd.domain.rig import RigFile
from civil_rgbd.errors import UsageError
from civil_rgbd.geometry.camera import LensCamera
from civil_rgbd.geometry.transforms import inverse
from civil_rgbd.geometry.words import extrinsics_in_words
from civil_rgbd.trajectories.rig_importers.documents import Document, tables_within
from civil_rgbd.trajectories.rig_importers.values import (
    ImportedRig,
    Request,
    camera_from,
    first_of,
    numbers,
    rigid_from_rows,
    size_from,
)


def fits(document: Document) -> bool:
    """Whether this is its result, or its camera."""
    return document.is_matrix or _camera_table(document) is not None


def rig_from(documents: list[Document], request: Request) -> ImportedRig:
    """Read the result, and the camera where its file is given.

    Raises:
        UsageError: no result is among the files, or a value is none.
    """
    results = [document for document in documents if document.is_matrix]
    if len(results) != 1:
        raise UsageError(
            f"{len(results)} of the files hold a matrix",
            where=documents[0].path,
            fix="give one extrinsic.txt, and calib.yaml or camera.yaml with it",
        )
    where = str(results[0].path)
    T_lidar_camera = inverse(rigid_from_rows(results[0].data, where=where))
    remarks = [
        "the matrix takes LiDAR points to the camera; turned round: "
        + extrinsics_in_words(T_lidar_camera)
    ]
    camera = _camera(documents, request)
    if camera is None:
        remarks.append("no file gives the camera: name calib.yaml as well, or use --onto")
    rig = RigFile(camera=camera, extrinsics={("lidar", "camera"): T_lidar_camera})
    return ImportedRig(rig, tuple(remarks))


def _camera_table(document: Document) -> dict[str, Any] | None:
    for table in tables_within(document.table):
        if first_of(table, "camera_matrix", "CameraMat") is not None and (
            first_of(table, "dist_coeffs", "DistCoeffs") is not None
        ):
            return table
    return None


def _camera(documents: list[Document], request: Request) -> LensCamera | None:
    for document in documents:
        table = _camera_table(document)
        if table is None:
            continue
        where = str(document.path)
        width, height = table.get("Camera.width"), table.get("Camera.height")
        return camera_from(
            size_from(width, height, request, where=where),
            numbers(first_of(table, "camera_matrix", "CameraMat"), 9, where=where),
            numbers(first_of(table, "dist_coeffs", "DistCoeffs"), None, where=where),
            where=where,
        )
    return None
