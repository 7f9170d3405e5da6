"""Bilinear resizing with corners on corners, pixel by pixel, as ZoeDepth prepares its input."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def resize_corners(image: NDArray[np.float64], rows: int, columns: int) -> NDArray[np.float64]:
    """Resize (H, W) to (rows, columns); the four corner pixels keep their values."""
    height, width = image.shape
    out = np.zeros((rows, columns))
    for row in range(rows):
        for column in range(columns):
            y = row * (height - 1) / (rows - 1)
            x = column * (width - 1) / (columns - 1)
            top, left = min(int(y), height - 2), min(int(x), width - 2)
            dy, dx = y - top, x - left
            out[row, column] = (
                image[top, left] * (1 - dy) * (1 - dx)
                + image[top, left + 1] * (1 - dy) * dx
                + image[top + 1, left] * dy * (1 - dx)
                + image[top + 1, left + 1] * dy * dx
            )
    return out
