"""Rig files written: the TOML text that :func:`civil_rgbd.trajectories.rig.read_rig` reads back."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.domain.rig import RigFile
from civil_rgbd.geometry.camera import LensCamera
from civil_rgbd.geometry.transforms import inverse
from civil_rgbd.geometry.words import extrinsics_in_words, mounting_in_words

_KEYS: Final = (
    ("lidar", "camera"),
    ("imu", "camera"),
    ("imu", "lidar"),
    ("body", "camera"),
    ("body", "lidar"),
)
"""The transforms that a rig file can hold: ``T_a_b`` of each (a, b)."""

_NAMES: Final = {"lidar": "LiDAR", "camera": "camera", "imu": "IMU", "body": "body"}


def rig_to_text(rig: RigFile, remarks: Sequence[str] = ()) -> str:
    """Write a rig as TOML, its directions in words beside the numbers.

    Args:
        rig: what to say.
        remarks: comments for the top of the file.

    Returns:
        text that reads back to the same numbers, bit by bit.
    """
    lines = [f"# {_one_line(remark)}" for remark in remarks]
    if rig.camera_time_offset_s is not None:
        lines += ["# added to image stamps to reach the LiDAR's clock"]
        lines += [f"camera_time_offset_s = {float(rig.camera_time_offset_s)!r}"]
    if rig.map_up is not None:
        lines.append(f"map_up = {_row(rig.map_up)}")
    if rig.camera is not None or rig.rectified:
        lines += ["", "[camera]", *_camera_lines(rig)]
    names = {"camera": rig.camera_name, "lidar": rig.lidar_name}
    if any(names.values()):
        lines += ["", "[sensors]"]
        lines += [f"{role} = {_quoted(name)}" for role, name in names.items() if name]
    if rig.extrinsics:
        lines += ["", "[extrinsics]", *_extrinsic_lines(rig)]
    return "\n".join(lines).lstrip("\n") + "\n"


def _camera_lines(rig: RigFile) -> Iterator[str]:
    if rig.camera is not None:
        yield from _numbers_of(rig.camera)
    if rig.rectified:
        yield "rectified = true"


def _numbers_of(camera: LensCamera) -> Iterator[str]:
    pinhole = camera.pinhole
    yield f"width_px = {pinhole.width_px}"
    yield f"height_px = {pinhole.height_px}"
    for name in ("fx_px", "fy_px", "cx_px", "cy_px"):
        yield f"{name} = {float(getattr(pinhole, name))!r}"
    if camera.lens != "none":
        yield f"lens = {_quoted(camera.lens)}"
        yield f"coefficients = {_row(camera.coefficients)}"


def _extrinsic_lines(rig: RigFile) -> Iterator[str]:
    known = dict(rig.extrinsics)
    for a, b in list(known):
        if (a, b) not in _KEYS:
            known[b, a] = inverse(known.pop((a, b)))
    for a, b in _KEYS:
        if (a, b) in known:
            yield f"# {_in_words(known[a, b], a, b)}"
            yield f"T_{a}_{b} = ["
            yield from (f"  {_row(row)}," for row in known[a, b])
            yield "]"


def _in_words(T_a_b: NDArray[np.float64], a: str, b: str) -> str:
    if b == "camera":
        return extrinsics_in_words(T_a_b, seen_from=_NAMES[a])
    return mounting_in_words(T_a_b, what=_NAMES[b], seen_from=_NAMES[a])


def _row(values: Iterable[float]) -> str:
    return f"[{', '.join(repr(float(value)) for value in values)}]"


def _quoted(text: str) -> str:
    # JSON's strings are TOML's, but for the delete character.
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def _one_line(text: str) -> str:
    return " ".join("".join(c if c.isprintable() else " " for c in text).split())
