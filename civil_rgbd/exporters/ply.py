"""One coloured point cloud as binary PLY: x y z as doubles, for map coordinates may be large."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from civil_rgbd.exporters.points import points_of
from civil_rgbd.exporters.report import ExportOptions, Losses
from civil_rgbd.exporters.selection import Chosen

_VERTEX: Final = np.dtype(
    [*((axis, "<f8") for axis in "xyz"), *((name, "u1") for name in ("red", "green", "blue"))]
)
_COUNT_WIDTH: Final = 20


def write(folder: Path, one: Chosen, options: ExportOptions) -> Losses:
    """Write the points of one bridge to ``points.ply``.

    Returns:
        what is lost.

    Raises:
        FormatError: a frame is damaged.
        UsageError: the cubes are too small for the bridge's extent.
    """
    folder.mkdir(parents=True, exist_ok=True)
    count = 0
    with (folder / "points.ply").open("wb") as stream:
        stream.write(_header(0))
        for part in points_of(one, options):
            vertices = np.empty(len(part.points_map), dtype=_VERTEX)
            for place, axis in enumerate("xyz"):
                vertices[axis] = part.points_map[:, place]
            for place, name in enumerate(("red", "green", "blue")):
                vertices[name] = part.rgb[:, place]
            stream.write(vertices.tobytes())
            count += len(vertices)
        stream.seek(0)
        stream.write(_header(count))  # as long as the first: the count is known only now
    return Losses([words(options, count), "images, poses and stamps have no place"])


def words(options: ExportOptions, count: int) -> str:
    """Say which points a cloud has, and which not."""
    if options.voxel_m is None:
        return f"no point: all {count} measured pixels are there, surfaces seen twice are so twice"
    return f"points but the mean of each cube of {options.voxel_m:g} m: {count} are left"


def _header(count: int) -> bytes:
    pad = "." * (_COUNT_WIDTH - len(str(count)))
    kinds = {"<f8": "double", "|u1": "uchar"}
    properties = [f"property {kinds[_VERTEX[name].str]} {name}" for name in _VERTEX.names or ()]
    lines = [
        "ply",
        "format binary_little_endian 1.0",
        f"comment metres, map frame {pad}",
        f"element vertex {count}",
        *properties,
        "end_header",
    ]
    return ("\n".join(lines) + "\n").encode("ascii")
