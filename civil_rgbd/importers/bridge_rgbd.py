"""The published Bridge RGB-D release: ``rgb/`` and ``depth/`` of equal names.

Depth is as KITTI has it: 16-bit PNG, metres x 256, 0 = none. The layout of intrinsics, poses and
stamps is not published: taken is whatever lies beside the two folders, in any of the layouts that
this room reads.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

from civil_rgbd.importers.folder_set import Layout, open_folder_set
from civil_rgbd.importers.rendered_set import ImportOptions, RenderedSet

LAYOUT: Final = Layout("bridge-rgbd", scale=256.0)


def open_set(source: Path, options: ImportOptions) -> RenderedSet:
    """Open one bridge of the release.

    Raises:
        RecordingError: something is missing, or does not fit.
    """
    return open_folder_set(source, options, LAYOUT)
