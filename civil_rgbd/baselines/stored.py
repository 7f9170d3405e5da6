"""Predictions that lie in a folder: EXR in metres, or 16-bit PNG with a scale."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Final

import cv2
import numba
import numpy as np
import OpenEXR
from numpy.typing import NDArray

from civil_rgbd.errors import FormatError, UsageError
from civil_rgbd.geometry.camera import PinholeCamera

SETTINGS: Final = "predictions.json"
"""A file in the folder that may say ``{"units_per_m": 256}``."""

_DEPTH_CHANNELS: Final = ("Z", "depth", "Depth", "Y", "R", "V")
"""What writers of EXR call depth, best first."""

_LAYOUTS: Final = ("{bridge}/{frame}", "{bridge}/depth/{frame}", "{bridge}_{frame}", "{frame}")


class StoredPredictions:
    """A :class:`~civil_rgbd.baselines.model.StoredDepth`: one file a frame, made by any program.

    A frame is looked for as ``BRIDGE/FRAME``, ``BRIDGE/depth/FRAME``, ``BRIDGE_FRAME`` and
    ``FRAME``, each ``.exr`` first, then ``.png``. Pixels that are 0 or NaN have no answer.

    Args:
        folder: holds the files.
        units_per_m: of PNG files: 256 as KITTI stores depth, 1000 for millimetres. None asks the
            folder's ``predictions.json``. EXR is in metres, always.

    Raises:
        UsageError: there is no such folder, or the scale is no positive number.
        FormatError: ``predictions.json`` cannot be read.
    """

    def __init__(self, folder: str | Path, *, units_per_m: float | None = None) -> None:
        self.folder = Path(folder)
        if not self.folder.is_dir():
            raise UsageError("there is no such folder", where=folder, fix="check the path")
        said = units_per_m if units_per_m is not None else self._settings().get("units_per_m")
        if said is not None and not (isinstance(said, (int, float)) and 0 < said < np.inf):
            raise UsageError(
                f"units_per_m is no positive number: {said!r}",
                where=self.folder,
                fix="give 256 for KITTI's PNG, 1000 for millimetres",
            )
        self.units_per_m = None if said is None else float(said)
        self._depth_by_units = None if said is None else _depth_by_units(float(said))

    def depth_of(self, bridge: str, frame: str, camera: PinholeCamera) -> NDArray[np.float32]:
        """Read the prediction of a frame.

        Args:
            bridge: id of the bridge.
            frame: id of the frame.
            camera: of the frame's image.

        Returns:
            (H, W) float32, metres; NaN where there is no answer.

        Raises:
            UsageError: the frame has no file, or a PNG has no scale.
            FormatError: a file is damaged, or of another size than the image.
        """
        path = self._path_of(bridge, frame)
        depth_m = self._read_png(path) if path.suffix == ".png" else _read_exr(path)
        if depth_m.shape != (camera.height_px, camera.width_px):
            raise FormatError(
                f"the prediction has {depth_m.shape[1]} x {depth_m.shape[0]} px, its image "
                f"{camera.width_px} x {camera.height_px}",
                where=path,
                fix="resize the predictions to the images: how is a part of the method",
            )
        return depth_m

    def _settings(self) -> dict[str, Any]:
        path = self.folder / SETTINGS
        if not path.is_file():
            return {}
        try:
            document = json.loads(path.read_text("utf-8"))
        except ValueError as error:
            raise FormatError(
                f"the file is no JSON: {error}", where=path, fix='write {"units_per_m": 256}'
            ) from error
        if not isinstance(document, dict):
            raise FormatError(
                "the file is no JSON object", where=path, fix='write {"units_per_m": 256}'
            )
        return document

    def _path_of(self, bridge: str, frame: str) -> Path:
        tried = [
            self.folder / (layout.format(bridge=bridge, frame=frame) + suffix)
            for layout in _LAYOUTS
            for suffix in (".exr", ".png")
        ]
        for path in tried:
            if path.is_file():
                return path
        raise UsageError(
            f"there is no prediction of frame {frame} of bridge {bridge}",
            where=self.folder,
            fix=f"store it as {tried[0].relative_to(self.folder).as_posix()} (or .png), or score "
            "only the frames that were predicted",
        )

    def _read_png(self, path: Path) -> NDArray[np.float32]:
        if self._depth_by_units is None:
            raise UsageError(
                "a PNG holds whole numbers, and their scale is not given",
                where=path,
                fix=f'write {{"units_per_m": 256}} into {SETTINGS} beside the predictions',
            )
        data = np.frombuffer(path.read_bytes(), np.uint8)
        stored = cv2.imdecode(data, cv2.IMREAD_UNCHANGED) if len(data) else None
        if stored is None or stored.dtype != np.uint16 or stored.ndim != 2:
            found = "no image" if stored is None else f"{stored.dtype} {stored.shape}"
            raise FormatError(
                f"the PNG is not one channel of 16 bits, but {found}",
                where=path,
                fix="write depth, not a picture of it; 8 bits are too coarse",
            )
        depth_m = np.empty(stored.shape, dtype=np.float32)
        _look_up(stored.ravel(), self._depth_by_units, depth_m.ravel())
        return depth_m


def _depth_by_units(units_per_m: float) -> NDArray[np.float32]:
    """Return the depth of each number that a PNG can hold; NaN for 0, which is no answer."""
    with np.errstate(over="ignore"):  # infinite depth is clamped by scoring, and counted
        depth_m = (np.arange(1 << 16) / np.float64(units_per_m)).astype(np.float32)
    depth_m[depth_m == 0] = np.nan  # also what is too small to be told from 0
    return depth_m


# Six times as fast as dividing: scoring stored predictions is mostly reading them.
@numba.njit(cache=True, nogil=True)
def _look_up(stored, depth_by_units, depth_m):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202  # a kernel
    for i in range(stored.size):
        depth_m[i] = depth_by_units[stored[i]]


def _read_exr(path: Path) -> NDArray[np.float32]:
    try:
        channels = OpenEXR.File(str(path), separate_channels=True).channels()
    except (RuntimeError, ValueError, TypeError) as error:  # all that OpenEXR is seen to raise
        raise FormatError(
            f"the EXR cannot be read: {error}",
            where=path,
            fix="write it again; it may be cut off",
        ) from error
    names = [name for name in _DEPTH_CHANNELS if name in channels] or list(channels)[:1]
    if not names or (names[0] == "R" and len(channels) > 1 and not _is_grey(channels)):
        raise FormatError(
            f"the EXR has no depth channel, but {', '.join(sorted(channels)) or 'none'}",
            where=path,
            fix="write one channel Z, float32, metres",
        )
    depth_m = np.array(channels[names[0]].pixels, dtype=np.float32)
    depth_m[depth_m == 0] = np.nan  # the rest stays: scoring clamps it, and counts it
    return depth_m


def _is_grey(channels: dict[str, Any]) -> bool:
    """Whether R, G and B are the same: some programs write depth three times."""
    if not {"R", "G", "B"} <= set(channels):
        return False
    r, g, b = (channels[name].pixels for name in "RGB")
    return bool(np.array_equal(r, g, equal_nan=True) and np.array_equal(r, b, equal_nan=True))
