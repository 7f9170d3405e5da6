"""Redwood's layout, as Open3D reads it: ``image/`` or ``color/``, ``depth/`` in mm, one ``.log``.

The ``.log`` holds camera-to-map matrices, one an image, in order. Without intrinsics the camera is
the one that Redwood states for its 640 x 480 sequences: 525, 525, 319.5, 239.5.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

from civil_rgbd.importers.folder_set import Layout, open_folder_set
from civil_rgbd.importers.rendered_set import ImportOptions, Intrinsics, RenderedSet

CAMERA: Final = Intrinsics(525.0, 525.0, 319.5, 239.5, width_px=640, height_px=480)
LAYOUT: Final = Layout("redwood", scale=1000.0, usual_camera=CAMERA)


def open_set(source: Path, options: ImportOptions) -> RenderedSet:
    """Open a Redwood sequence.

    Raises:
        RecordingError: something is missing, or does not fit.
    """
    return open_folder_set(source, options, LAYOUT)
