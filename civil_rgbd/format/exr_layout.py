"""What an EXR file says about itself, read before any library is trusted with its pixels.

The OpenEXR package reports a damaged file as one without parts, allocates whatever the header asks
for, and prints. This module reads header and chunk table itself, so that a depth file is accepted
or refused in words. Layout: "OpenEXR File Layout", openexr.com.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

_MAGIC: Final = b"v/1\x01"
_TILED, _DEEP, _MULTIPART = 0x200, 0x800, 0x1000
_PIXEL_TYPES: Final = {0: "uint32", 1: "half", 2: "float32"}
_COMPRESSIONS: Final = (
    *("none", "RLE", "ZIPS", "ZIP", "PIZ", "PXR24", "B44", "B44A", "DWAA", "DWAB"),
)
_LINES_PER_CHUNK: Final = {"none": 1, "RLE": 1, "ZIPS": 1, "ZIP": 16, "PIZ": 32}
"""The lossless compressions, and how many lines of a scanline file they pack together."""
_MAX_PIXELS: Final = 1 << 28  # 1 GiB of float32: beyond any camera, below most memories
_MAX_NAME_BYTES: Final = 255


@dataclass(frozen=True, slots=True)
class Channel:
    """One channel: its name, ``half``, ``float32`` or ``uint32``, and whether it is full size."""

    name: str
    pixel_type: str
    full_size: bool


@dataclass(frozen=True, slots=True)
class ExrLayout:
    """What the header says.

    Attributes:
        channels: in the file's order.
        compression: a name such as ``ZIP``; ``number 11`` for one that is not known here.
        data_window: x and y of the first and of the last stored pixel.
        display_window: same, of the image.
        tile_px: width and height of a tile; None in a scanline file.
        tile_levels: 0 for one level, else mip or rip maps.
        end: where the header ends and the chunk table begins, bytes.
    """

    channels: tuple[Channel, ...]
    compression: str
    data_window: tuple[int, int, int, int]
    display_window: tuple[int, int, int, int]
    tile_px: tuple[int, int] | None
    tile_levels: int
    end: int

    @property
    def size(self) -> tuple[int, int]:
        """Height and width in pixels."""
        left, top, right, bottom = self.data_window
        return bottom - top + 1, right - left + 1


def read_layout(data: bytes) -> ExrLayout:
    """Read the header of a single-part, flat EXR file.

    Raises:
        ValueError: it is no such file; the message says why.
    """
    if not data:
        raise ValueError("the file is empty")
    if data[:4] != _MAGIC:
        raise ValueError(f"this is no EXR file: it begins with {data[:4]!r}")
    if len(data) < 8:
        raise ValueError("the file ends inside its header")
    version = int.from_bytes(data[4:8], "little")
    if version & 0xFF != 2:
        raise ValueError(f"it is EXR version {version & 0xFF}, not 2")
    if version & _MULTIPART:
        raise ValueError("it has several parts; depth has one")
    if version & _DEEP:
        raise ValueError("it is a deep image; depth is flat")
    try:
        attributes, end = _attributes(data)
        return _layout(attributes, end, tiled=bool(version & _TILED))
    except KeyError as error:
        raise ValueError(f"its header lacks {error.args[0]!r}") from error
    except (struct.error, IndexError, UnicodeDecodeError) as error:
        raise ValueError("its header is damaged or cut") from error


def _layout(attributes: dict[str, bytes], end: int, *, tiled: bool) -> ExrLayout:
    tile_px, levels = None, 0
    if tiled:
        columns, rows, mode = struct.unpack("<IIB", attributes["tiles"])
        tile_px, levels = (columns, rows), mode & 0x0F
    number = attributes["compression"][0]
    known = number < len(_COMPRESSIONS)
    return ExrLayout(
        channels=tuple(_channels(attributes["channels"])),
        compression=_COMPRESSIONS[number] if known else f"number {number}",
        data_window=struct.unpack("<4i", attributes["dataWindow"]),
        display_window=struct.unpack("<4i", attributes["displayWindow"]),
        tile_px=tile_px,
        tile_levels=levels,
        end=end,
    )


def _attributes(data: bytes) -> tuple[dict[str, bytes], int]:
    found: dict[str, bytes] = {}
    at = 8
    while data[at]:
        name, at = _name(data, at)
        _, at = _name(data, at)  # the attribute's type: fixed by its name for those that we need
        (size,) = struct.unpack_from("<i", data, at)
        at += 4
        if size < 0 or at + size >= len(data):
            raise ValueError("its header is damaged or cut")
        found[name] = data[at : at + size]
        at += size
    return found, at + 1


def _name(data: bytes, at: int) -> tuple[str, int]:
    end = data.find(b"\0", at, at + _MAX_NAME_BYTES + 1)
    if end < 0:
        raise ValueError("its header is damaged or cut")
    return data[at:end].decode("utf-8"), end + 1


def _channels(value: bytes) -> Iterator[Channel]:
    at = 0
    while value[at]:
        name, at = _name(value, at)
        pixel_type, _, x_step, y_step = struct.unpack_from("<iIii", value, at)
        at += 16
        yield Channel(
            name, _PIXEL_TYPES.get(pixel_type, f"type {pixel_type}"), (x_step, y_step) == (1, 1)
        )


def depth_fault(layout: ExrLayout) -> str | None:
    """Say in words why a file with this header is no depth image; None when it is one."""
    names = [channel.name for channel in layout.channels]
    if names != ["Z"]:
        return f"it has channels {', '.join(names) or 'none'}; depth has one, Z"
    channel = layout.channels[0]
    if channel.pixel_type != "float32":
        return f"channel Z is {channel.pixel_type}; depth is float32"
    if not channel.full_size:
        return "channel Z is subsampled"
    return window_fault(layout)


def window_fault(layout: ExrLayout) -> str | None:
    """Say in words why this is no lossless image from (0, 0) on; None when it is one."""
    window, (height, width) = layout.data_window, layout.size
    faults = (
        (
            min(height, width) < 1 or height * width > _MAX_PIXELS,
            f"its data window {window} is {width} x {height} pixels",
        ),
        (
            window != layout.display_window or window[:2] != (0, 0),
            f"data window {window}, display window {layout.display_window}: not one from (0, 0)",
        ),
        (
            layout.compression not in _LINES_PER_CHUNK,
            f"its compression {layout.compression} is not lossless, or not known here",
        ),
        (
            layout.tile_px is not None and (layout.tile_levels > 0 or min(layout.tile_px) < 1),
            "it is tiled in several levels",
        ),
    )
    return next((words for holds, words in faults if holds), None)


def chunk_fault(data: bytes, layout: ExrLayout) -> str | None:
    """Say in words which chunk of a depth image is missing or cut; None when all are there.

    Args:
        data: the whole file.
        layout: its header, without a :func:`depth_fault`.
    """
    leaders = _chunk_leaders(layout)
    table_end = layout.end + 8 * len(leaders)
    if table_end > len(data):
        return "the file ends inside its chunk table"
    offsets = struct.unpack_from(f"<{len(leaders)}Q", data, layout.end)
    for number, (offset, leader) in enumerate(zip(offsets, leaders, strict=True)):
        fault = _one_chunk_fault(data, offset, leader)
        if offset < table_end:  # 0 in a file whose writer was killed
            fault = "was never written"
        if fault:
            return f"chunk {number + 1} of {len(leaders)} {fault}"
    return None


def _one_chunk_fault(data: bytes, offset: int, leader: bytes) -> str | None:
    payload = offset + len(leader) + 4
    if payload > len(data):
        return "lies behind the file's end"
    if data[offset : offset + len(leader)] != leader:
        return "is not where the chunk table says"
    (size,) = struct.unpack_from("<i", data, payload - 4)
    if size < 1 or payload + size > len(data):
        return "is cut off by the file's end"
    return None


def _chunk_leaders(layout: ExrLayout) -> list[bytes]:
    """The coordinates that each chunk begins with, in the order of the chunk table."""
    height, width = layout.size
    if layout.tile_px is None:
        step = _LINES_PER_CHUNK[layout.compression]
        return [struct.pack("<i", y) for y in range(0, height, step)]
    columns, rows = layout.tile_px
    return [
        struct.pack("<4i", x, y, 0, 0)
        for y in range(-(-height // rows))
        for x in range(-(-width // columns))
    ]
