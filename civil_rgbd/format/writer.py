"""Bridge folders, written frame by frame and then published whole."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from civil_rgbd.domain.bridge import Manifest
from civil_rgbd.domain.frame import FrameRow, RgbdFrame
from civil_rgbd.domain.recipe import ImageStage
from civil_rgbd.errors import OutputError
from civil_rgbd.format.atomic import publish_folder, sync_tree, whole_file, writing
from civil_rgbd.format.depth_exr import write_depth
from civil_rgbd.format.hashes import bytes_sha256, pixel_sha256
from civil_rgbd.format.images import decode_image, encode_image
from civil_rgbd.format.index import write_index
from civil_rgbd.format.intrinsics import write_intrinsics
from civil_rgbd.format.layout import (
    FRAMES,
    INTRINSICS,
    MANIFEST,
    POSES,
    depth_path,
    quality_path,
    rgb_path,
)
from civil_rgbd.format.manifest import write_manifest
from civil_rgbd.format.poses import write_poses
from civil_rgbd.format.quality_exr import quality_sha256, write_quality
from civil_rgbd.format.remote_folders import keep_only, publish_objects
from civil_rgbd.geometry.camera import PinholeCamera
from civil_rgbd.geometry.transforms import quaternion_from_matrix
from civil_rgbd.storage.places import Place
from civil_rgbd.storage.remote_path import RemotePath


def write_frame(folder: Place, frame: RgbdFrame, *, stage: ImageStage) -> FrameRow:
    """Write the files of one frame into an unfinished bridge folder.

    Each file is whole or absent, but not yet on the disk for sure: :func:`finish_bridge` sees to
    that once for all of them.

    Args:
        folder: the unfinished bridge.
        frame: what to write.
        stage: codec, quality and subsampling of the colour image.

    Returns:
        the frame's row of ``frames.parquet``.

    Raises:
        ValueError: the depth holds NaN, Inf, -0.0 or a negative value, or a quality plane does.
        OutputError: a file cannot be written.
    """
    rgb_to = rgb_path(frame.frame_id, stage.codec)
    depth_to = depth_path(frame.frame_id)
    with writing(folder):
        (folder / rgb_to).parent.mkdir(parents=True, exist_ok=True)
        (folder / depth_to).parent.mkdir(parents=True, exist_ok=True)
    rgb_data = encode_image(
        frame.rgb, codec=stage.codec, quality=stage.quality, subsampling=stage.subsampling
    )
    with whole_file(folder / rgb_to, sync=False) as scratch:
        scratch.write_bytes(rgb_data)
    depth_data = write_depth(folder / depth_to, frame.depth_m, sync=False)
    quality_to, quality_hashes = _write_quality(folder, frame)
    # JPEG changes pixels: the hash is of what a reader will see. PNG and EXR do not.
    stored_rgb = decode_image(rgb_data, where=rgb_to) if stage.codec == "jpeg" else frame.rgb
    position, q = frame.T_map_camera[:3, 3], quaternion_from_matrix(frame.T_map_camera[:3, :3])
    valid_share, depth_min_m, depth_max_m = depth_statistics(frame.depth_m)
    return FrameRow(
        frame_id=frame.frame_id,
        source_index=int(frame.source_index),
        stamp_ns=int(frame.stamp_ns),
        source_stamp_ns=int(frame.source_stamp_ns),
        rgb_path=rgb_to,
        depth_path=depth_to,
        quality_path=quality_to,
        tx=float(position[0]),
        ty=float(position[1]),
        tz=float(position[2]),
        qx=float(q[0]),
        qy=float(q[1]),
        qz=float(q[2]),
        qw=float(q[3]),
        valid_share=valid_share,
        depth_min_m=depth_min_m,
        depth_max_m=depth_max_m,
        rgb_file_sha256=bytes_sha256(rgb_data),
        rgb_pixel_sha256=pixel_sha256(stored_rgb),
        depth_file_sha256=bytes_sha256(depth_data),
        depth_pixel_sha256=pixel_sha256(frame.depth_m),
        quality_file_sha256=quality_hashes[0],
        quality_pixel_sha256=quality_hashes[1],
    )


def _write_quality(
    folder: Place, frame: RgbdFrame
) -> tuple[str | None, tuple[str | None, str | None]]:
    """Write a frame's quality planes, if it has any; return their path, file and pixel hash."""
    if frame.quality is None:
        return None, (None, None)
    path = quality_path(frame.frame_id)
    with writing(folder):
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
    data = write_quality(folder / path, frame.quality, sync=False)
    return path, (bytes_sha256(data), quality_sha256(frame.quality))


def depth_statistics(
    depth_m: np.ndarray[tuple[int, ...], np.dtype[np.float32]],
) -> tuple[float, float, float]:
    """Return the share of pixels with depth, and the smallest and largest depth of those.

    Args:
        depth_m: (H, W) float32, metres, 0 = nothing measured; no -0.0, nothing negative.

    Returns:
        share, metres, metres: each exactly a float32; 0 and 0 metres when no pixel has depth.
    """
    # Floats that are not negative are ordered as their bits are, and those are counted faster. One
    # less turns the zeros into the largest of all, ten times faster than picking the others out.
    bits = np.ascontiguousarray(depth_m).view(np.uint32)
    count = int(np.count_nonzero(bits))
    share = float(np.float32(count / depth_m.size))
    if not count:
        return share, 0.0, 0.0
    nearest_m = ((bits - np.uint32(1)).min() + np.uint32(1)).view(np.float32)
    return share, float(nearest_m), float(depth_m.max())


def finish_bridge(
    partial: Place,
    destination: Place,
    *,
    manifest: Manifest,
    camera: PinholeCamera,
    rows: Sequence[FrameRow],
    replace: bool,
) -> None:
    """Make an unfinished bridge folder whole, and let it appear by one rename.

    On object storage, which has no rename, it appears by its manifest.

    Args:
        partial: the unfinished bridge, with the files of every row; all else in it is removed.
        destination: where the bridge belongs, on the same file system or in the same bucket.
        manifest: what ``manifest.json`` says; written last.
        camera: of every image.
        rows: one a frame, in any order.
        replace: take the place of an existing bridge; without it one is an error.

    Raises:
        ValueError: two rows have one id, or the manifest counts other frames.
        OutputError: a frame's file is missing, or something cannot be written.
    """
    ordered = sorted(rows, key=lambda row: row.source_index)
    if len({row.frame_id for row in ordered}) != len(ordered):
        raise ValueError("two rows have the same frame id")
    if manifest.counts.frames_kept != len(ordered):
        raise ValueError(
            f"the manifest counts {manifest.counts.frames_kept} frames, there are {len(ordered)}"
        )
    if isinstance(partial, RemotePath):
        keep_only(partial, {path for row in ordered for path in row_paths(row)})
    else:
        with writing(partial):
            partial.mkdir(parents=True, exist_ok=True)
            _keep_only(partial, ordered)
    write_intrinsics(partial / INTRINSICS, camera)
    write_poses(partial / POSES, ordered)
    write_index(partial / FRAMES, ordered)
    sync_tree(partial)
    write_manifest(partial / MANIFEST, manifest)
    _publish(partial, destination, replace=replace)


def _publish(partial: Place, destination: Place, *, replace: bool) -> None:
    if isinstance(partial, RemotePath) and isinstance(destination, RemotePath):
        publish_objects(partial, destination, replace=replace, last=MANIFEST)
    elif isinstance(partial, Path) and isinstance(destination, Path):
        publish_folder(partial, destination, replace=replace)
    else:
        raise TypeError(f"{partial} and {destination} lie on different kinds of storage")


def row_paths(row: FrameRow) -> tuple[str, ...]:
    """Return the files that a row speaks of, relative to its bridge."""
    paths = (row.rgb_path, row.depth_path, row.quality_path)
    return tuple(path for path in paths if path is not None)


def _keep_only(partial: Path, rows: Sequence[FrameRow]) -> None:
    wanted = {path for row in rows for path in row_paths(row)}
    for entry in sorted(partial.iterdir()):
        if not entry.is_dir() or entry.is_symlink():
            entry.unlink()
            continue
        for inner in list(entry.iterdir()):
            if f"{entry.name}/{inner.name}" in wanted:
                wanted.discard(f"{entry.name}/{inner.name}")
            elif inner.is_dir() and not inner.is_symlink():
                shutil.rmtree(inner)
            else:
                inner.unlink()
        if not any(entry.iterdir()):
            entry.rmdir()
    if wanted:
        raise OutputError(
            f"{len(wanted)} files of the bridge are missing, the first is {min(wanted)}",
            where=partial,
            fix="start the build again; was the folder touched while it was written?",
        )
