"""Local planar guidance, pixel by pixel (arXiv 1907.10326, equations 2 to 4)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray


def planar_guidance(plane: NDArray[np.float64], ratio: int) -> NDArray[np.float64]:
    """Fill patches with the depth of their planes.

    Args:
        plane: (3, h, w) in 0 to 1: polar angle / (pi/3), azimuth / (2 pi), distance.
        ratio: pixels along the edge of a patch.

    Returns:
        (ratio h, ratio w).
    """
    _, rows, columns = plane.shape
    depth = np.zeros((rows * ratio, columns * ratio))
    for row in range(rows * ratio):
        for column in range(columns * ratio):
            polar, azimuth, distance = plane[:, row // ratio, column // ratio]
            theta, phi = polar * math.pi / 3, azimuth * 2 * math.pi
            normal = (
                math.sin(theta) * math.cos(phi),
                math.sin(theta) * math.sin(phi),
                math.cos(theta),
            )
            u = (column % ratio - (ratio - 1) / 2) / ratio
            v = (row % ratio - (ratio - 1) / 2) / ratio
            depth[row, column] = distance / (normal[0] * u + normal[1] * v + normal[2])
    return depth
