"""direct_visual_lidar_calibration's ``calib.json``.

Source: koide3/direct_visual_lidar_calibration, docs/calibration.md: ``T_lidar_camera: [x, y, z, qx,
qy, qz, qw]`` transforms a point in the camera frame into the LiDAR frame. ``init_T_lidar_camera``
(by hand) and ``init_T_lidar_camera_auto`` are first guesses.
"""

from __future__ import annotations

from typing import Final

from civil_rgbd.domain.rig import RigFile
from civil_rgbd.errors import UsageError
from civil_rgbd.geometry.words import extrinsics_in_words
from civil_rgbd.trajectories.rig_importers.documents import Document
from civil_rgbd.trajectories.rig_importers.values import (
    ImportedRig,
    Request,
    camera_from,
    numbers,
    rigid_from_quaternion,
)

_FISHEYE: Final = {
    "plumb_bob": False,
    "rational_polynomial": False,
    "fisheye": True,
    "equidistant": True,
}
_GUESSES: Final = ("init_T_lidar_camera", "init_T_lidar_camera_auto")


def fits(document: Document) -> bool:
    """Whether this is such a file."""
    table = document.table
    return isinstance(table.get("camera"), dict) and "camera_model" in table["camera"]


def rig_from(documents: list[Document], request: Request) -> ImportedRig:
    """Read the result and the camera.

    Raises:
        UsageError: the calibration is not finished, its camera is not read, or a value is none.
    """
    document = documents[0]
    table, where = document.table, str(document.path)
    results = table.get("results") or {}
    if "T_lidar_camera" not in results:
        guess = next((name for name in _GUESSES if name in results), None)
        raise UsageError(
            "it holds no result"
            + (f", only the first guess {guess}" if guess else "")
            + ": T_lidar_camera is missing",
            where=where,
            fix="run `calibrate` on that folder to the end",
        )
    T_lidar_camera = rigid_from_quaternion(
        results["T_lidar_camera"], where=f"{where}: T_lidar_camera"
    )
    given = table.get("camera") or {}
    model = str(given.get("camera_model"))
    if model not in _FISHEYE:
        raise UsageError(
            f"camera model {model!r} is not read",
            where=where,
            fix=f"calibrate as one of {', '.join(_FISHEYE)}",
        )
    camera = camera_from(
        request.image_size_px,
        numbers(given.get("intrinsics"), 4, where=f"{where}: intrinsics"),
        numbers(given.get("distortion_coeffs") or [], None, where=f"{where}: distortion_coeffs"),
        fisheye=_FISHEYE[model],
        where=where,
    )
    said = "T_lidar_camera is the camera's pose in the LiDAR frame: "
    rig = RigFile(camera=camera, extrinsics={("lidar", "camera"): T_lidar_camera})
    return ImportedRig(rig, (said + extrinsics_in_words(T_lidar_camera),))
