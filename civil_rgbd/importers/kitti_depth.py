"""KITTI's depth layout: 16-bit PNG, metres x 256, 0 = none, under ``proj_depth/groundtruth``.

Understood are a drive (``image_02/data`` and ``proj_depth/groundtruth/image_02``, which KITTI ships
in two archives to be unpacked into one folder) and the cropped selection (``image``,
``groundtruth_depth``, ``intrinsics``). KITTI ships no poses with its depth: `--poses` names them,
or ``poses.txt`` beside the images, 3 x 4 by rows as in KITTI's odometry.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

from civil_rgbd.errors import RecordingError
from civil_rgbd.importers.assembly import Parts, assemble
from civil_rgbd.importers.folder_set import Layout, camera_of, open_folder_set, poses_of
from civil_rgbd.importers.folders import (
    Pair,
    find_folders,
    list_images,
    pair_images,
    require_folder,
)
from civil_rgbd.importers.rendered_set import ImportOptions, RenderedSet
from civil_rgbd.importers.stamps import find_stamps, stamps_of

LAYOUT: Final = Layout("kitti-depth", scale=256.0)
_SELECTION: Final = re.compile(r"_(image|groundtruth_depth|velodyne_raw)_(\d{10})_")


def open_set(source: Path, options: ImportOptions) -> RenderedSet:
    """Open one drive, or the cropped selection.

    Raises:
        RecordingError: something is missing, or does not fit.
    """
    require_folder(source)
    if (source / "groundtruth_depth").is_dir():
        return _selection(source, options)
    drives = sorted({path.parents[2] for path in source.glob("**/proj_depth/groundtruth/image_0*")})
    if not drives:
        return open_folder_set(source, options, LAYOUT)
    if len(drives) > 1:
        raise RecordingError(
            f"{len(drives)} drives lie here: {', '.join(drive.name for drive in drives)}",
            where=source,
            fix=f"convert them one by one, for example {drives[0]}",
        )
    return _drive(drives[0], options)


def _drive(drive: Path, options: ImportOptions) -> RenderedSet:
    cameras = sorted((drive / "proj_depth" / "groundtruth").glob("image_0*"))
    depth = cameras[0]
    colour = drive / depth.name / "data"
    if not colour.is_dir():
        raise RecordingError(
            f"there is depth, but no images in {depth.name}/data",
            where=drive,
            fix="unpack KITTI's raw data of this drive into the same folder",
        )
    pairs, lonely = pair_images(list_images(colour), list_images(depth))
    camera, camera_files, warnings = camera_of(_camera_root(drive), pairs, options, LAYOUT)
    if len(cameras) > 1:
        warnings += (f"took {depth.name} of {', '.join(path.name for path in cameras)}",)
    beside = colour.parent / "timestamps.txt"
    stamps_path = options.stamps or (beside if beside.is_file() else find_stamps(drive))
    parts = Parts(
        root=drive,
        importer=LAYOUT.importer,
        pairs=pairs,
        stamps_ns=stamps_of(pairs, stamps_path),
        table=poses_of(drive, options),
        intrinsics=camera,
        declared_scale=LAYOUT.scale,
        documents=(*camera_files, *((stamps_path,) if stamps_path else ())),
        skipped={"depth_without_image": lonely},
        warnings=warnings,
    )
    return assemble(parts, options)


def _camera_root(drive: Path) -> Path:
    """KITTI keeps one ``calib_cam_to_cam.txt`` a day, in the folder that holds the drives."""
    up = drive.parent
    return up if not _has_camera(drive) and _has_camera(up) else drive


def _has_camera(folder: Path) -> bool:
    return any((folder / name).is_file() for name in ("calib_cam_to_cam.txt", "intrinsics.json"))


def _selection(source: Path, options: ImportOptions) -> RenderedSet:
    root, colour, depth = find_folders(source, ("image",), ("groundtruth_depth",))
    depths = {_SELECTION.sub(r"_\2_", path.name): path for path in list_images(depth)}
    images = sorted(list_images(colour))
    names = [_SELECTION.sub(r"_\2_", path.name) for path in images]
    pairs = [Pair(name, path, depths.get(name)) for name, path in zip(names, images, strict=True)]
    per_image = sorted((root / "intrinsics").glob("*.txt"))
    if per_image and not options.intrinsics:
        texts = {path.read_text("utf-8") for path in per_image}
        raise RecordingError(
            f"the selection has {len(texts)} cameras in {len(per_image)} files; a bridge has one",
            where=root / "intrinsics",
            fix="convert the images of one camera, and name its file: --intrinsics FILE",
        )
    camera, camera_files, warnings = camera_of(root, pairs, options, LAYOUT)
    parts = Parts(
        root=root,
        importer=LAYOUT.importer,
        pairs=pairs,
        stamps_ns=stamps_of(pairs, options.stamps),
        table=poses_of(root, options),
        intrinsics=camera,
        declared_scale=LAYOUT.scale,
        documents=camera_files,
        skipped={"depth_without_image": len(depths.keys() - set(names))},
        warnings=warnings,
    )
    return assemble(parts, options)
