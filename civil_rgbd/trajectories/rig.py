"""Rig files (TOML): camera, extrinsics and time offset, where a recording lacks them."""

from __future__ import annotations

import math
import re
import tomllib
from pathlib import Path
from typing import Any, Final

import numpy as np
from jsonschema import Draft202012Validator
from jsonschema.exceptions import ValidationError, best_match
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
from civil_rgbd.resources import load_schema, nearest

TIME_OFFSETS: Final = (
    "camera_time_offset_s",
    # r3live_vio.cpp: the state of an image is that at `m_timestamp + td_ext_i2c`.
    "r3live_time_offset_s",
    # Kalibr's wiki, "yaml formats": t_imu = t_cam + shift.
    "kalibr_timeshift_cam_imu_s",
)
"""Keys that give the camera's time offset: all of them are added to image stamps as they are."""

_TYPED_TOLERANCE: Final = 1e-3
"""How far numbers typed with a few digits may be from a rotation; they are made exact then."""

_POSITIVE: Final = (
    "a camera has positive focal lengths: give the calibration's own; rendered sets with y upwards "
    "(a negative fy, as ICL-NUIM) are read by `civil-rgbd convert`, not with a rig file"
)
_REMEDIES: Final = {"fx_px": _POSITIVE, "fy_px": _POSITIVE}
"""What to do about a value, where its description does not say it."""

_PINHOLE: Final = ("width_px", "height_px", "fx_px", "fy_px", "cx_px", "cy_px")


def read_rig(path: Path) -> RigFile:
    """Read a rig file.

    Args:
        path: TOML, as ``rig.schema.json`` has it.

    Raises:
        UsageError: it is not there, not TOML, or does not fit its schema.
    """
    try:
        document = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise UsageError(
            f"the rig file cannot be read: {error.strerror}",
            where=path,
            fix="check the path given with --rig",
        ) from error
    except ValueError as error:  # tomllib.TOMLDecodeError and UnicodeDecodeError are such
        raise UsageError(
            f"the rig file is not TOML: {error}", where=path, fix="see https://toml.io"
        ) from error
    return rig_from_document(document, where=path)


def rig_from_document(document: dict[str, Any], *, where: object) -> RigFile:
    """Turn a parsed rig file into what it says.

    Args:
        document: parsed TOML.
        where: the file, for errors.

    Raises:
        UsageError: it does not fit its schema, or its numbers make no camera or transform.

    >>> rig = rig_from_document({"kalibr_timeshift_cam_imu_s": 0.02}, where="rig.toml")
    >>> rig.camera_time_offset_s
    0.02
    """
    fault = best_match(Draft202012Validator(load_schema("rig")).iter_errors(document))
    if fault is not None:
        raise _misfit(fault, where)
    names = document.get("sensors", {})
    camera = document.get("camera", {})
    return RigFile(
        camera=_camera(camera, where),
        rectified=camera.get("rectified", False),
        extrinsics={
            (a, b): _transform(given, where=f"{where}: extrinsics.{name}")
            for name, given in document.get("extrinsics", {}).items()
            for _, a, b in [name.split("_")]
        },
        camera_time_offset_s=_time_offset(document, where),
        camera_name=names.get("camera"),
        lidar_name=names.get("lidar"),
        map_up=_direction(document.get("map_up"), where=f"{where}: map_up"),
    )


def _misfit(fault: ValidationError, where: object) -> UsageError:
    place = ".".join(str(part) for part in fault.absolute_path)
    place = f"{where}: {place}" if place else str(where)
    if fault.validator == "additionalProperties" and isinstance(fault.instance, dict):
        known = list(fault.schema["properties"])
        unknown = next(key for key in fault.instance if key not in known)
        return UsageError(
            f"the rig file has an unknown key {unknown!r}",
            where=place,
            fix=_inverse_of(unknown, known) or nearest(unknown, known),
        )
    remedy = fault.schema.get("description", "compare it with rig.schema.json")
    return UsageError(
        f"the rig file does not fit its schema: {fault.message}",
        where=place,
        fix=_REMEDIES.get(str(fault.absolute_path[-1]) if fault.absolute_path else "", remedy),
    )


def _inverse_of(unknown: str, known: list[str]) -> str:
    """Say how to give a transform that is known the other way round; empty for other keys."""
    match = re.fullmatch(r"T_([a-z]+)_([a-z]+)", unknown)
    other = f"T_{match[2]}_{match[1]}" if match else ""
    if match is None or other not in known:
        return ""
    return (
        f"give its inverse as {other}, which takes points of the {match[1]} to the frame of the "
        f"{match[2]}: [R' -R't; 0 0 0 1] of [R t; 0 0 0 1]"
    )


def _camera(table: dict[str, Any], where: object) -> LensCamera | None:
    if "width_px" not in table:
        return None
    rectified = table.get("rectified", False)
    if rectified and table.get("lens", "none") != "none":
        raise UsageError(
            f"camera is rectified, but has a lens: {table['lens']!r}",
            where=f"{where}: camera",
            fix="leave out lens and coefficients, or rectified",
        )
    try:
        return LensCamera(
            PinholeCamera(*(table[name] for name in _PINHOLE)),
            table.get("lens", "none"),
            tuple(float(value) for value in table.get("coefficients", ())),
        )
    except ValueError as error:
        raise UsageError(
            f"camera describes no camera: {error}",
            where=f"{where}: camera",
            fix="compare it with the calibration's report",
        ) from error


def _transform(
    given: list[list[float]] | dict[str, list[float]], *, where: str
) -> NDArray[np.float64]:
    if isinstance(given, dict):
        q = np.asarray(given["quaternion_xyzw"], dtype=np.float64)
        norm = math.sqrt(math.fsum(value * value for value in q))
        if not abs(norm - 1) <= _TYPED_TOLERANCE:
            raise UsageError(
                f"quaternion_xyzw has norm {norm:.6g}, not 1",
                where=where,
                fix="give x, y, z, w of a unit quaternion",
            )
        rotation = matrix_from_quaternion(unit_quaternion(q))
        T = transform_from(rotation, given["translation_m"])
        fault = rigid_fault(T)
    else:
        T = np.asarray(given, dtype=np.float64)
        fault = rigid_fault(T, _TYPED_TOLERANCE)
        if fault is None and rigid_fault(T, RIGID_TOLERANCE) is not None:
            T = transform_from(matrix_from_quaternion(quaternion_from_matrix(T[:3, :3])), T[:3, 3])
    if fault is not None:
        raise UsageError(
            f"it is no rigid transform: {fault}",
            where=where,
            fix="give [R t; 0 0 0 1] as four rows, or translation_m and quaternion_xyzw",
        )
    return T


def _time_offset(document: dict[str, Any], where: object) -> float | None:
    given = [name for name in TIME_OFFSETS if name in document]
    if len(given) > 1:
        raise UsageError(
            f"the camera's time offset is given more than once: {', '.join(given)}",
            where=where,
            fix="keep one of them",
        )
    if not given:
        return None
    offset_s = float(document[given[0]])
    if not math.isfinite(offset_s):
        raise UsageError(
            f"{given[0]} is {offset_s}", where=where, fix="give seconds, a finite number"
        )
    return offset_s


def _direction(given: list[float] | None, *, where: str) -> tuple[float, float, float] | None:
    if given is None:
        return None
    length = math.sqrt(math.fsum(value * value for value in given))
    if not 0 < length < math.inf:
        raise UsageError(
            f"map_up has length {length}", where=where, fix="give a direction, e.g. [0, 0, 1]"
        )
    x, y, z = (value / length for value in given)
    return x, y, z
