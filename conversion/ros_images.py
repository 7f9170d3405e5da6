"""sensor_msgs/Image and CompressedImage to RGB pixels."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from civil_rgbd.conversion.cdr import CdrError, CdrReader
from civil_rgbd.errors import ImageDecodeError, RecordingError

_Pixels = NDArray[np.uint8]

_JPEG, _PNG = b"\xff\xd8\xff", b"\x89PNG\r\n\x1a\n"
_JPEG_END = b"\xff\xd9"
_END_WITHIN_BYTES = 4096  # cameras pad behind the end marker; coded pixels never hold it
_PNG_DEPTH_AT = 24  # in IHDR, right after the signature, its length, its name and the size
_DECODE: Final = cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION
_SMALL: Final = {
    1: cv2.IMREAD_GRAYSCALE,
    2: cv2.IMREAD_REDUCED_GRAYSCALE_2,
    4: cv2.IMREAD_REDUCED_GRAYSCALE_4,
    8: cv2.IMREAD_REDUCED_GRAYSCALE_8,
}
"""How OpenCV is asked for a grey image that is smaller by so much."""


def _mono(raw: _Pixels) -> _Pixels:
    return np.repeat(raw, 3, axis=2)


def _swapped(raw: _Pixels) -> _Pixels:
    to_rgb = cv2.COLOR_BGR2RGB if raw.shape[2] == 3 else cv2.COLOR_BGRA2RGB
    return np.asarray(cv2.cvtColor(raw, to_rgb), dtype=np.uint8)  # ten times faster than [::-1]


def _yuyv(raw: _Pixels) -> _Pixels:
    return np.asarray(cv2.cvtColor(raw, cv2.COLOR_YUV2RGB_YUY2), dtype=np.uint8)


def _uyvy(raw: _Pixels) -> _Pixels:
    return np.asarray(cv2.cvtColor(raw, cv2.COLOR_YUV2RGB_UYVY), dtype=np.uint8)


def _first_three(raw: _Pixels) -> _Pixels:
    return np.ascontiguousarray(raw[:, :, :3])


ENCODINGS: Final[dict[str, tuple[int, Callable[[_Pixels], _Pixels]]]] = {
    "rgb8": (3, _first_three),
    "bgr8": (3, _swapped),
    "rgba8": (4, _first_three),
    "bgra8": (4, _swapped),
    "mono8": (1, _mono),
    "yuyv": (2, _yuyv),
    "yuv422_yuy2": (2, _yuyv),
    "yuv422": (2, _uyvy),
    "uyvy": (2, _uyvy),
}
"""Bytes a pixel and the way to RGB of each encoding that is read (sensor_msgs/image_encodings)."""


@dataclass(frozen=True, slots=True)
class ImageHead:
    """What an image message says before its pixels.

    Attributes:
        stamp_ns: header stamp.
        frame: header frame id.
        encoding: of an Image its encoding, of a CompressedImage its format.
    """

    stamp_ns: int
    frame: str
    encoding: str


def read_head(start: bytes, *, compressed: bool, read: type[CdrReader] = CdrReader) -> ImageHead:
    """Read what stands before the pixels.

    Args:
        start: the first bytes of a message.
        compressed: it is a CompressedImage.
        read: reads its encoding.

    Raises:
        CdrError: there are too few of them.
    """
    reader = read(start)
    stamp_ns, frame = reader.header()
    if not compressed:
        reader.uint32(), reader.uint32()
    return ImageHead(stamp_ns, frame, reader.text())


def is_photograph(start: bytes, *, compressed: bool, read: type[CdrReader] = CdrReader) -> bool:
    """Tell whether a topic can hold photographs: depth images share their message types.

    Args:
        start: the first bytes of its first message.
        compressed: it is a CompressedImage.
        read: reads its encoding.
    """
    try:
        encoding = read_head(start, compressed=compressed, read=read).encoding
    except CdrError:
        return True  # its own error is better than saying that there are no images
    return not any(word in encoding for word in ("16UC1", "32FC1", "compressedDepth", "mono16"))


def rgb_from_image(
    payload: memoryview, *, where: object, read: type[CdrReader] = CdrReader
) -> _Pixels:
    """Decode one ``sensor_msgs/Image``.

    Args:
        payload: the message.
        where: file, topic and image, for errors.
        read: reads its encoding.

    Returns:
        (H, W, 3) uint8.

    Raises:
        RecordingError: its encoding is not read.
        ImageDecodeError: its sizes lie.
        CdrError: it breaks its layout.
    """
    reader = read(payload)
    reader.header()
    height, width, encoding = reader.uint32(), reader.uint32(), reader.text()
    reader.uint8()  # is_bigendian: every encoding here has one byte a value
    step, data = reader.uint32(), reader.octets()
    if encoding not in ENCODINGS:
        raise _not_read(encoding, where)
    channels, to_rgb = ENCODINGS[encoding]
    row = width * channels
    needed = step * (height - 1) + row
    if not height or not width or step < row or not needed <= len(data) <= step * height:
        raise _broken(
            f"{width} x {height} pixels of {encoding!r} with rows of {step} bytes do not fit "
            f"{len(data)} bytes of data",
            where,
        )
    if channels == 2 and width % 2:
        raise _broken(f"{encoding!r} with an odd width of {width}", where)
    view: _Pixels = np.ndarray(
        (height, width, channels), np.uint8, data, strides=(step, channels, 1)
    )
    return to_rgb(np.ascontiguousarray(view))


def rgb_from_compressed(
    payload: memoryview, *, where: object, read: type[CdrReader] = CdrReader
) -> _Pixels:
    """Decode one ``sensor_msgs/CompressedImage``: JPEG or PNG, told by its content.

    Args:
        payload: the message.
        where: file, topic and image, for errors.
        read: reads its encoding.

    Returns:
        (H, W, 3) uint8.

    Raises:
        RecordingError: it is of another codec, or has 16 bits a channel.
        ImageDecodeError: it cannot be decoded.
        CdrError: it breaks its layout.
    """
    reader = read(payload)
    reader.header()
    name, data = reader.text(), reader.octets()
    return rgb_from_encoded(data, name, where=where)


def rgb_from_encoded(data: memoryview, name: str, *, where: object) -> _Pixels:
    """Decode a JPEG or PNG, told by its content.

    EXIF orientation is ignored: the camera model speaks of the pixels as stored.

    Args:
        data: the file's bytes.
        name: the format as a message names it; may be empty.
        where: file and image, for errors.

    Returns:
        (H, W, 3) uint8.

    Raises:
        RecordingError: it is of another codec, or has 16 bits a channel.
        ImageDecodeError: it cannot be decoded.
    """
    pixels = _decoded(data, name, _DECODE, where)
    return pixels if _stored_as_rgb(name) else _swapped(pixels)


def small_grey_from_compressed(
    payload: memoryview, reduction: int, *, where: object, read: type[CdrReader] = CdrReader
) -> _Pixels:
    """Decode one ``sensor_msgs/CompressedImage`` grey, and a JPEG small at once.

    Args:
        payload: the message.
        reduction: key of :data:`_SMALL`.
        where: file, topic and image, for errors.
        read: reads its encoding.

    Returns:
        (H, W) uint8, height and width divided and rounded up; errors as
        :func:`rgb_from_compressed`.
    """
    reader = read(payload)
    reader.header()
    name, data = reader.text(), reader.octets()
    return _decoded(data, name, _SMALL[reduction] | cv2.IMREAD_IGNORE_ORIENTATION, where)


def shrunk(rgb: _Pixels, reduction: int) -> _Pixels:
    """Make a decoded image small and grey: (H, W, 3) to (H / reduction, W / reduction)."""
    grey = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY)
    size = (-(-grey.shape[1] // reduction), -(-grey.shape[0] // reduction))
    return np.asarray(cv2.resize(grey, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def _decoded(data: memoryview, name: str, flags: int, where: object) -> _Pixels:
    start = bytes(data[: _PNG_DEPTH_AT + 1])
    if start.startswith(_PNG):
        if start[_PNG_DEPTH_AT:] == b"\x10":
            raise _not_read("16-bit PNG", where)
    elif start.startswith(_JPEG):
        if bytes(data[-_END_WITHIN_BYTES:]).rfind(_JPEG_END) < 0:
            raise _broken("a JPEG without its end marker: it is cut", where)
    elif any(word in name.lower() for word in ("jpeg", "jpg", "png")) or not name:
        raise _broken(f"format is {name!r}, but the data is neither JPEG nor PNG", where)
    else:
        raise _not_read(name, where)
    try:
        pixels = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), flags)
    except cv2.error as error:
        raise _broken(f"{name!r}: {error}", where) from error
    if pixels is None:
        raise _broken(f"{len(data)} bytes of {name!r}", where)
    return np.asarray(pixels, dtype=np.uint8)


def _stored_as_rgb(name: str) -> bool:
    """Tell whether red and blue were swapped before compression.

    ROS's compressed_image_transport writes ``rgb8; jpeg compressed bgr8``: camera encoding, then
    the order in which OpenCV was given the pixels. OpenCV expects BGR; given RGB, the file holds
    red for blue, and ROS's own subscriber swaps them back.
    """
    return "compressed rgb" in name.partition(";")[2]


def _not_read(name: str, where: object) -> RecordingError:
    return RecordingError(
        f"images are encoded as {name!r}, which is not read",
        where=where,
        fix=f"convert them to JPEG, 8-bit PNG or one of {', '.join(ENCODINGS)}; "
        "or choose another topic with --image-topic",
    )


def _broken(what: str, where: object) -> ImageDecodeError:
    return ImageDecodeError(
        f"an image cannot be decoded: {what}",
        where=where,
        fix="the build counts it and goes on; record again if there are many",
    )
