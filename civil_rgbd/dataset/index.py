"""Every chosen frame of a dataset as a few arrays: what a worker needs to know, and nothing more.

Ten thousand Python objects would be touched by each forked worker, and each touch (a reference
count) copies the page that the object lies on: resident memory would grow over an epoch. Arrays are
one object each, and cheap to pickle.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.dataset.splits import (
    FrameChoice,
    Split,
    choose_bridges,
    choose_split,
    refuse_strange_bridges,
    rows_of_frames,
    rows_of_split,
)
from civil_rgbd.errors import UsageError
from civil_rgbd.format.datasets import read_dataset
from civil_rgbd.format.layout import DATASET, MANIFEST, bridge_folders, is_bridge
from civil_rgbd.format.manifest import quality_channels, read_manifest
from civil_rgbd.format.reader import Bridge, read_bridge
from civil_rgbd.geometry.transforms import matrix_from_quaternion, transform_from
from civil_rgbd.storage.places import Place


@dataclass(frozen=True, slots=True, eq=False)
class FrameIndex:
    """F frames of B bridges, in the order of bridge ids, and of a bridge in the order of stamps.

    Attributes:
        bridges: ids.
        folders: of the bridges.
        sizes_px: (B, 2) int32, height and width of the images.
        intrinsics: (B, 3, 3) float32.
        bridge_numbers: (F,) int32, places in ``bridges``.
        rows: (F,) int32, the frame's row in its bridge: neighbours differ by one.
        stamps_ns: (F,) int64.
        T_map_camera: (F, 4, 4) float64.
        frame_ids: (F,) bytes.
        rgb_paths: (F,) bytes, relative to the bridge folder.
        depth_paths: (F,) bytes, relative to the bridge folder.
        quality_planes: names of the quality planes that every bridge has, in order; () without.
        quality_paths: (F,) bytes, relative to the bridge folder; empty where there is none.
    """

    bridges: tuple[str, ...]
    folders: tuple[Place, ...]
    sizes_px: NDArray[np.int32]
    intrinsics: NDArray[np.float32]
    bridge_numbers: NDArray[np.int32]
    rows: NDArray[np.int32]
    stamps_ns: NDArray[np.int64]
    T_map_camera: NDArray[np.float64]
    frame_ids: NDArray[np.bytes_]
    rgb_paths: NDArray[np.bytes_]
    depth_paths: NDArray[np.bytes_]
    quality_planes: tuple[str, ...]
    quality_paths: NDArray[np.bytes_]

    def __len__(self) -> int:
        """Count the frames."""
        return len(self.stamps_ns)


def read_index(
    location: Place,
    *,
    bridges: str | Iterable[str] | None = None,
    split: str | None = None,
    frames: FrameChoice | None = None,
) -> FrameIndex:
    """Read what is to be known of the chosen frames; no image is opened.

    Args:
        location: a dataset folder or one bridge folder.
        bridges: ids of bridges; None for all.
        split: name of a split in ``dataset.json``; None for all frames.
        frames: ids of frames, in any bridge or by bridge; None for all.

    Returns:
        at least one frame.

    Raises:
        UsageError: a bridge, a split or a frame is not there, or nothing is left.
        FormatError: a document breaks the format, or a split names what is not there.
    """
    folders = _folders_by_id(location)
    chosen = choose_bridges(folders, bridges, where=location)
    read = {bridge: read_bridge(folders[bridge]) for bridge in chosen}
    ids = {bridge: [row.frame_id for row in one.rows] for bridge, one in read.items()}
    rows = {bridge: np.arange(len(some)) for bridge, some in ids.items()}
    if split is not None:
        part = _split_of(location, split)
        where = f"{location / DATASET}, split {split!r}"
        refuse_strange_bridges(part, folders if bridges is None else None, where=where)
        rows = rows_of_split(part, ids, where=where)
    if frames is not None:
        rows = rows_of_frames(frames, rows, ids, where=location)
    kept = {bridge: (read[bridge], some) for bridge, some in rows.items() if len(some)}
    if not kept:
        raise UsageError(
            f"no frame is left with bridges={bridges!r}, split={split!r}, frames={frames!r}",
            where=location,
            fix=f"choose more: the bridges {', '.join(chosen)} have "
            f"{sum(map(len, ids.values()))} frames",
        )
    return _joined(kept)


def _folders_by_id(location: Place) -> dict[str, Place]:
    if is_bridge(location):  # a bridge folder that was renamed still knows its id
        return {read_manifest(location / MANIFEST).info.bridge_id: location}
    folders = bridge_folders(location)
    if not folders:
        raise UsageError(
            "the dataset has no whole bridge",
            where=location,
            fix=f"build one: `civil-rgbd build --recipe 250k --out {location} RECORDING`",
        )
    return folders


def _split_of(location: Place, split: str) -> Split:
    if is_bridge(location):
        raise UsageError(
            f"split={split!r} needs a dataset; this is one bridge folder",
            where=location,
            fix="give the folder that has dataset.json, or leave split= out",
        )
    return choose_split(read_dataset(location / DATASET).splits, split, where=location / DATASET)


def _joined(kept: Mapping[str, tuple[Bridge, NDArray[np.int64]]]) -> FrameIndex:
    rows = [bridge.rows[row] for bridge, some in kept.values() for row in some]
    cameras = [bridge.camera for bridge, _ in kept.values()]
    counts = [len(some) for _, some in kept.values()]
    rotations = matrix_from_quaternion([(row.qx, row.qy, row.qz, row.qw) for row in rows])
    return FrameIndex(
        bridges=tuple(kept),
        folders=tuple(bridge.folder for bridge, _ in kept.values()),
        sizes_px=np.array([(c.height_px, c.width_px) for c in cameras], dtype=np.int32),
        intrinsics=np.stack([camera.matrix for camera in cameras]).astype(np.float32),
        bridge_numbers=np.repeat(np.arange(len(kept), dtype=np.int32), counts),
        rows=np.concatenate([some for _, some in kept.values()]).astype(np.int32),
        stamps_ns=np.array([row.stamp_ns for row in rows], dtype=np.int64),
        T_map_camera=transform_from(rotations, [(row.tx, row.ty, row.tz) for row in rows]),
        frame_ids=np.array([row.frame_id.encode() for row in rows]),
        rgb_paths=np.array([row.rgb_path.encode() for row in rows]),
        depth_paths=np.array([row.depth_path.encode() for row in rows]),
        quality_planes=_shared_planes([bridge for bridge, _ in kept.values()]),
        quality_paths=np.array([(row.quality_path or "").encode() for row in rows]),
    )


def _shared_planes(bridges: Iterable[Bridge]) -> tuple[str, ...]:
    """The quality planes that all bridges have: samples of one dataset have one shape."""
    names = [set(quality_channels(bridge.manifest)) for bridge in bridges]
    return tuple(sorted(set.intersection(*names)))
