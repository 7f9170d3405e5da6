"""Files of an export: copied as they are, or written anew."""

from __future__ import annotations

import shutil
from collections.abc import Iterable
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from civil_rgbd.domain.frame import FrameRow
from civil_rgbd.errors import FormatError
from civil_rgbd.exporters.report import Losses
from civil_rgbd.format.reader import Bridge

LARGEST_CODE: Final = 65534
"""Depth codes are 16 bits wide; readers take the largest number of all for "cut off here"."""

_PNG_COMPRESSION: Final = 3  # higher levels cost far more time than they save space


def copy_image(bridge: Bridge, row: FrameRow, destination: Path) -> Path:
    """Copy a frame's colour image byte for byte; its ending stays.

    Args:
        bridge: where it lies.
        row: the frame.
        destination: without ending.

    Returns:
        the path with ending.

    Raises:
        FormatError: the image is missing or damaged.
    """
    bridge.read_rgb(row)  # a damaged image is refused here, not by whoever trains on it
    source = bridge.folder / row.rgb_path
    target = destination.with_name(destination.name + source.suffix)
    target.parent.mkdir(parents=True, exist_ok=True)
    if isinstance(source, Path):
        shutil.copyfile(source, target)
    else:
        target.write_bytes(source.read_bytes())
    return target


def depth_codes(depth_m: NDArray[np.float32], scale: float, losses: Losses) -> NDArray[np.uint16]:
    """Turn metres into 16-bit numbers, rounded half up; what does not fit becomes 0, counted.

    Args:
        depth_m: (H, W) float32, metres, 0 = nothing measured.
        scale: units a metre.
        losses: counts what is lost.

    Returns:
        (H, W) uint16, 0 = none.
    """
    metres = depth_m.astype(np.float64)
    codes = np.floor(metres * scale + 0.5)
    beyond, below = codes > LARGEST_CODE, (metres > 0) & (codes == 0)
    codes[beyond] = 0
    kept = codes > 0
    losses.beyond_pixels += int(beyond.sum())
    losses.below_pixels += int(below.sum())
    losses.kept_pixels += int(kept.sum())
    if kept.any():
        error_m = float(np.abs(codes[kept] / scale - metres[kept]).max())
        losses.largest_error_m = max(losses.largest_error_m, error_m)
    return codes.astype(np.uint16)


def write_depth_png(
    bridge: Bridge, row: FrameRow, path: Path, *, scale: float, losses: Losses
) -> None:
    """Write a frame's depth as a 16-bit PNG.

    Raises:
        FormatError: the depth is missing or damaged.
    """
    codes = depth_codes(bridge.read_depth(row), scale, losses)
    done, data = cv2.imencode(".png", codes, [cv2.IMWRITE_PNG_COMPRESSION, _PNG_COMPRESSION])
    if not done:
        raise FormatError(
            f"OpenCV cannot pack depth of {codes.shape}", where=path, fix="report this as a bug"
        )
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data.tobytes())


def write_lines(path: Path, lines: Iterable[str]) -> None:
    """Write a text file, line feeds on every system."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", encoding="utf-8", newline="\n") as stream:
        stream.writelines(f"{line}\n" for line in lines)


def numbers(*values: float) -> str:
    """Write floats so that reading gives them back exactly.

    >>> numbers(0.1, np.float64(2), -0.0)
    '0.1 2.0 0.0'
    """
    return " ".join(repr(float(value) + 0.0) for value in values)
