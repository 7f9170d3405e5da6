"""Numbers, matrices, cameras and transforms out of parsed calibrations."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.domain.rig import RigFile
from civil_rgbd.errors import UsageError
from civil_rgbd.geometry.camera import LensCamera, PinholeCamera
from civil_rgbd.geometry.transforms import (
    RIGID_TOLERANCE,
    matrix_from_quaternion,
    quaternion_from_matrix,
    rigid_fault,
    transform_from,
    unit_quaternion,
)

_TYPED_TOLERANCE: Final = 1e-3
"""How far printed digits may be from a rotation; they are made exact then."""

_OPENCV_COUNTS: Final = (4, 5, 8, 12)
"""Lengths of OpenCV's distortion vector that are read; 14 would tilt the sensor."""


_MOST_ITEMS: Final = 1000
_CHECK: Final = "compare it with the calibration program's own example"


@dataclass(frozen=True, slots=True)
class Request:
    """What the user adds where a calibration leaves it out.

    Attributes:
        image_size_px: width and height of the image.
        camera: which of several cameras.
    """

    image_size_px: tuple[int, int] | None = None
    camera: str | None = None


@dataclass(frozen=True, slots=True, eq=False)
class ImportedRig:
    """What a calibration says.

    Attributes:
        rig: as a rig file says it.
        remarks: directions in words, and what was assumed or left out.
    """

    rig: RigFile
    remarks: tuple[str, ...]


def numbers(value: Any, count: int | None, *, where: str) -> list[float]:  # noqa: ANN401  # the door: foreign data
    """Flatten nested lists, or OpenCV's ``{rows, cols, data}``, into finite numbers.

    Args:
        value: parsed, of any shape.
        count: how many there must be; None = any.
        where: file and key, for errors.

    Raises:
        UsageError: they are not numbers, or not that many.
    """
    if isinstance(value, dict) and "data" in value:
        value = value["data"]
    flat: list[Any] = []
    waiting = [value]
    for _ in range(_MOST_ITEMS):  # an alias can make a list contain itself
        if not waiting:
            break
        item = waiting.pop(0)
        if isinstance(item, list | tuple):
            waiting = [*item, *waiting]
        else:
            flat.append(item)
    if waiting:
        raise UsageError(f"it has more than {_MOST_ITEMS} items", where=where, fix=_CHECK)
    try:
        # YAML 1.1 takes 1e-3, which has no point, for text.
        found = [float("nan") if isinstance(item, bool) else float(item) for item in flat]
    except (TypeError, ValueError) as error:
        raise UsageError(
            f"it holds something else than numbers: {error}", where=where, fix=_CHECK
        ) from error
    if count is not None and len(found) != count:
        raise UsageError(f"it has {len(found)} numbers, not {count}", where=where, fix=_CHECK)
    if not all(map(math.isfinite, found)):
        raise UsageError("it has a number that is not finite", where=where, fix=_CHECK)
    return found


def number(value: Any, *, where: str) -> float:  # noqa: ANN401  # the door: foreign data
    """Return one finite number."""
    return numbers(value, 1, where=where)[0]


def first_of(table: dict[str, Any], *keys: str) -> Any:  # noqa: ANN401  # foreign data
    """Return the value of the first key that is there; None without any."""
    return next((table[key] for key in keys if table.get(key) is not None), None)


def rigid(
    rotation: Sequence[float], translation_m: Sequence[float], *, where: str
) -> NDArray[np.float64]:
    """Join a rotation matrix, row by row, and a translation; printed digits are made exact.

    Raises:
        UsageError: the nine numbers are no rotation.
    """
    T = transform_from(np.reshape(rotation, (3, 3)), translation_m)
    fault = rigid_fault(T, _TYPED_TOLERANCE)
    if fault is not None:
        raise UsageError(
            f"it is no rigid transform: {fault}",
            where=where,
            fix="check that the rotation is written row by row, with four digits or more",
        )
    if rigid_fault(T, RIGID_TOLERANCE) is not None:
        T = transform_from(matrix_from_quaternion(quaternion_from_matrix(T[:3, :3])), T[:3, 3])
    return T


def rigid_from_rows(value: Any, *, where: str) -> NDArray[np.float64]:  # noqa: ANN401  # the door: foreign data
    """Read a 4 x 4 matrix, or its upper three rows."""
    flat = numbers(value, None, where=where)
    if len(flat) == 12:
        flat += [0.0, 0.0, 0.0, 1.0]
    if len(flat) != 16:
        raise UsageError(f"it has {len(flat)} numbers, not 16", where=where, fix=_CHECK)
    rows = np.reshape(flat, (4, 4))
    if not np.allclose(rows[3], [0, 0, 0, 1], atol=_TYPED_TOLERANCE):
        raise UsageError(
            f"its last row is {rows[3].tolist()}, not [0, 0, 0, 1]", where=where, fix=_CHECK
        )
    return rigid(rows[:3, :3].ravel().tolist(), rows[:3, 3].tolist(), where=where)


def rigid_from_quaternion(value: Any, *, where: str) -> NDArray[np.float64]:  # noqa: ANN401  # the door: foreign data
    """Read x y z qx qy qz qw."""
    flat = numbers(value, 7, where=where)
    norm = math.sqrt(math.fsum(part * part for part in flat[3:]))
    if not abs(norm - 1) <= _TYPED_TOLERANCE:
        raise UsageError(f"its quaternion has norm {norm:.6g}, not 1", where=where, fix=_CHECK)
    return transform_from(matrix_from_quaternion(unit_quaternion(flat[3:])), flat[:3])


def camera_from(
    size_px: tuple[int, int] | None,
    intrinsics: Sequence[float],
    coefficients: Sequence[float],
    *,
    fisheye: bool = False,
    where: str,
) -> LensCamera:
    """Build a camera.

    Args:
        size_px: width and height; None where neither calibration nor user says them.
        intrinsics: fx fy cx cy, or the nine numbers of K row by row.
        coefficients: of distortion, in OpenCV's order.
        fisheye: they are those of the equidistant model.
        where: for errors.

    Raises:
        UsageError: the size is missing, or the numbers make no camera.
    """
    if len(intrinsics) == 9:
        fx, skew, cx, _, fy, cy, *_ = intrinsics
        if abs(skew) > _TYPED_TOLERANCE * abs(fx):
            raise UsageError(f"K has a skew of {skew}", where=where, fix="calibrate without skew")
    else:
        fx, fy, cx, cy = intrinsics
    if size_px is None:
        raise UsageError(
            "the calibration does not say how large the image is",
            where=where,
            fix=f"add --image-size, e.g. --image-size {round(2 * cx)}x{round(2 * cy)} if the "
            "principal point lies near the middle",
        )
    try:
        lens, taken = _lens(coefficients, fisheye=fisheye)
        return LensCamera(PinholeCamera(*size_px, fx, fy, cx, cy), lens, taken)
    except ValueError as error:
        raise UsageError(f"it describes no camera: {error}", where=where, fix=_CHECK) from error


def _lens(coefficients: Sequence[float], *, fisheye: bool) -> tuple[str, tuple[float, ...]]:
    if fisheye:
        return "fisheye", tuple(coefficients)
    if not any(coefficients):
        return "none", ()
    most = max(_OPENCV_COUNTS)
    if any(coefficients[most:]):
        raise ValueError(f"{len(coefficients)} coefficients tilt the sensor, which is not modelled")
    kept = list(coefficients[:most])
    while len(kept) > 5 and not kept[-1]:
        kept.pop()
    count = next(count for count in _OPENCV_COUNTS if count >= len(kept))
    kept += [0.0] * (count - len(kept))
    return ("plumb_bob" if count <= 5 else "rational_polynomial"), tuple(kept)


def size_from(width: Any, height: Any, request: Request, *, where: str) -> tuple[int, int] | None:  # noqa: ANN401  # the door: foreign data
    """Return the image's size: the calibration's, else the user's; they may not contradict.

    Raises:
        UsageError: it is no size, or the user says another.
    """
    if width is None or height is None:
        return request.image_size_px
    said = number(width, where=where), number(height, where=where)
    if min(said) < 1 or any(value != int(value) for value in said):
        raise UsageError(f"the image's size is {said[0]} x {said[1]}", where=where, fix=_CHECK)
    size = int(said[0]), int(said[1])
    if request.image_size_px not in (None, size):
        raise UsageError(
            f"the calibration was made at {size[0]}x{size[1]} pixels",
            where=where,
            fix="leave out --image-size, or calibrate at the size that is recorded",
        )
    return size
