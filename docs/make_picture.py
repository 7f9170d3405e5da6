"""Draw one frame of a dataset beside its depth: ``python docs/make_picture.py DATASET [PICTURE]``.

Near is light and far is dark, grey is not measured. The frame with the most depth is drawn.
"""

from __future__ import annotations

import sys
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from civil_rgbd.format.depth_exr import read_depth
from civil_rgbd.format.images import read_image
from civil_rgbd.format.layout import bridge_folders
from civil_rgbd.format.reader import read_bridge

PICTURE = Path(__file__).parent / "images" / "frame_and_depth.png"
NOT_MEASURED_BGR = (96, 96, 96)
GAP_PX = 8


def main() -> None:
    """Read the dataset, write the picture, say where."""
    location = Path(sys.argv[1])
    picture = Path(sys.argv[2]) if len(sys.argv) > 2 else PICTURE
    rgb, depth_m = fullest_frame(location)
    picture.parent.mkdir(parents=True, exist_ok=True)
    gap = np.full((len(rgb), GAP_PX, 3), 255, dtype=np.uint8)
    bgr = cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR)
    cv2.imwrite(str(picture), np.hstack([bgr, gap, coloured(depth_m)]))
    print(picture)


def fullest_frame(location: Path) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    """Return rgb (H, W, 3) and depth (H, W) in metres of the frame with the most depth."""
    folder, row = max(
        (
            (folder, row)
            for folder in bridge_folders(location).values()
            for row in read_bridge(folder).rows
        ),
        key=lambda found: found[1].valid_share,
    )
    return read_image(folder / row.rgb_path), read_depth(folder / row.depth_path)


def coloured(depth_m: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Return depth (H, W) in metres as a picture (H, W, 3) in BGR.

    Colours follow the logarithm of depth between the 1st and 99th percentile: near things would
    otherwise share one colour.
    """
    valid = depth_m > 0
    log_depth = np.log(np.where(valid, depth_m, 1.0))
    near, far = np.percentile(log_depth[valid], [1, 99])
    share = np.where(valid, np.clip((far - log_depth) / max(far - near, 1e-6), 0, 1), 0)
    # Single points vanish when a page shows the picture smaller: each covers its neighbours, and
    # the nearest (largest) wins.
    levels = np.where(valid, 1 + 254 * share, 0).astype(np.uint8)
    grown = cv2.dilate(levels, np.ones((2, 2), np.uint8))
    picture = cv2.applyColorMap(grown, cv2.COLORMAP_INFERNO)
    picture[grown == 0] = NOT_MEASURED_BGR
    return np.asarray(picture, dtype=np.uint8)


if __name__ == "__main__":
    main()
