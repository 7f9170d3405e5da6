"""Poses of images, in the layouts that people keep them in."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.errors import RecordingError
from civil_rgbd.geometry.transforms import (
    matrix_from_quaternion,
    quaternion_from_matrix,
    rigid_fault,
    transform_from,
)
from civil_rgbd.importers.folders import key_of
from civil_rgbd.importers.numbers import Table, is_number, read_table, read_text

POSE_FILES: Final = (
    *("poses.csv", "poses.txt", "poses.json", "pose.csv", "pose.txt", "images/poses.csv"),
    *("trajectory.csv", "trajectory.txt", "groundtruth.txt", "traj.txt", "gt.txt"),
    *("poses_tum.txt", "poses_kitti.txt", "camera_poses.txt"),
)
"""Where a set's poses are looked for, in this order; then any ``*.log`` and ``*.gt.freiburg``."""

POSE_FOLDERS: Final = ("pose", "poses")
"""Folders with one 4 x 4 matrix a file."""

_POSE: Final = ("tx", "ty", "tz", "qx", "qy", "qz", "qw")
_KEYS: Final = ("id", "frame_id", "frame", "image_id", "index", "timestamp", "stamp", "time", "t")
_TYPED_TOLERANCE: Final = 1e-3
"""How far typed numbers may be from a rotation or a unit quaternion; they are made exact then."""


@dataclass(frozen=True, slots=True, eq=False)
class PoseTable:
    """Poses as a file has them.

    Attributes:
        keys: ids, file names or stamps as written, one a pose; None where the order says it all.
        transforms: (P, 4, 4) float64; NaN where the file says that there is none.
        path: the file or folder.
        files: every file that was read.
    """

    keys: tuple[str, ...] | None
    transforms: NDArray[np.float64]
    path: Path
    files: tuple[Path, ...]
    keys_are_places: bool = False
    """The keys only count the rows from 0, whatever number the first image has."""


def find_poses(root: Path) -> Path | None:
    """Return the file or folder of poses in a set; None where there is none."""
    for name in POSE_FILES:
        if (root / name).is_file():
            return root / name
    for pattern in ("*.log", "*.freiburg"):
        found = sorted(root.glob(pattern))
        if len(found) == 1:
            return found[0]
    folders = [root / name for name in POSE_FOLDERS if any((root / name).glob("*.txt"))]
    return folders[0] if folders else None


def read_pose_table(path: Path) -> PoseTable:
    """Read poses from a table, a Redwood ``.log``, JSON, or a folder of matrices.

    Raises:
        RecordingError: the file cannot be read, or a row is no pose.
    """
    if path.is_dir():
        return _folder(path)
    if path.suffix.lower() == ".json":
        return _json(path)
    table = read_table(path)
    if not table.rows:
        raise _no_pose(path, "it holds no row")
    if len(table.rows) >= 5 and [len(row) for row in table.rows[:5]] == [3, 4, 4, 4, 4]:
        return _redwood(table)
    if {len(row) for row in table.rows} == {4} and len(table.rows) % 4 == 0:
        return _matrices(table, None)
    return _columns(table)


def _columns(table: Table) -> PoseTable:
    """One pose a row: 7 numbers, 12 or 16, with or without a key before them."""
    keys: list[str | None] = []
    words: list[list[float]] = []
    order = _column_order(table)
    for number, row in enumerate(table.rows):
        key: str | None = None
        if order is not None and len(row) == len(table.header):
            key = row[order[0]] if order[0] is not None else None
            numbers = [row[place] for place in order[1]]
        elif len(row) in {8, 13, 17}:
            key, numbers = row[0], list(row[1:])
        elif len(row) in {7, 12, 16}:
            numbers = list(row)
        else:
            raise _no_pose(
                table.path,
                f"row {number + 1} has {len(row)} columns, not 7, 12 or 16, nor a key before them",
            )
        if not all(map(is_number, numbers)) or (words and len(words[0]) != len(numbers)):
            raise _no_pose(table.path, f"row {number + 1} is {' '.join(row)!r}")
        keys.append(key)
        words.append([float(word) for word in numbers])
    named = tuple(key for key in keys if key is not None)
    transforms = _transforms(np.array(words, dtype=np.float64), table.path)
    return PoseTable(
        named if len(named) == len(keys) else None, transforms, table.path, (table.path,)
    )


def _column_order(table: Table) -> tuple[int | None, list[int]] | None:
    """Places of the key and of tx ty tz qx qy qz qw, where a header names them."""
    header = table.header
    if not set(_POSE) <= set(header):
        return None
    key = next((header.index(name) for name in _KEYS if name in header), None)
    return key, [header.index(name) for name in _POSE]


def _transforms(values: NDArray[np.float64], where: Path) -> NDArray[np.float64]:
    """(P, 7), (P, 12) or (P, 16) numbers to (P, 4, 4); rows that are not finite become NaN."""
    if values.shape[1] == 7:
        return np.stack([_from_quaternion(row, where) for row in values])
    matrices = np.zeros((len(values), 4, 4))
    matrices[:, 3, 3] = 1.0
    rows = values.shape[1] // 4
    matrices[:, :rows] = values.reshape(len(values), rows, 4)
    return np.stack([_exact(T, where) for T in matrices])


def _from_quaternion(row: NDArray[np.float64], where: Path) -> NDArray[np.float64]:
    if not np.isfinite(row).all():
        return np.full((4, 4), np.nan)
    norm = float(np.sqrt((row[3:] ** 2).sum()))
    if abs(norm - 1) > _TYPED_TOLERANCE:
        raise _no_pose(
            where, f"a quaternion has norm {norm:.6f}: {row[3:].tolist()} (read as qx qy qz qw)"
        )
    return transform_from(matrix_from_quaternion(row[3:] / norm), row[:3])


def _exact(T: NDArray[np.float64], where: Path) -> NDArray[np.float64]:
    """Make a typed matrix exactly rigid; NaN where it is not finite, as ScanNet marks lost ones."""
    if not np.isfinite(T).all():
        return np.full((4, 4), np.nan)
    fault = rigid_fault(T, _TYPED_TOLERANCE)
    if fault:
        raise _no_pose(where, f"a matrix is no rigid transform: {fault}")
    return transform_from(matrix_from_quaternion(quaternion_from_matrix(T[:3, :3])), T[:3, 3])


def _redwood(table: Table) -> PoseTable:
    """Redwood's ``.log``: a row of three numbers, the first the image's place, then 4 x 4."""
    heads = [row for row in table.rows if len(row) == 3]
    matrices = Table((), tuple(row for row in table.rows if len(row) == 4), table.path)
    if len(matrices.rows) != 4 * len(heads):
        raise _no_pose(table.path, f"{len(heads)} heads for {len(matrices.rows)} matrix rows")
    return replace(_matrices(matrices, tuple(head[0] for head in heads)), keys_are_places=True)


def _matrices(table: Table, keys: tuple[str, ...] | None) -> PoseTable:
    if not all(is_number(word) for row in table.rows for word in row):
        raise _no_pose(table.path, "a matrix holds a word that is no number")
    values = np.array([[float(word) for word in row] for row in table.rows]).reshape(-1, 16)
    return PoseTable(keys, _transforms(values, table.path), table.path, (table.path,))


def _folder(folder: Path) -> PoseTable:
    """One matrix a file; the file is named like its image."""
    files = sorted(path for path in folder.glob("*.txt") if path.name[0] != ".")
    tables = [read_pose_table(path) for path in files]
    many = [table.path.name for table in tables if len(table.transforms) != 1]
    if many or not tables:
        raise _no_pose(folder, f"{many[0]} holds several" if many else "it holds no .txt file")
    return PoseTable(
        tuple(str(key_of(path)) for path in files),
        np.concatenate([table.transforms for table in tables]),
        folder,
        tuple(files),
    )


def _json(path: Path) -> PoseTable:
    """``{"id": 4 x 4 or 7 numbers}``, a list of such, or a ``poses.json`` of our own format."""
    try:
        document = json.loads(read_text(path))
    except ValueError as error:
        raise _no_pose(path, f"it is no JSON: {error}") from error
    frames = document.get("frames", document) if isinstance(document, Mapping) else document
    if isinstance(frames, Mapping):
        keys, values = [str(key) for key in frames], list(frames.values())
    elif isinstance(frames, list):
        keys = [
            str(f.get("frame_id", i)) if isinstance(f, Mapping) else ""
            for i, f in enumerate(frames)
        ]
        values = frames
    else:
        raise _no_pose(path, "it holds neither a list nor an object of poses")
    rows = [_json_numbers(value) for value in values]
    if not rows or {len(row) for row in rows} - {7, 12, 16} or len({len(r) for r in rows}) != 1:
        raise _no_pose(path, "its poses are not all 4 x 4 matrices, nor all 7 numbers")
    transforms = _transforms(np.array(rows, dtype=np.float64), path)
    return PoseTable(tuple(keys) if all(keys) else None, transforms, path, (path,))


def _json_numbers(value: Any) -> list[float]:  # noqa: ANN401  # JSON
    if isinstance(value, Mapping):
        pose = value.get("T_map_camera", value)
        if isinstance(pose, Mapping):
            pose = [pose.get("translation_m", ()), pose.get("quaternion_xyzw", ())]
        return _json_numbers(pose)
    if isinstance(value, list):
        return [number for item in value for number in _json_numbers(item)]
    return [float(value)] if isinstance(value, int | float) else []


def _no_pose(where: object, fault: str) -> RecordingError:
    return RecordingError(
        f"this holds no poses of images: {fault}",
        where=where,
        fix="give rows `id tx ty tz qx qy qz qw`, or 3 x 4 or 4 x 4 matrices by rows: --poses FILE",
    )
