"""Sets of one folder of images, one of depth, and documents beside them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from civil_rgbd.errors import RecordingError
from civil_rgbd.importers.assembly import Parts, assemble
from civil_rgbd.importers.cameras import camera_from_text, find_camera, read_camera
from civil_rgbd.importers.folders import (
    COLOUR_FOLDERS,
    DEPTH_FOLDERS,
    Pair,
    find_folders,
    list_images,
    pair_images,
)
from civil_rgbd.importers.pixels import read_colour
from civil_rgbd.importers.pose_tables import PoseTable, find_poses, read_pose_table
from civil_rgbd.importers.rendered_set import ImportOptions, Intrinsics, RenderedSet
from civil_rgbd.importers.stamps import find_stamps, stamps_of


@dataclass(frozen=True, slots=True)
class Layout:
    """How one kind of set is laid out.

    Attributes:
        importer: its name.
        scale: stored depth units a metre.
        colour: names of the colour folder, the first that is there wins.
        depth: names of the depth folder.
        usual_camera: the camera that the set's makers state, for images of its size; None where
            every set has its own.
    """

    importer: str
    scale: float
    colour: Sequence[str] = COLOUR_FOLDERS
    depth: Sequence[str] = DEPTH_FOLDERS
    usual_camera: Intrinsics | None = None


def open_folder_set(source: Path, options: ImportOptions, layout: Layout) -> RenderedSet:
    """Open a set of two folders of images that have equal names.

    Raises:
        RecordingError: something is missing, or does not fit.
    """
    root, colour, depth = find_folders(source, layout.colour, layout.depth)
    pairs, lonely = pair_images(list_images(colour), list_images(depth))
    camera, camera_files, warnings = camera_of(root, pairs, options, layout)
    stamps_path = options.stamps or find_stamps(root)
    parts = Parts(
        root=root,
        importer=layout.importer,
        pairs=pairs,
        stamps_ns=stamps_of(pairs, stamps_path),
        table=poses_of(root, options),
        intrinsics=camera,
        declared_scale=layout.scale,
        documents=(*camera_files, *((stamps_path,) if stamps_path else ())),
        skipped={"depth_without_image": lonely},
        warnings=warnings,
    )
    return assemble(parts, options)


def poses_of(root: Path, options: ImportOptions) -> PoseTable:
    """Read the poses that the user names, or that lie in the set.

    Raises:
        RecordingError: there are none.
    """
    path = options.poses or find_poses(root)
    if path is None:
        raise RecordingError(
            "no poses are found; a bridge needs to know where each image was taken",
            where=root,
            fix="give a file: --poses FILE, rows `id tx ty tz qx qy qz qw` or matrices",
        )
    return read_pose_table(path)


def camera_of(
    root: Path, pairs: Sequence[Pair], options: ImportOptions, layout: Layout
) -> tuple[Intrinsics, tuple[Path, ...], tuple[str, ...]]:
    """Return the camera that the user names, that lies in the set, or that is usual for it.

    Returns:
        the camera; the files read; what a reader must know, in words.

    Raises:
        RecordingError: there is none.
    """
    if options.intrinsics:
        path = Path(options.intrinsics)
        if path.is_file():
            return read_camera(path), (path,), ()
        return camera_from_text(options.intrinsics), (), ()
    found = find_camera(root)
    if found:
        return read_camera(found), (found,), ()
    usual = layout.usual_camera
    if usual is not None:
        height, width = read_colour(pairs[0].rgb).shape[:2]
        if (width, height) == (usual.width_px, usual.height_px):
            numbers = (usual.fx_px, usual.fy_px, usual.cx_px, usual.cy_px)
            words = ", ".join(f"{number:g}" for number in numbers)
            return usual, (), (f"no intrinsics in the set: took {layout.importer}'s usual {words}",)
    raise RecordingError(
        "no camera intrinsics are found",
        where=root,
        fix="give a file, or fx,fy,cx,cy in pixels: --intrinsics 638.3,636.5,635.7,366.1",
    )
