"""Bridge folders, read: documents at once, images when asked for."""

from __future__ import annotations

import dataclasses
import re
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.domain.bridge import Manifest
from civil_rgbd.domain.defect import DefectRecord
from civil_rgbd.domain.frame import FrameRow
from civil_rgbd.errors import FormatError
from civil_rgbd.format.defects import read_defects
from civil_rgbd.format.depth_exr import read_depth
from civil_rgbd.format.images import read_image
from civil_rgbd.format.index import read_index
from civil_rgbd.format.intrinsics import read_intrinsics
from civil_rgbd.format.layout import DEFECTS, FRAMES, INTRINSICS, MANIFEST, POSES
from civil_rgbd.format.manifest import read_manifest
from civil_rgbd.format.poses import FramePoses, read_poses
from civil_rgbd.format.quality_exr import Planes, read_quality
from civil_rgbd.geometry.camera import PinholeCamera
from civil_rgbd.storage.places import Place, place_of

_PATH: Final = re.compile(r"(rgb/[0-9]{6,}\.(jpg|png)|(depth|quality)/[0-9]{6,}\.exr)")


class PoseMismatchWarning(UserWarning):
    """``frames.parquet`` repeats other poses than ``poses.json`` has."""


@dataclass(frozen=True, slots=True, eq=False)
class Bridge:
    """A whole bridge folder.

    Attributes:
        folder: where it lies.
        manifest: what ``manifest.json`` says.
        camera: the pinhole of every image.
        rows: one a frame, by ascending id; the poses are those of ``poses.json``.
    """

    folder: Place
    manifest: Manifest
    camera: PinholeCamera
    rows: tuple[FrameRow, ...]

    def read_rgb(self, row: FrameRow) -> NDArray[np.uint8]:
        """Read a frame's colour image: (H, W, 3) uint8, red first.

        Raises:
            FormatError: the file is missing, damaged, or of another size than the camera's.
        """
        path = self.folder / row.rgb_path
        rgb = read_image(path)
        if rgb.shape[:2] != self._size:
            raise FormatError(
                f"the image is {rgb.shape[1]} x {rgb.shape[0]} pixels; the camera has "
                f"{self.camera.width_px} x {self.camera.height_px}",
                where=path,
                fix="build the bridge again, or download the file again",
            )
        return rgb

    def read_depth(self, row: FrameRow) -> NDArray[np.float32]:
        """Read a frame's depth: (H, W) float32, metres, 0 = nothing measured.

        Raises:
            FormatError: the file is missing, damaged, or of another size than the camera's.
        """
        return read_depth(self.folder / row.depth_path, size=self._size)

    def read_quality(self, row: FrameRow) -> Planes | None:
        """Read a frame's quality planes: (H, W) float16 each, by name; None where it has none.

        The manifest's ``quality`` says what each holds, and in which unit.

        Raises:
            FormatError: the file is missing, damaged, or of another size than the camera's.
        """
        if row.quality_path is None:
            return None
        return read_quality(self.folder / row.quality_path, size=self._size)

    def read_defects(self) -> tuple[DefectRecord, ...]:
        """Read what is marked in the frames; () where nothing is.

        Raises:
            FormatError: ``defects.json`` is damaged.
        """
        return read_defects(self.folder / DEFECTS)

    @property
    def _size(self) -> tuple[int, int]:
        return self.camera.height_px, self.camera.width_px


def read_bridge(folder: Place) -> Bridge:
    """Read the documents of a bridge folder; no image is opened.

    Args:
        folder: a whole bridge, as :func:`civil_rgbd.format.layout.bridge_folders` finds them.

    Raises:
        FormatError: a document is missing, damaged, or they do not fit each other.
    """
    folder = place_of(folder)
    manifest = read_manifest(folder / MANIFEST)
    camera = read_intrinsics(folder / INTRINSICS)
    rows = read_index(folder / FRAMES)
    _refuse_odd_rows(rows, folder / FRAMES)
    poses = read_poses(folder / POSES)
    return Bridge(folder, manifest, camera, _with_poses(rows, poses, folder))


def _refuse_odd_rows(rows: Sequence[FrameRow], where: Place) -> None:
    """Refuse paths that lead out of the folder, and ids or stamps that do not ascend."""
    for row in rows:
        paths = (row.rgb_path, row.depth_path, row.quality_path)
        if any(path is not None and not _PATH.fullmatch(path) for path in paths):
            raise FormatError(
                f"frame {row.frame_id} has paths {paths!r}, not rgb/ID.jpg and depth/ID.exr",
                where=where,
                fix="build the bridge again, or download it again",
            )
    for before, after in pairwise(rows):
        if after.source_index <= before.source_index or after.stamp_ns <= before.stamp_ns:
            raise FormatError(
                f"frame {after.frame_id} ({after.stamp_ns} ns) follows frame {before.frame_id} "
                f"({before.stamp_ns} ns): ids and stamps do not ascend",
                where=where,
                fix="build the bridge again; `civil-rgbd validate` lists every such place",
            )


def _with_poses(
    rows: tuple[FrameRow, ...], poses: FramePoses, folder: Place
) -> tuple[FrameRow, ...]:
    """Return the rows with the poses of ``poses.json``: it is the law, the index repeats it."""
    ids = tuple(row.frame_id for row in rows)
    stamps_ns = np.array([row.stamp_ns for row in rows], dtype=np.int64)
    if ids != poses.frame_ids or not np.array_equal(stamps_ns, poses.stamps_ns):
        raise FormatError(
            f"{POSES} ({len(poses.frame_ids)} frames) and {FRAMES} ({len(ids)}) do not hold the "
            "same frames with the same stamps",
            where=folder,
            fix="build the bridge again, or download it again",
        )
    law = np.concatenate([poses.translations_m, poses.quaternions_xyzw], axis=1)
    index = np.array(
        [(r.tx, r.ty, r.tz, r.qx, r.qy, r.qz, r.qw) for r in rows], dtype=np.float64
    ).reshape(len(rows), 7)
    other = np.flatnonzero((law != index).any(axis=1))
    if not len(other):
        return rows
    warnings.warn(
        f"{folder / FRAMES} repeats other poses than {POSES} for {len(other)} frames, the first "
        f"is {ids[int(other[0])]}: those of {POSES} are used",
        PoseMismatchWarning,
        stacklevel=3,
    )
    corrected = list(rows)
    for place in other.tolist():
        tx, ty, tz, qx, qy, qz, qw = law[place].tolist()
        corrected[place] = dataclasses.replace(
            rows[place], tx=tx, ty=ty, tz=tz, qx=qx, qy=qy, qz=qz, qw=qw
        )
    return tuple(corrected)
