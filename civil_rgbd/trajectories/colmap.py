"""COLMAP's ``images.txt``: two lines an image, camera from world, neither stamps nor scale.

``IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME``, then the image's points, which are not read.
"""

from __future__ import annotations

import numpy as np

from civil_rgbd.errors import RecordingError, UsageError
from civil_rgbd.geometry.transforms import rotate, unit_quaternion
from civil_rgbd.trajectories.pose_table import (
    NORM_TOLERANCE,
    Beside,
    Poses,
    PoseTable,
    broken_line,
)

_NAME_AT = 9
_LINES_AN_IMAGE = 2


def looks_like_colmap(table: PoseTable) -> bool:
    """Tell by the first row: ids, numbers, and a name in the tenth column."""
    cells = table.rows[0].cells
    if len(cells) <= _NAME_AT or table.commas:
        return False
    return cells[0].isdecimal() and cells[8].isdecimal() and "." in cells[-1][1:]  # a suffix


def read_colmap(table: PoseTable, beside: Beside) -> Poses:
    """Read the poses of the camera in the world, ordered by stamp.

    Raises:
        UsageError: stamps by image name or the scale are not given.
        RecordingError: a line breaks the format, or an image has no stamp.
    """
    if beside.times is None or beside.times.names is None or beside.metric_scale is None:
        lacking = "no stamps and no scale"
        raise UsageError(
            f"a COLMAP reconstruction has {lacking}",
            where=table.path,
            fix="give the stamp of each image by its name (--image-times or --trajectory-times: "
            "NAME,SECONDS a line) and metres per unit of the reconstruction (--metric-scale)",
        )
    stamp_of = dict(zip(beside.times.names, beside.times.stamps_ns.tolist(), strict=True))
    found: list[tuple[int, int, list[float]]] = []
    for line, text in _image_lines(table):
        cells = text.split(maxsplit=_NAME_AT)
        if len(cells) <= _NAME_AT:
            raise broken_line(table, line, f"has {len(cells)} columns, an image has 10")
        try:
            values = [float(cell) for cell in cells[1:8]]
        except ValueError as error:
            raise broken_line(table, line, f"holds something that is no number: {error}") from error
        name = cells[_NAME_AT].strip().replace("\\", "/").rpartition("/")[2]
        if name not in stamp_of:
            raise RecordingError(
                f"there is no stamp for the image {name!r}, line {line} of {table.path.name}",
                where=beside.times.where,
                fix="list a stamp for every image of the reconstruction",
            )
        found.append((stamp_of[name], line, values))
    found.sort(key=lambda pose: pose[:2])
    return _inverted(table, found)


def _image_lines(table: PoseTable) -> list[tuple[int, str]]:
    """Every other line: the points of an image without any are a blank line."""
    numbered = [
        (number, line)
        for number, line in enumerate(table.lines, start=1)
        if not line.lstrip().startswith("#")
    ]
    first = next(at for at, (_, line) in enumerate(numbered) if line.strip())
    images = numbered[first::_LINES_AN_IMAGE]
    return [(number, line) for number, line in images if line.strip()]


def _inverted(table: PoseTable, found: list[tuple[int, int, list[float]]]) -> Poses:
    values = np.array([pose for _, _, pose in found])
    q, t = values[:, [1, 2, 3, 0]], values[:, 4:]
    norms = np.sqrt((q**2).sum(axis=1))
    wrong = ~(np.abs(norms - 1) <= NORM_TOLERANCE) | ~np.isfinite(t).all(axis=1)
    if wrong.any():
        at = int(np.argmax(wrong))
        raise broken_line(
            table,
            found[at][1],
            f"has no pose: its quaternion has norm {norms[at]:.6g}, or a number is not finite",
        )
    q_world_camera = unit_quaternion(q * np.array([-1.0, -1.0, -1.0, 1.0]))
    place = -rotate(q_world_camera, t)
    return Poses(
        [line for _, line, _ in found], [stamp for stamp, _, _ in found], place, q_world_camera
    )
