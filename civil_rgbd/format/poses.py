"""``poses.json``: where the camera was for each frame. This file is the law."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.constants import FORMAT_VERSION
from civil_rgbd.domain.frame import FrameRow
from civil_rgbd.errors import FormatError
from civil_rgbd.format.documents import read_document, refuse_faults, write_text
from civil_rgbd.format.versions import Document, current_document
from civil_rgbd.storage.places import Place

KIND: Final = "poses"
_FRAME_ID: Final = re.compile(r"[0-9]{6,}")
_QUATERNION_LIMIT: Final = 1.000000001
_INT64: Final = 1 << 63


@dataclass(frozen=True, slots=True, eq=False)
class FramePoses:
    """The poses of a bridge's frames, as its ``poses.json`` has them.

    Attributes:
        frame_ids: (F,) ids, in the file's order.
        stamps_ns: (F,) int64, corrected stamps.
        translations_m: (F, 3) float64, of T_map_camera.
        quaternions_xyzw: (F, 4) float64, of T_map_camera; the norm is for ``validate`` to judge.
    """

    frame_ids: tuple[str, ...]
    stamps_ns: NDArray[np.int64]
    translations_m: NDArray[np.float64]
    quaternions_xyzw: NDArray[np.float64]


def read_poses(path: Place) -> FramePoses:
    """Read ``poses.json``.

    Raises:
        FormatError: the file is missing, damaged, or breaks its schema.
    """
    return poses_from_document(read_document(path), where=path)


def poses_from_document(document: Document, *, where: object) -> FramePoses:
    """Turn a parsed ``poses.json`` into poses.

    As strict as the schema, by plain code: a schema check takes 0.2 ms a frame.

    Raises:
        FormatError: it breaks its schema.
    """
    document = current_document(document, kind=KIND, where=where)
    refuse_faults(_faults(document), kind=KIND, where=where)
    frames = document["frames"]
    poses = [frame["T_map_camera"] for frame in frames]
    return FramePoses(
        frame_ids=tuple(frame["frame_id"] for frame in frames),
        stamps_ns=np.array([int(frame["stamp_ns"]) for frame in frames], dtype=np.int64),
        translations_m=_rows([pose["translation_m"] for pose in poses], 3, where),
        quaternions_xyzw=_rows([pose["quaternion_xyzw"] for pose in poses], 4, where),
    )


def _rows(values: list[list[float]], width: int, where: object) -> NDArray[np.float64]:
    try:
        return np.array(values, dtype=np.float64).reshape(len(values), width)
    except OverflowError as error:  # an integer of hundreds of digits
        raise FormatError(
            "a number is too large for a float", where=where, fix="mend the pose"
        ) from error


def _faults(document: Document) -> Iterator[str]:
    yield from _key_faults(document, {"format_version", "frames"}, "$")
    frames = document.get("frames")
    if not isinstance(frames, list):
        yield "$.frames: is not a list"
        return
    for index, frame in enumerate(frames):
        if not _is_frame(frame):
            yield from _frame_faults(frame, f"$.frames[{index}]")


def _is_frame(frame: Any) -> bool:  # noqa: ANN401  # JSON
    """Tell quickly whether a frame is right; :func:`_frame_faults` says what is not."""
    return next(_frame_faults(frame, ""), None) is None


def _frame_faults(frame: Any, path: str) -> Iterator[str]:  # noqa: ANN401  # JSON
    if not isinstance(frame, dict):
        yield f"{path}: is not an object"
        return
    yield from _key_faults(frame, {"frame_id", "stamp_ns", "T_map_camera"}, path)
    frame_id, stamp_ns = frame.get("frame_id"), frame.get("stamp_ns")
    if not (isinstance(frame_id, str) and _FRAME_ID.fullmatch(frame_id)):
        yield f"{path}.frame_id: {frame_id!r} is not six digits or more"
    if not (type(stamp_ns) is int and -_INT64 <= stamp_ns < _INT64):
        yield f"{path}.stamp_ns: {stamp_ns!r} is not a 64-bit integer"
    pose = frame.get("T_map_camera")
    if not isinstance(pose, dict):
        yield f"{path}.T_map_camera: is not an object"
        return
    yield from _key_faults(pose, {"translation_m", "quaternion_xyzw"}, f"{path}.T_map_camera")
    if not _is_vector(pose.get("translation_m"), 3):
        yield f"{path}.T_map_camera.translation_m: is not three numbers"
    quaternion = pose.get("quaternion_xyzw")
    if not _is_vector(quaternion, 4) or max(map(abs, quaternion or [])) > _QUATERNION_LIMIT:
        yield f"{path}.T_map_camera.quaternion_xyzw: is not four numbers between -1 and 1"


def _is_vector(value: Any, length: int) -> bool:  # noqa: ANN401  # JSON
    return (
        isinstance(value, list)
        and len(value) == length
        and all(type(number) in (float, int) for number in value)
    )


def _key_faults(value: Document, keys: set[str], path: str) -> Iterator[str]:
    if value.keys() == keys:
        return
    for key in sorted(keys - value.keys()):
        yield f"{path}: {key!r} is a required property"
    for key in sorted(value.keys() - keys):
        yield f"{path}: {key!r} was unexpected"


def poses_to_document(rows: Sequence[FrameRow]) -> Document:
    """Turn rows into the document that :func:`poses_from_document` reads."""
    return {
        "format_version": FORMAT_VERSION,
        "frames": [
            {
                "frame_id": row.frame_id,
                "stamp_ns": row.stamp_ns,
                "T_map_camera": {
                    "translation_m": [row.tx, row.ty, row.tz],
                    "quaternion_xyzw": [row.qx, row.qy, row.qz, row.qw],
                },
            }
            for row in rows
        ],
    }


def poses_text(document: Document) -> str:
    """Return the text of ``poses.json``: one line a frame."""
    lines = ",\n".join(f"    {json.dumps(f, allow_nan=False)}" for f in document["frames"])
    frames = f"[\n{lines}\n  ]" if lines else "[]"
    version = json.dumps(document["format_version"])
    return f'{{\n  "format_version": {version},\n  "frames": {frames}\n}}\n'


def write_poses(path: Place, rows: Sequence[FrameRow]) -> None:
    """Write ``poses.json``, whole or not at all.

    Raises:
        FormatError: a row holds what its schema refuses; nothing is written.
        OutputError: the file cannot be written.
    """
    document = poses_to_document(rows)
    refuse_faults(_faults(document), kind=KIND, where=path)
    write_text(path, poses_text(document))
