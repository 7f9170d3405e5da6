"""TUM RGB-D: ``rgb.txt``, ``depth.txt``, ``groundtruth.txt``, depth x 5000, camera to map."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Final

from civil_rgbd.exporters.files import copy_image, numbers, write_depth_png, write_lines
from civil_rgbd.exporters.poses import stamp_text
from civil_rgbd.exporters.report import ExportOptions, Losses
from civil_rgbd.exporters.selection import Chosen
from civil_rgbd.geometry.camera import PinholeCamera

SCALE: Final = 5000.0
"""Stored depth units a metre, the benchmark's own; the furthest is 13.1 m."""


def write(folder: Path, one: Chosen, options: ExportOptions) -> Losses:
    """Write one bridge as a sequence.

    Returns:
        what is lost.

    Raises:
        FormatError: a frame is damaged.
    """
    losses = Losses(["quality planes, defects and the manifest's counts have no place"])
    scale = options.depth_scale or SCALE
    rgb, depth, poses = [], [], []
    for row in one.rows:
        stamp = stamp_text(row.stamp_ns)
        image = copy_image(one.bridge, row, folder / "rgb" / row.frame_id)
        path = folder / "depth" / f"{row.frame_id}.png"
        write_depth_png(one.bridge, row, path, scale=scale, losses=losses)
        rgb.append(f"{stamp} rgb/{image.name}")
        depth.append(f"{stamp} depth/{path.name}")
        pose = numbers(row.tx, row.ty, row.tz, row.qx, row.qy, row.qz, row.qw)
        poses.append(f"{stamp} {pose}")
        options.on_frame()
    write_lines(folder / "rgb.txt", ["# timestamp filename", *rgb])
    write_lines(folder / "depth.txt", ["# timestamp filename", *depth])
    write_lines(folder / "groundtruth.txt", ["# timestamp tx ty tz qx qy qz qw", *poses])
    write_lines(folder / "intrinsics.json", [json.dumps(camera_document(one.bridge.camera))])
    if scale != SCALE:
        losses.words.append(f"depth is x {scale:g}, not the benchmark's {SCALE:g}: tell its reader")
    return losses


def camera_document(camera: PinholeCamera) -> dict[str, object]:
    """Return a camera as ``intrinsics.json`` of the lab's layout has it; TUM itself has no file."""
    return {
        "camera_matrix": camera.matrix.tolist(),
        "dist_coeff": [0.0] * 5,
        "width": camera.width_px,
        "height": camera.height_px,
    }
