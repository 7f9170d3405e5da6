"""Colour images: JPEG or PNG."""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from civil_rgbd.errors import FormatError
from civil_rgbd.storage.places import Place

SUBSAMPLINGS: Final = {
    "4:4:4": cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444,
    "4:2:2": cv2.IMWRITE_JPEG_SAMPLING_FACTOR_422,
    "4:2:0": cv2.IMWRITE_JPEG_SAMPLING_FACTOR_420,
}
"""Chroma subsamplings of JPEG."""

_PNG_COMPRESSION: Final = 3  # higher levels cost far more time than they save space
_FIX: Final = (
    "build the bridge again, or download the file again; `civil-rgbd validate` lists every damage"
)


def encode_image(
    rgb: NDArray[np.uint8], *, codec: str, quality: int = 95, subsampling: str = "4:4:4"
) -> bytes:
    """Pack an image.

    Args:
        rgb: (H, W, 3) uint8, red first.
        codec: ``jpeg`` or ``png``.
        quality: of JPEG, 1 to 100.
        subsampling: of JPEG, a key of :data:`SUBSAMPLINGS`.

    Returns:
        the file's bytes; the same pixels give the same bytes.

    Raises:
        ValueError: the array, the codec or the subsampling is none of these.
    """
    if rgb.dtype != np.uint8 or rgb.ndim != 3 or rgb.shape[2] != 3 or not rgb.size:
        raise ValueError(f"an image is {rgb.dtype} {rgb.shape}, not uint8 (H, W, 3)")
    if codec == "jpeg":
        if subsampling not in SUBSAMPLINGS:
            raise ValueError(f"subsampling {subsampling!r} is none of {', '.join(SUBSAMPLINGS)}")
        options = [cv2.IMWRITE_JPEG_QUALITY, quality]
        options += [cv2.IMWRITE_JPEG_SAMPLING_FACTOR, SUBSAMPLINGS[subsampling]]
        suffix = ".jpg"
    elif codec == "png":
        options, suffix = [cv2.IMWRITE_PNG_COMPRESSION, _PNG_COMPRESSION], ".png"
    else:
        raise ValueError(f"codec {codec!r} is neither jpeg nor png")
    done, data = cv2.imencode(suffix, cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR), options)
    if not done:
        raise ValueError(f"OpenCV cannot pack an image of {rgb.shape} as {codec}")
    packed: bytes = data.tobytes()
    return packed


def decode_image(data: bytes, *, where: object) -> NDArray[np.uint8]:
    """Unpack an image; EXIF orientation is ignored.

    Args:
        data: bytes of a JPEG or PNG file.
        where: the file, for the message.

    Returns:
        (H, W, 3) uint8, red first.

    Raises:
        FormatError: it is neither, or it is cut.
    """
    fault = _fault(data)
    if fault is None:
        flags = cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION
        try:
            bgr = cv2.imdecode(np.frombuffer(data, np.uint8), flags)
        except cv2.error:
            bgr = None
        if bgr is not None:
            rgb: NDArray[np.uint8] = cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB)
            return rgb
        fault = "it cannot be unpacked"
    raise FormatError(f"this is not a whole image: {fault}", where=where, fix=_FIX)


def _fault(data: bytes) -> str | None:
    """Say why data is no whole image: OpenCV fills what a cut JPEG lacks with grey, silently."""
    if not data:
        return "the file is empty"
    if data.startswith(b"\xff\xd8\xff"):
        # Neither marker occurs inside packed pixels; an embedded thumbnail comes before them.
        whole = data.rfind(b"\xff\xd9") > data.rfind(b"\xff\xda") > 0
        return None if whole else "the JPEG ends before its end marker"
    if data.startswith(b"\x89PNG\r\n\x1a\n"):
        return None if b"IEND\xaeB`\x82" in data else "the PNG ends before its last chunk"
    return f"it is neither JPEG nor PNG but begins with {data[:4]!r}"


def read_image(path: Place) -> NDArray[np.uint8]:
    """Read an image file: (H, W, 3) uint8, red first.

    Raises:
        FormatError: it is missing, damaged, or neither JPEG nor PNG.
    """
    try:
        data = path.read_bytes()
    except FileNotFoundError as error:
        raise FormatError("the file is missing", where=path, fix=_FIX) from error
    except OSError as error:
        raise FormatError(
            f"the file cannot be read: {error.strerror}", where=path, fix=_FIX
        ) from error
    return decode_image(data, where=path)
