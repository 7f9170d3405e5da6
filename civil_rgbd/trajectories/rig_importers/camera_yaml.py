"""A camera alone: ROS's CameraInfo yaml, and what OpenCV's calibration programs write.

Sources: ros-perception/image_common, camera_calibration_parsers (image_width, camera_matrix,
distortion_model, ...), and ``rostopic echo`` of a CameraInfo (width, K, D; k, d in ROS 2); OpenCV,
samples/cpp/calibration.cpp and tutorial_code/calib3d/camera_calibration (camera_matrix,
distortion_coefficients, fisheye_model; older releases write Camera_Matrix, image_Width).
"""

from __future__ import annotations

from typing import Any, Final

from civil_rgbd.domain.rig import RigFile
from civil_rgbd.errors import UsageError
from civil_rgbd.resources import nearest
from civil_rgbd.trajectories.rig_importers.documents import Document, tables_within
from civil_rgbd.trajectories.rig_importers.values import (
    ImportedRig,
    Request,
    camera_from,
    first_of,
    numbers,
    size_from,
)

_MATRIX: Final = ("camera_matrix", "Camera_Matrix", "cameraMatrix", "K", "k", "CameraMat")
_COEFFICIENTS: Final = (
    "distortion_coefficients",
    "Distortion_Coefficients",
    "distCoeffs",
    "dist_coeffs",
    "D",
    "d",
    "DistCoeff",
)
_WIDTH: Final = ("image_width", "image_Width", "width", "Camera.width")
_HEIGHT: Final = ("image_height", "image_Height", "height", "Camera.height")
_FISHEYE: Final = {
    "plumb_bob": False,
    "rational_polynomial": False,
    "radtan": False,
    "": False,
    "none": False,
    "fisheye": True,
    "equidistant": True,
    "kannala_brandt4": True,
}
"""Distortion models by ROS's names, and whether they are fisheyes."""


def fits_ros(document: Document) -> bool:
    """Whether this is a CameraInfo: it names its distortion model."""
    table = _table([document])
    return table is not None and "distortion_model" in table


def fits_opencv(document: Document) -> bool:
    """Whether this is a camera as OpenCV writes it."""
    table = _table([document])
    return table is not None and "distortion_model" not in table


def rig_from(documents: list[Document], request: Request) -> ImportedRig:
    """Read the camera.

    Raises:
        UsageError: there is none, its model is not read, or a value is none.
    """
    table, where = _table(documents), str(documents[0].path)
    if table is None:
        raise UsageError(
            "it has no camera_matrix with distortion_coefficients",
            where=where,
            fix="give the yaml that the calibration program wrote",
        )
    model = str(table.get("distortion_model") or "").lower()
    if model not in _FISHEYE:
        raise UsageError(
            f"distortion_model {model!r} is not read", where=where, fix=nearest(model, _FISHEYE)
        )
    fisheye = _FISHEYE[model] or bool(table.get("fisheye_model") or table.get("Fisheye"))
    camera = camera_from(
        size_from(first_of(table, *_WIDTH), first_of(table, *_HEIGHT), request, where=where),
        numbers(first_of(table, *_MATRIX), 9, where=f"{where}: camera_matrix"),
        numbers(first_of(table, *_COEFFICIENTS), None, where=f"{where}: distortion"),
        fisheye=fisheye,
        where=where,
    )
    name = table.get("camera_name")
    rig = RigFile(camera=camera, camera_name=str(name) if name else None)
    return ImportedRig(rig, ("the file does not say where the camera sits: add T_lidar_camera",))


def _table(documents: list[Document]) -> dict[str, Any] | None:
    for document in documents:
        for table in tables_within(document.table):
            if first_of(table, *_MATRIX) is not None and (
                first_of(table, *_COEFFICIENTS) is not None
            ):
                return table
    return None
