"""ICL-NUIM, its version for the TUM tools: depth x 5000, along the optical axis, and fy = -480.

Its camera's y axis points up. With M = diag(1, -1, 1) the focal length becomes positive, the pixels
stay, and ``T_map_camera`` becomes ``M T M``: the map is seen in a mirror, rotations stay rotations.
Source of the numbers: Handa et al., "A Benchmark for RGB-D Visual Odometry, 3D Reconstruction and
SLAM", ICRA 2014, and its page. With a Redwood ``.log`` beside the images it is Redwood's rendering
of the same rooms, in Redwood's layout.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

from civil_rgbd.importers import redwood
from civil_rgbd.importers.folder_set import Layout, open_folder_set
from civil_rgbd.importers.folders import find_folders
from civil_rgbd.importers.pose_tables import find_poses
from civil_rgbd.importers.rendered_set import ImportOptions, Intrinsics, RenderedSet

CAMERA: Final = Intrinsics(481.20, -480.00, 319.50, 239.50, width_px=640, height_px=480)
LAYOUT: Final = Layout("icl", scale=5000.0, usual_camera=CAMERA)


def open_set(source: Path, options: ImportOptions) -> RenderedSet:
    """Open a sequence of ICL-NUIM.

    Raises:
        RecordingError: something is missing, or does not fit.
    """
    root, _, _ = find_folders(source)
    poses = options.poses or find_poses(root)
    by_redwood = poses is not None and poses.suffix == ".log"
    return open_folder_set(root, options, redwood.LAYOUT if by_redwood else LAYOUT)
