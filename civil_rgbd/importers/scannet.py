"""What ScanNet's own exporter writes: ``color/``, ``depth/`` in mm, ``pose/``, ``intrinsic/``.

``pose/N.txt`` is a 4 x 4 camera-to-map matrix, -inf where tracking was lost. Colour (1296 x 968)
and depth (640 x 480) have cameras of their own; frames are made on the depth's pixels. Where
the images were resized to the depth's size, the depth's camera is that of both.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Final

from civil_rgbd.importers.cameras import read_camera
from civil_rgbd.importers.folder_set import Layout, open_folder_set
from civil_rgbd.importers.folders import find_folders
from civil_rgbd.importers.pixels import read_colour, read_raw_depth
from civil_rgbd.importers.rendered_set import ImportOptions, RenderedSet

LAYOUT: Final = Layout("scannet", scale=1000.0)


def open_set(source: Path, options: ImportOptions) -> RenderedSet:
    """Open an exported scan.

    Raises:
        RecordingError: something is missing, or does not fit.
    """
    root, _, _ = find_folders(source)
    colour, depth = _camera_file(root, "color"), _camera_file(root, "depth")
    if options.intrinsics or depth is None:
        given = options.intrinsics or (str(colour) if colour else None)
        return open_folder_set(root, replace(options, intrinsics=given), LAYOUT)
    opened = open_folder_set(root, replace(options, intrinsics=str(colour or depth)), LAYOUT)
    camera = read_camera(depth)
    if colour is None or _same_size(opened):
        return replace(opened, intrinsics=camera)
    return replace(opened, depth_intrinsics=camera, files=(*opened.files, depth))


def _camera_file(root: Path, kind: str) -> Path | None:
    names = (f"intrinsic/intrinsic_{kind}.txt", f"intrinsics/intrinsic_{kind}.txt")
    return next((root / n for n in (*names, f"intrinsic_{kind}.txt") if (root / n).is_file()), None)


def _same_size(opened: RenderedSet) -> bool:
    first = opened.frames[0] if opened.frames else None
    return (
        first is not None and read_colour(first.rgb).shape[:2] == read_raw_depth(first.depth).shape
    )
