"""Quality planes: EXR, one channel a plane, half floats, lossless."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Final

import numpy as np
import OpenEXR
from numpy.typing import NDArray

from civil_rgbd.errors import FormatError
from civil_rgbd.format.depth_exr import read_bytes
from civil_rgbd.format.exr_file import write_exr
from civil_rgbd.format.exr_layout import chunk_fault, read_layout, window_fault
from civil_rgbd.format.hashes import float_fault, pixel_sha256
from civil_rgbd.storage.places import Place

Planes = Mapping[str, NDArray[np.float16]]

_REBUILD: Final = (
    "build the bridge again, or download the file again; `civil-rgbd validate` lists every damage"
)


def write_quality(path: Place, planes: Planes, *, sync: bool = True) -> bytes:
    """Write the quality planes of a frame: whole or not at all.

    Args:
        path: the file to make; its folder exists.
        planes: (H, W) float16 each, by name; at least one.
        sync: bring it to the disk now; without it the caller syncs later.

    Returns:
        the file's bytes; the same planes give the same bytes.

    Raises:
        ValueError: the planes differ in size, or hold NaN, Inf or -0.0.
        OutputError: the file cannot be written.
    """
    sizes = {plane.shape for plane in planes.values()}
    kinds = {plane.dtype for plane in planes.values()}
    if len(sizes) != 1 or kinds != {np.dtype(np.float16)}:
        raise ValueError(f"quality planes are {sorted(map(str, kinds))} of {sorted(sizes)}")
    for name, plane in planes.items():
        if fault := float_fault(plane):
            raise ValueError(f"quality plane {name!r}: {fault}")
    return write_exr(path, planes, what="quality planes", sync=sync)


def read_quality(path: Place, *, size: tuple[int, int] | None = None) -> Planes:
    """Read the quality planes of a frame.

    Args:
        path: the EXR file: one part, flat, half floats, lossless, the data window from (0, 0) and
            equal to the display window.
        size: the height and width that it must have; None for any.

    Returns:
        (H, W) float16 each, by name, in the order of their names.

    Raises:
        FormatError: the file is missing, damaged, or something else.
    """
    return decode_quality(path, read_bytes(path), size=size)


def decode_quality(path: Place, data: bytes, *, size: tuple[int, int] | None = None) -> Planes:
    """Decode quality planes whose bytes are known already.

    Args:
        path: the file; OpenEXR before 3.5 reads from paths only.
        data: its bytes.
        size: the height and width that it must have; None for any.

    Raises:
        FormatError: it holds no quality planes, or it is damaged.
    """
    fault = _fault(data, size)
    if fault:
        raise FormatError(f"these are not whole quality planes: {fault}", where=path, fix=_REBUILD)
    if isinstance(path, Path):
        return _decode(path, path)
    with tempfile.TemporaryDirectory(prefix="civil_rgbd_") as folder:
        copy = Path(folder) / path.name
        copy.write_bytes(data)
        return _decode(copy, path)


def _fault(data: bytes, size: tuple[int, int] | None) -> str | None:
    try:
        layout = read_layout(data)
    except ValueError as error:
        return str(error)
    for channel in layout.channels:
        if channel.pixel_type != "half" or not channel.full_size:
            return f"channel {channel.name} is {channel.pixel_type}; planes are half, full size"
    if not layout.channels:
        return "it has no channels"
    fault = window_fault(layout)
    if fault is None and size is not None and layout.size != size:
        fault = (
            f"it is {layout.size[1]} x {layout.size[0]} pixels; the camera has "
            f"{size[1]} x {size[0]}"
        )
    return fault or chunk_fault(data, layout)


def _decode(file: Path, path: Place) -> Planes:
    try:
        image = OpenEXR.File(str(file), separate_channels=True)
        channels = image.parts[0].channels
        return {name: np.asarray(channels[name].pixels) for name in sorted(channels)}
    except (RuntimeError, OSError, ValueError, TypeError, KeyError, IndexError) as error:
        raise FormatError(
            "these are not whole quality planes: their pixels cannot be unpacked",
            where=path,
            fix=_REBUILD,
        ) from error


def quality_sha256(planes: Planes) -> str:
    """Return the pixel hash of quality planes: of (C, H, W), stacked in the order of their names.

    Raises:
        ValueError: a value is NaN, Inf or -0.0.
    """
    return pixel_sha256(np.stack([planes[name] for name in sorted(planes)]))
