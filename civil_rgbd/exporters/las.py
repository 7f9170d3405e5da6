"""One coloured point cloud as LAS 1.4, point format 7, steps of 0.1 mm."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np

from civil_rgbd.errors import MissingExtraError
from civil_rgbd.exporters.ply import words
from civil_rgbd.exporters.points import ColouredPoints, points_of
from civil_rgbd.exporters.report import ExportOptions, Losses
from civil_rgbd.exporters.selection import Chosen

STEP_M: Final = 1e-4
"""LAS stores whole steps; with this one a cloud may reach 214 km."""

_TO_16_BITS: Final = 257  # 255 becomes 65535


def write(folder: Path, one: Chosen, options: ExportOptions) -> Losses:
    """Write the points of one bridge to ``points.las``.

    Returns:
        what is lost.

    Raises:
        MissingExtraError: laspy is not installed.
        FormatError: a frame is damaged.
        UsageError: the cubes are too small for the bridge's extent.
    """
    laspy = _laspy()
    folder.mkdir(parents=True, exist_ok=True)
    first = one.rows[0]
    header = laspy.LasHeader(point_format=7, version="1.4")
    header.offsets = np.floor([first.tx, first.ty, first.tz])
    header.scales = np.full(3, STEP_M)
    count = 0
    with laspy.open(folder / "points.las", mode="w", header=header) as writer:
        for part in points_of(one, options):
            writer.write_points(_record(laspy, header, part))
            count += len(part.points_map)
    return Losses(
        [
            words(options, count),
            f"positions are rounded to {1000 * STEP_M:g} mm",
            "images, poses and stamps have no place; the map has no geodetic reference",
        ]
    )


def _record(laspy: Any, header: Any, part: ColouredPoints) -> Any:  # noqa: ANN401  # laspy ships no types
    record = laspy.ScaleAwarePointRecord.zeros(len(part.points_map), header=header)
    record.x, record.y, record.z = part.points_map.T
    red, green, blue = part.rgb.T.astype(np.uint16) * _TO_16_BITS
    record.red, record.green, record.blue = red, green, blue
    return record


def _laspy() -> Any:  # noqa: ANN401  # laspy ships no types
    try:
        import laspy
    except ImportError as error:
        raise MissingExtraError(
            "LAS files need laspy, which is not installed",
            where="--to las",
            fix='pip install "civil-rgbd[las]", or take --to ply',
        ) from error
    return laspy
