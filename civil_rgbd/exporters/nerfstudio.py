"""nerfstudio's ``transforms.json``: OpenGL axes, pixel corners at whole numbers, depth in mm.

Conventions: docs.nerf.studio, "Data conventions": x right, y up, z backwards, camera to map; the
centre of the first pixel is (0.5, 0.5); depth is 16-bit PNG with 0.001 m a unit.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Final

import numpy as np

from civil_rgbd.exporters.files import copy_image, write_depth_png, write_lines
from civil_rgbd.exporters.poses import transform_of
from civil_rgbd.exporters.report import ExportOptions, Losses
from civil_rgbd.exporters.selection import Chosen
from civil_rgbd.geometry.transforms import compose

SCALE: Final = 1000.0
"""Stored depth units a metre; the furthest is 65.5 m."""

T_OPTICAL_OPENGL: Final = np.diag([1.0, -1.0, -1.0, 1.0])
"""From x right, y up, z backwards to x right, y down, z forward."""


def write(folder: Path, one: Chosen, options: ExportOptions) -> Losses:
    """Write one bridge as a nerfstudio dataset.

    Returns:
        what is lost.

    Raises:
        FormatError: a frame is damaged.
    """
    losses = Losses(["time stamps, quality planes and defects have no place"])
    frames = []
    for row in one.rows:
        image = copy_image(one.bridge, row, folder / "images" / row.frame_id)
        depth = folder / "depth" / f"{row.frame_id}.png"
        write_depth_png(one.bridge, row, depth, scale=SCALE, losses=losses)
        T_map_opengl = compose(transform_of(row), T_OPTICAL_OPENGL) + 0.0  # + 0.0: no -0.0
        frames.append(
            {
                "file_path": f"images/{image.name}",
                "depth_file_path": f"depth/{depth.name}",
                "transform_matrix": T_map_opengl.tolist(),
            }
        )
        options.on_frame()
    camera = one.bridge.camera
    document = {
        "camera_model": "OPENCV",
        "w": camera.width_px,
        "h": camera.height_px,
        "fl_x": camera.fx_px,
        "fl_y": camera.fy_px,
        "cx": camera.cx_px + 0.5,
        "cy": camera.cy_px + 0.5,
        **dict.fromkeys(("k1", "k2", "p1", "p2"), 0.0),
        "depth_unit_scale_factor": 1.0 / SCALE,
        "frames": frames,
    }
    write_lines(folder / "transforms.json", [json.dumps(document, indent=1, allow_nan=False)])
    return losses
