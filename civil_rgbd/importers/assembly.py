"""Images, depth, poses and stamps of a set, joined: who belongs to whom, and who to nobody."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.constants import NS_PER_S
from civil_rgbd.errors import RecordingError
from civil_rgbd.geometry.trajectory import Trajectory
from civil_rgbd.geometry.transforms import compose, inverse, quaternion_from_matrix
from civil_rgbd.importers.folders import IMAGE_SUFFIXES, Pair, indices_of
from civil_rgbd.importers.numbers import is_number, stamp_ns
from civil_rgbd.importers.pose_tables import PoseTable
from civil_rgbd.importers.rendered_set import (
    ImportOptions,
    Intrinsics,
    RenderedSet,
    SetFrame,
)

MAX_GAP_NS = NS_PER_S // 4
"""Poses further apart are not interpolated between: as the recipes have it."""

Poses = list[NDArray[np.float64] | None]


@dataclass(frozen=True, slots=True, eq=False)
class Parts:
    """What an importer found, before it is joined.

    Attributes:
        root: the set's folder.
        importer: its name.
        pairs: one a colour image, in order.
        stamps_ns: one an image; None where the set has none.
        table: the poses.
        intrinsics: of the colour images.
        declared_scale: stored depth units a metre.
        keys_are_stamps: the table's keys are stamps, even where they look like images' names.
        depth_intrinsics: of the depth images, where they have their own.
        documents: the files read besides images and poses.
        skipped: what was left out already, by name.
        warnings: what a reader must know, in words.
    """

    root: Path
    importer: str
    pairs: Sequence[Pair]
    stamps_ns: Sequence[int] | None
    table: PoseTable
    intrinsics: Intrinsics
    declared_scale: float
    keys_are_stamps: bool = False
    depth_intrinsics: Intrinsics | None = None
    documents: tuple[Path, ...] = ()
    skipped: dict[str, int] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()


def assemble(parts: Parts, options: ImportOptions) -> RenderedSet:
    """Join the parts of a set.

    Raises:
        RecordingError: poses and images do not fit each other, or stamps do not ascend.
    """
    warnings = list(parts.warnings)
    poses, stamps = match_poses(parts)
    if stamps is None:
        stamps = [place * NS_PER_S for place in range(len(parts.pairs))]
        warnings.append("the set has no time stamps: its images are stamped one second apart")
    _require_ascending(stamps, parts.root)
    if options.direction == "map-to-camera":
        poses = [None if T is None else inverse(T) for T in poses]
    if parts.intrinsics.fy_px < 0:
        poses = [None if T is None else mirrored(T) for T in poses]
        warnings.append(
            "fy is negative: the map is mirrored, y to -y, and fy made positive; pixels stay"
        )
    dropped = {"no_depth_image": 0, "no_pose": 0}
    frames = []
    rows = zip(indices_of(parts.pairs), parts.pairs, stamps, poses, strict=True)
    for index, pair, stamp, T in rows:
        if pair.depth is None:
            dropped["no_depth_image"] += 1
        elif T is None:
            dropped["no_pose"] += 1
        else:
            frames.append(SetFrame(index, stamp, pair.rgb, pair.depth, T))
    images = [path for pair in parts.pairs for path in (pair.rgb, pair.depth) if path]
    return RenderedSet(
        root=parts.root,
        importer=parts.importer,
        frames=tuple(frames),
        intrinsics=parts.intrinsics,
        depth_intrinsics=parts.depth_intrinsics,
        declared_scale=parts.declared_scale,
        files=(*parts.documents, *parts.table.files, *images),
        images_seen=len(parts.pairs),
        dropped={reason: count for reason, count in dropped.items() if count},
        skipped={reason: count for reason, count in parts.skipped.items() if count},
        warnings=tuple(warnings),
    )


def mirrored(T_map_camera: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return ``M T M`` with ``M = diag(1, -1, 1)``: y turns round in camera and map; det R stays.

    >>> T = np.eye(4); T[:3, 3] = 1.0, 2.0, 3.0
    >>> mirrored(T)[:3, 3]
    array([ 1., -2.,  3.])
    """
    M = np.diag([1.0, -1.0, 1.0, 1.0])
    turned: NDArray[np.float64] = compose(M, T_map_camera, M) + 0.0  # + 0.0: no -0.0
    return turned


def match_poses(parts: Parts) -> tuple[Poses, Sequence[int] | None]:
    """Give every image its pose.

    By the table's keys where they are the images' names; else by stamps where both have some; else
    by order where there are as many poses as images.

    Returns:
        one pose an image, None where it has none; and the stamps, which may be the table's keys.

    Raises:
        RecordingError: none of these.
    """
    table, pairs, stamps_ns = parts.table, parts.pairs, parts.stamps_ns
    if table.keys_are_places and len(table.transforms) == len(pairs):
        return [_or_none(T) for T in table.transforms], stamps_ns
    named = None if parts.keys_are_stamps else _by_name(table, pairs)
    if named is not None:
        return named, stamps_ns
    if table.keys is not None and stamps_ns is not None:
        return _by_stamp(table, stamps_ns), stamps_ns
    if len(table.transforms) != len(pairs):
        raise RecordingError(
            f"there are {len(table.transforms)} poses for {len(pairs)} images, and nothing says "
            "which belongs to which",
            where=table.path,
            fix="put the image's name before each pose, or give the images' stamps: --stamps FILE",
        )
    if table.keys is not None and all(map(is_number, table.keys)):
        stamps_ns = [stamp_ns(key, where=table.path) for key in table.keys]
    return [_or_none(T) for T in table.transforms], stamps_ns


def _by_name(table: PoseTable, pairs: Sequence[Pair]) -> Poses | None:
    """Poses by image name, when at least half of the images or of the poses find each other."""
    if table.keys is None:
        return None
    places: dict[object, int] = {}
    count = all(_is_whole(_stem(key)) for key in table.keys)  # else numbers are stamps, no names
    for place, key in enumerate(table.keys):
        for name in _names_of(key, count=count):
            if places.setdefault(name, place) != place:
                raise RecordingError(
                    f"two poses are named {key!r}", where=table.path, fix="keep one of them"
                )
    found = [
        next((places[name] for name in (pair.rgb.stem, pair.key) if name in places), None)
        for pair in pairs
    ]
    hits = sum(place is not None for place in found)
    if 2 * hits < min(len(pairs), len(table.keys)):
        return None
    return [None if place is None else _or_none(table.transforms[place]) for place in found]


def _names_of(key: str, *, count: bool) -> set[object]:
    stem = _stem(key)
    if not count:
        return {stem}
    # Through a float a stamp of 19 digits would lose its last ones.
    return {stem, int(stem) if stem.isdecimal() else int(float(stem))}


def _stem(key: str) -> str:
    name = Path(key).name
    return Path(name).stem if Path(name).suffix.lower() in IMAGE_SUFFIXES else name


def _is_whole(word: str) -> bool:
    return is_number(word) and float(word).is_integer()  # false for nan and inf


def _or_none(T: NDArray[np.float64]) -> NDArray[np.float64] | None:
    return T if np.isfinite(T).all() else None


def _by_stamp(table: PoseTable, stamps_ns: Sequence[int]) -> Poses:
    """Poses at the images' stamps: between two poses where they are near enough, never beyond."""
    finite = [place for place, T in enumerate(table.transforms) if np.isfinite(T).all()]
    keys = table.keys or ()
    pose_stamps = [stamp_ns(keys[place], where=table.path) for place in finite]
    try:
        trajectory = Trajectory(
            stamps_ns=np.array(pose_stamps, dtype=np.int64),
            translations_m=table.transforms[finite, :3, 3],
            quaternions_xyzw=np.array(
                [quaternion_from_matrix(table.transforms[place, :3, :3]) for place in finite]
            ).reshape(-1, 4),
        )
    except ValueError as error:
        raise RecordingError(
            f"the poses are no trajectory: {error}", where=table.path, fix="sort them by stamp"
        ) from error
    wanted = np.array(stamps_ns, dtype=np.int64)
    covered = trajectory.covers(wanted, max_gap_ns=MAX_GAP_NS)
    if not covered.any():
        raise RecordingError(
            f"no image lies within the poses' time: images {int(wanted.min())} to "
            f"{int(wanted.max())} ns, poses {trajectory.start_ns} to {trajectory.end_ns} ns",
            where=table.path,
            fix="give the stamps of both on one clock: --stamps FILE, --poses FILE",
        )
    transforms = iter(trajectory.transforms_at(wanted[covered]))
    return [next(transforms) if has else None for has in covered]


def _require_ascending(stamps_ns: Sequence[int], root: Path) -> None:
    for place, (before, after) in enumerate(pairwise(stamps_ns), start=1):
        if after <= before:
            raise RecordingError(
                f"the stamp of image {place} ({after} ns) is not after the one before ({before} "
                "ns)",
                where=root,
                fix="sort the images by time, or give other stamps: --stamps FILE",
            )
