"""The layout of cviss-lab/localization: ``rgb/``, ``depth/`` in millimetres, ``poses.csv``.

``poses.csv`` has no header: ``id,tx,ty,tz,qx,qy,qz,qw``, camera to map, ids from 1;
``intrinsics.json`` has ``camera_matrix``, ``dist_coeff``, ``width`` and ``height``. The depth may
be smaller than the image; the camera is then that of the image, scaled.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

from civil_rgbd.importers.folder_set import Layout, open_folder_set
from civil_rgbd.importers.rendered_set import ImportOptions, RenderedSet

LAYOUT: Final = Layout("lab", scale=1000.0)


def open_set(source: Path, options: ImportOptions) -> RenderedSet:
    """Open a folder of the lab's.

    Raises:
        RecordingError: something is missing, or does not fit.
    """
    return open_folder_set(source, options, LAYOUT)
