"""Depth images: EXR, one channel ``Z``, float32 metres, lossless."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Final

import numpy as np
import OpenEXR
from numpy.typing import NDArray

from civil_rgbd.errors import FormatError
from civil_rgbd.format.exr_file import write_exr
from civil_rgbd.format.exr_layout import chunk_fault, depth_fault, read_layout
from civil_rgbd.format.hashes import float_fault
from civil_rgbd.storage.places import Place

CHANNEL: Final = "Z"
_REBUILD: Final = (
    "build the bridge again, or download the file again; `civil-rgbd validate` lists every damage"
)


def value_fault(depth_m: NDArray[np.float32]) -> str | None:
    """Say in words which depths cannot be stored: NaN, Inf, -0.0, negative; None for none."""
    fault = float_fault(depth_m)
    if fault:
        return fault
    if depth_m.size and float(depth_m.min()) < 0:
        return f"{int((depth_m < 0).sum())} depths are negative, the smallest {depth_m.min()!r} m"
    return None


def write_depth(path: Place, depth_m: NDArray[np.float32], *, sync: bool = True) -> bytes:
    """Write a depth image: whole or not at all; the same array gives the same bytes.

    Args:
        path: the file to make; its folder exists.
        depth_m: (H, W) float32, metres along the optical axis, 0 = nothing measured.
        sync: bring it to the disk now; without it the caller syncs later.

    Returns:
        the file's bytes.

    Raises:
        ValueError: the array is no depth image.
        OutputError: the file cannot be written.
    """
    if depth_m.dtype != np.float32 or depth_m.ndim != 2 or not depth_m.size:
        raise ValueError(f"depth is {depth_m.dtype} {depth_m.shape}, not float32 (H, W)")
    fault = value_fault(depth_m)
    if fault:
        raise ValueError(fault)
    return write_exr(path, {CHANNEL: depth_m}, what="depth", sync=sync)


def read_depth(path: Place, *, size: tuple[int, int] | None = None) -> NDArray[np.float32]:
    """Read a depth image.

    Args:
        path: the EXR file: one part, flat, one channel ``Z`` of float32, lossless, the data window
            from (0, 0) and equal to the display window.
        size: the height and width that it must have; None for any.

    Returns:
        (H, W) float32, metres along the optical axis, 0 = nothing measured; finite, not negative.

    Raises:
        FormatError: the file is missing, damaged, or something else.
    """
    depth_m = decode_depth(path, read_bytes(path), size=size)
    # Two reductions instead of value_fault: NaN and Inf show in them, and loading stays fast.
    if not (depth_m.min() >= 0 and depth_m.max() < np.inf):
        raise FormatError(f"{value_fault(depth_m)}", where=path, fix=_REBUILD)
    return depth_m


def read_bytes(path: Place) -> bytes:
    """Read a whole file of a bridge.

    Raises:
        FormatError: it is missing or cannot be read.
    """
    try:
        return path.read_bytes()
    except FileNotFoundError as error:
        raise FormatError("the file is missing", where=path, fix=_REBUILD) from error
    except OSError as error:
        raise FormatError(
            f"the file cannot be read: {error.strerror}", where=path, fix=_REBUILD
        ) from error


def decode_depth(
    path: Place, data: bytes, *, size: tuple[int, int] | None = None
) -> NDArray[np.float32]:
    """Decode a depth image whose bytes are known already; values are not looked at.

    Args:
        path: the file; OpenEXR before 3.5 reads from paths only.
        data: its bytes.
        size: the height and width that it must have; None for any.

    Returns:
        (H, W) float32.

    Raises:
        FormatError: it is no depth image, or a damaged one.
    """
    try:
        layout = read_layout(data)
        fault = depth_fault(layout)
    except ValueError as error:
        fault = str(error)
    else:
        if fault is None and size is not None and layout.size != size:
            fault = (
                f"it is {layout.size[1]} x {layout.size[0]} pixels; the camera has "
                f"{size[1]} x {size[0]}"
            )
        fault = fault or chunk_fault(data, layout)
    if fault:
        raise FormatError(f"this is not a whole depth image: {fault}", where=path, fix=_REBUILD)
    if isinstance(path, Path):
        return _decode(path, path, layout.size)
    with tempfile.TemporaryDirectory(prefix="civil_rgbd_") as folder:
        copy = Path(folder) / path.name
        copy.write_bytes(data)
        return _decode(copy, path, layout.size)


def _decode(file: Path, path: Place, size: tuple[int, int]) -> NDArray[np.float32]:
    try:
        image = OpenEXR.File(str(file), separate_channels=True)
        pixels: NDArray[np.float32] = np.asarray(image.parts[0].channels[CHANNEL].pixels)
    except (RuntimeError, OSError, ValueError, TypeError, KeyError, IndexError) as error:
        raise FormatError(
            "this is not a whole depth image: its pixels cannot be unpacked",
            where=path,
            fix=_REBUILD,
        ) from error
    if pixels.shape != size or pixels.dtype != np.float32:
        raise FormatError(
            f"OpenEXR reads it as {pixels.dtype} {pixels.shape}, its header says float32 {size}",
            where=path,
            fix=_REBUILD,
        )
    return pixels
