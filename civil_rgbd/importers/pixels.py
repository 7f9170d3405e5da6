"""The images of a foreign set, decoded: whole or refused."""

from __future__ import annotations

import zlib
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from civil_rgbd.errors import FormatError, RecordingError
from civil_rgbd.format.images import decode_image

SATURATED: Final = 65535
"""The largest 16-bit number: what lies beyond was cut off here, so it is no measurement."""

_PNG: Final = b"\x89PNG\r\n\x1a\n"


def read_colour(path: Path) -> NDArray[np.uint8]:
    """Read a colour image: (H, W, 3) uint8, red first; grey becomes three equal channels.

    Raises:
        RecordingError: it is missing, cut or damaged.
    """
    data = _read(path)
    if data.startswith((b"\xff\xd8\xff", _PNG)):
        fault = png_fault(data)
        try:
            if fault is None:
                return decode_image(data, where=path)
        except FormatError as error:
            fault = error.what
        raise _damaged(path, fault)
    pixels = _decode(data, cv2.IMREAD_COLOR)
    if pixels is None:
        raise _damaged(path, "it cannot be unpacked")
    rgb: NDArray[np.uint8] = cv2.cvtColor(pixels, cv2.COLOR_BGR2RGB)
    return rgb


def read_raw_depth(path: Path) -> NDArray[np.uint16]:
    """Read a depth image: (H, W) uint16, in the set's own units, 0 = nothing measured.

    Raises:
        RecordingError: it is missing, cut, damaged, or has no 16 bits in one channel.
    """
    data = _read(path)
    fault = png_fault(data)
    pixels = None if fault else _decode(data, cv2.IMREAD_UNCHANGED)
    if pixels is None:
        raise _damaged(path, fault or "it cannot be unpacked")
    if pixels.dtype != np.uint16 or pixels.ndim != 2:
        raise RecordingError(
            f"this depth image is {pixels.dtype} of shape {pixels.shape}, not 16 bits in one "
            "channel",
            where=path,
            fix="give the depth as measured, not a picture of it",
        )
    raw: NDArray[np.uint16] = pixels
    return raw


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise _damaged(path, error.strerror or str(error)) from error


def _decode(data: bytes, flags: int) -> NDArray[Any] | None:
    try:
        return cv2.imdecode(np.frombuffer(data, np.uint8), flags | cv2.IMREAD_IGNORE_ORIENTATION)
    except cv2.error:
        return None


def _damaged(path: Path, fault: str) -> RecordingError:
    return RecordingError(
        f"this is not a whole image: {fault}",
        where=path,
        fix="fetch the file again, or take it out of the set",
    )


def png_fault(data: bytes) -> str | None:
    """Say why a PNG is not whole, by its chunks' lengths and CRCs; None for whole or no PNG.

    Decoders fill what a cut file lacks with zeros, which in depth means "nothing measured".
    """
    if not data.startswith(_PNG):
        return None if data else "the file is empty"
    at = len(_PNG)
    while at + 12 <= len(data):
        length = int.from_bytes(data[at : at + 4], "big")
        end = at + 12 + length
        if end > len(data):
            break
        if zlib.crc32(data[at + 4 : end - 4]) != int.from_bytes(data[end - 4 : end], "big"):
            return f"the PNG's chunk at byte {at} does not match its CRC"
        if data[at + 4 : at + 8] == b"IEND":
            return None
        at = end
    return "the PNG ends before its last chunk"
