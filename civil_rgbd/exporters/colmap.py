"""COLMAP's text model: ``cameras.txt``, ``images.txt``, ``points3D.txt``, and the images.

COLMAP's poses are map to camera, quaternions w first; the centre of its first pixel is (0.5, 0.5),
so cx and cy grow by half a pixel (colmap.github.io/format.html). The points come from the depth,
one for each cube, without tracks: no image feature was matched.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Final

from civil_rgbd.exporters.files import copy_image, numbers, write_lines
from civil_rgbd.exporters.points import points_of
from civil_rgbd.exporters.poses import transform_of
from civil_rgbd.exporters.report import ExportOptions, Losses
from civil_rgbd.exporters.selection import Chosen
from civil_rgbd.geometry.transforms import inverse, quaternion_from_matrix

VOXEL_M: Final = 0.1
"""Edge of the cubes that keep a point each, where the user names none."""


def write(folder: Path, one: Chosen, options: ExportOptions) -> Losses:
    """Write one bridge as a sparse model with its images.

    Returns:
        what is lost.

    Raises:
        FormatError: a frame is damaged.
    """
    camera, model = one.bridge.camera, folder / "sparse" / "0"
    voxel_m = options.voxel_m or VOXEL_M
    images = []
    for number, row in enumerate(one.rows, start=1):
        image = copy_image(one.bridge, row, folder / "images" / row.frame_id)
        T_camera_map = inverse(transform_of(row))
        qx, qy, qz, qw = quaternion_from_matrix(T_camera_map[:3, :3])
        pose = numbers(qw, qx, qy, qz, *T_camera_map[:3, 3])
        images += [f"{number} {pose} 1 {image.name}", ""]  # the empty line: no 2D points
    intrinsics = numbers(camera.fx_px, camera.fy_px, camera.cx_px + 0.5, camera.cy_px + 0.5)
    write_lines(
        model / "cameras.txt",
        [
            "# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]",
            f"1 PINHOLE {camera.width_px} {camera.height_px} {intrinsics}",
        ],
    )
    head = "# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME; then POINTS2D[]"
    write_lines(model / "images.txt", [head, *images])
    write_lines(model / "points3D.txt", _points(one, replace(options, voxel_m=voxel_m)))
    return Losses(
        [
            f"depth images become one point for each cube of {voxel_m:g} m",
            "time stamps, quality planes and defects have no place",
        ]
    )


def _points(one: Chosen, options: ExportOptions) -> Iterator[str]:
    yield "# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[]"
    number = 0
    for part in points_of(one, options):
        for point, colour in zip(part.points_map.tolist(), part.rgb.tolist(), strict=True):
            number += 1
            yield f"{number} {numbers(*point)} {' '.join(map(str, colour))} 0"
