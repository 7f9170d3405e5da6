"""Intrinsics in the layouts that people keep them in."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from civil_rgbd.errors import RecordingError
from civil_rgbd.importers.numbers import is_number, read_text
from civil_rgbd.importers.rendered_set import Intrinsics

CAMERA_FILES: Final = (
    *("intrinsics.json", "camera.json", "camera_info.json", "camera_intrinsics.json"),
    *("intrinsic.json", "calibration.json", "intrinsics.txt", "intrinsic.txt", "camera.txt"),
    *("K.txt", "cam_K.txt", "calib.txt", "calibration.txt", "camera-intrinsics.txt"),
    *("calib_cam_to_cam.txt", "intrinsics.csv", "camera_matrix.csv"),
)
"""Where a set's intrinsics are looked for, in this order."""

_MATRICES: Final = ("camera_matrix", "intrinsic_matrix", "K", "k", "cam_K", "intrinsics", "matrix")
_LENSES: Final = (
    *("dist_coeff", "dist_coeffs", "distortion_coefficients", "distortion_coeffs"),
    *("distortion", "coefficients", "D", "d"),
)
_NUMBERS: Final = {
    "fx_px": ("fx_px", "fx", "focal_x", "fx_color", "fx_depth"),
    "fy_px": ("fy_px", "fy", "focal_y", "fy_color", "fy_depth"),
    "cx_px": ("cx_px", "cx", "ppx", "mx_color", "mx_depth"),
    "cy_px": ("cy_px", "cy", "ppy", "my_color", "my_depth"),
}
_WIDTHS: Final = ("width_px", "width", "image_width", "w", "colorWidth", "depthWidth")
_HEIGHTS: Final = ("height_px", "height", "image_height", "h", "colorHeight", "depthHeight")
_KITTI: Final = ("P_rect_02", "P2", "P_rect_03", "P3", "P_rect_00", "P0", "K_02", "K")
_KEYED: Final = re.compile(r"^\s*([A-Za-z_]\w*)\s*[:=]\s*(.+?)\s*$", re.MULTILINE)
_COEFFICIENT_COUNTS: Final = (4, 5, 8, 12)


def find_camera(root: Path) -> Path | None:
    """Return the first of :data:`CAMERA_FILES` in a folder, or in ``intrinsic(s)/``; else None."""
    for folder in (root, root / "intrinsics", root / "intrinsic"):
        for name in CAMERA_FILES:
            if (folder / name).is_file():
                return folder / name
    return None


def read_camera(path: Path) -> Intrinsics:
    """Read intrinsics from JSON, from keyed lines, or from bare numbers.

    Raises:
        RecordingError: the file cannot be read, or holds no camera.
    """
    text = read_text(path)
    if path.suffix.lower() == ".json" or text.lstrip().startswith("{"):
        try:
            document = json.loads(text)
        except ValueError as error:
            raise _no_camera(path, f"it is no JSON: {error}") from error
        return _from_document(document, path)
    keyed = {match[1]: match[2] for match in _KEYED.finditer(text)}
    if keyed:
        return _from_document({key: _numbers(value) for key, value in keyed.items()}, path)
    return camera_from_numbers([n for line in text.splitlines() for n in _numbers(line)], path)


def camera_from_text(text: str) -> Intrinsics:
    """Read ``fx,fy,cx,cy`` or ``fx,fy,cx,cy,k1,k2,p1,p2[,k3]``, as an option has them.

    Raises:
        RecordingError: they are not 4, 8 or 9 numbers.
    """
    words = text.split(",")
    if not all(map(is_number, words)):
        raise _no_camera("--intrinsics", f"{text!r} is neither a file nor numbers")
    return camera_from_numbers([float(word) for word in words], "--intrinsics")


def camera_from_numbers(numbers: Sequence[float], where: object) -> Intrinsics:
    """Read a 3 x 3, 3 x 4 or 4 x 4 matrix by rows, or fx fy cx cy with or without a lens.

    Raises:
        RecordingError: they are none of these.
    """
    matrix = {9: (3, 3), 12: (3, 4), 16: (4, 4)}.get(len(numbers))
    if matrix:
        K = np.array(numbers, dtype=np.float64).reshape(matrix)
        if K[2, 2] == 1 and K[1, 0] == 0 and not K[2, :2].any():
            return _checked(Intrinsics(K[0, 0], K[1, 1], K[0, 2], K[1, 2]), where)
    if len(numbers) in {4, 8, 9}:
        fx, fy, cx, cy = numbers[:4]
        return _checked(Intrinsics(fx, fy, cx, cy, coefficients=tuple(numbers[4:])), where)
    raise _no_camera(where, f"{len(numbers)} numbers are no camera")


def _numbers(text: str) -> list[float]:
    return [float(word) for word in re.split(r"[\s,;\[\]]+", text) if word and is_number(word)]


def _from_document(document: Any, where: Path) -> Intrinsics:  # noqa: ANN401  # JSON
    if not isinstance(document, Mapping):
        raise _no_camera(where, "it is no object of keys and values")
    inner = [document[key] for key in ("camera", "color", "rgb") if _is_map(document.get(key))]
    known = {**document, **inner[0]} if inner else dict(document)
    camera = _pinhole(known, where)
    width, height = (_first(known, names) for names in (_WIDTHS, _HEIGHTS))
    lens = tuple(_flat(_first(known, _LENSES) or ()))
    if any(lens) and len(lens) not in _COEFFICIENT_COUNTS:
        raise _no_camera(where, f"a lens has {len(lens)} coefficients, not 4, 5, 8 or 12")
    return _checked(
        Intrinsics(
            *(camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px),
            width_px=int(_flat(width)[0]) if width is not None and _flat(width) else None,
            height_px=int(_flat(height)[0]) if height is not None and _flat(height) else None,
            coefficients=lens if any(lens) else (),
        ),
        where,
    )


def _is_map(value: object) -> bool:
    return isinstance(value, Mapping)


def _first(document: Mapping[str, Any], names: Sequence[str]) -> Any:  # noqa: ANN401  # JSON
    return next((document[name] for name in names if document.get(name) is not None), None)


def _pinhole(document: Mapping[str, Any], where: Path) -> Intrinsics:
    parts = [_first(document, names) for names in _NUMBERS.values()]
    if all(part is not None and _flat(part) for part in parts):
        fx, fy, cx, cy = (_flat(part)[0] for part in parts)
        return Intrinsics(fx, fy, cx, cy)
    matrix = _flat(_first(document, (*_KITTI[:-1], *_MATRICES)) or ())
    if len(matrix) == 9 and matrix[2] == 0 and matrix[6] != 0:
        matrix = [matrix[i] for i in (0, 3, 6, 1, 4, 7, 2, 5, 8)]  # Open3D writes columns
    if not matrix:
        raise _no_camera(where, f"it has neither a matrix ({', '.join(_MATRICES)}) nor fx fy cx cy")
    return camera_from_numbers(matrix, where)


def _flat(value: Any) -> list[float]:  # noqa: ANN401  # JSON
    """The numbers in a number, a list, a list of lists, or OpenCV's ``{"data": [...]}``."""
    if isinstance(value, Mapping):
        return _flat(value.get("data", ()))
    if isinstance(value, str):
        return _numbers(value)
    if isinstance(value, list | tuple):
        return [number for item in value for number in _flat(item)]
    return [float(value)]


def _checked(camera: Intrinsics, where: object) -> Intrinsics:
    numbers = (camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px, *camera.coefficients)
    if not np.isfinite(numbers).all() or camera.fx_px <= 0 or camera.fy_px == 0:
        raise _no_camera(where, f"its focal lengths are {camera.fx_px} and {camera.fy_px}")
    return camera


def _no_camera(where: object, fault: str) -> RecordingError:
    return RecordingError(
        f"this holds no camera intrinsics: {fault}",
        where=where,
        fix="give fx, fy, cx, cy in pixels: --intrinsics 638.3,636.5,635.7,366.1",
    )
