"""Is the frame index in order, and does it agree with the poses?"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.domain.frame import FrameRow, frame_id_from
from civil_rgbd.format.layout import (
    FRAMES,
    IMAGE_SUFFIXES,
    POSES,
    depth_path,
    quality_path,
    rgb_path,
)
from civil_rgbd.format.poses import FramePoses
from civil_rgbd.geometry.trajectory import UNIT_NORM_TOLERANCE
from civil_rgbd.validation.documents import BridgeDocuments
from civil_rgbd.validation.report import Finding

_POSE_COLUMNS: Final = ("tx", "ty", "tz", "qx", "qy", "qz", "qw")


def check_index(read: BridgeDocuments, bridge: str) -> Iterator[Finding]:
    """Check ids, paths and stamps of the rows, by themselves and against the rig.

    Args:
        read: the bridge's documents.
        bridge: its name in findings.
    """
    rows = read.rows or ()
    for row in rows:
        for code, message in _row_faults(row):
            yield Finding(code, f"frame {row.frame_id}: {message}", FRAMES, bridge)
    for code, message in _order_faults(rows):
        yield Finding(code, message, FRAMES, bridge)
    rig = read.manifest.rig if read.manifest else None
    if rig is None:
        return
    offset_ns = round(rig.camera_time_offset_s * 1e9)
    for row in rows:
        if row.stamp_ns - row.source_stamp_ns != offset_ns:
            message = (
                f"frame {row.frame_id}: stamp_ns - source_stamp_ns is "
                f"{row.stamp_ns - row.source_stamp_ns}, the rig's time offset is {offset_ns}"
            )
            yield Finding("stamp-offset", message, FRAMES, bridge)


def _row_faults(row: FrameRow) -> Iterator[tuple[str, str]]:
    if row.frame_id != frame_id_from(row.source_index):
        yield "frame-id-mismatch", f"source_index is {row.source_index}"
    if row.rgb_path not in [rgb_path(row.frame_id, codec) for codec in IMAGE_SUFFIXES]:
        yield "index-path", f"rgb_path is {row.rgb_path!r}"
    if row.depth_path != depth_path(row.frame_id):
        yield "index-path", f"depth_path is {row.depth_path!r}"
    if row.quality_path not in (None, quality_path(row.frame_id)):
        yield "index-path", f"quality_path is {row.quality_path!r}"


def _order_faults(rows: tuple[FrameRow, ...]) -> Iterator[tuple[str, str]]:
    seen: set[str] = set()
    for row in rows:
        if row.frame_id in seen:
            yield "frame-id-duplicate", f"frame {row.frame_id} comes twice"
        seen.add(row.frame_id)
    for before, after in pairwise(rows):
        if after.source_index < before.source_index:
            yield "frame-id-order", f"frame {after.frame_id} follows frame {before.frame_id}"
        if after.stamp_ns <= before.stamp_ns:
            yield (
                "stamp-order",
                (
                    f"frame {after.frame_id} ({after.stamp_ns} ns) follows frame "
                    f"{before.frame_id} ({before.stamp_ns} ns)"
                ),
            )


def check_poses(read: BridgeDocuments, bridge: str) -> Iterator[Finding]:
    """Check the rotations of ``poses.json``, and that the index repeats it.

    Args:
        read: the bridge's documents.
        bridge: its name in findings.
    """
    if read.poses is None:
        return
    yield from _quaternion_findings(read.poses, bridge)
    if read.rows is not None:
        yield from _agreement(read.poses, read.rows, bridge)


def _quaternion_findings(poses: FramePoses, bridge: str) -> Iterator[Finding]:
    norms: NDArray[np.float64] = np.sqrt((poses.quaternions_xyzw**2).sum(axis=1))
    for place in np.flatnonzero(~(np.abs(norms - 1) <= UNIT_NORM_TOLERANCE)).tolist():
        message = f"frame {poses.frame_ids[place]}: the norm is {norms[place]!r}"
        yield Finding("quaternion-norm", message, POSES, bridge)
    for place in np.flatnonzero(poses.quaternions_xyzw[:, 3] < 0).tolist():
        message = f"frame {poses.frame_ids[place]}: w is {poses.quaternions_xyzw[place, 3]!r}"
        yield Finding("quaternion-sign", message, POSES, bridge)


def _agreement(poses: FramePoses, rows: tuple[FrameRow, ...], bridge: str) -> Iterator[Finding]:
    ids = tuple(row.frame_id for row in rows)
    if ids != poses.frame_ids:
        only_poses = sorted(set(poses.frame_ids) - set(ids))
        only_index = sorted(set(ids) - set(poses.frame_ids))
        message = (
            f"{len(poses.frame_ids)} frames, {FRAMES} has {len(ids)}; only here: "
            f"{_few(only_poses)}; only there: {_few(only_index)}"
        )
        yield Finding("poses-frames", message, POSES, bridge)
        return
    law = np.concatenate([poses.translations_m, poses.quaternions_xyzw], axis=1)
    for place, row in enumerate(rows):
        if row.stamp_ns != poses.stamps_ns[place]:
            message = (
                f"frame {row.frame_id}: stamp_ns is {poses.stamps_ns[place]}, "
                f"{FRAMES} has {row.stamp_ns}"
            )
            yield Finding("poses-frames", message, POSES, bridge)
        columns = [getattr(row, name) for name in _POSE_COLUMNS]
        if law[place].tolist() != columns:
            message = f"frame {row.frame_id}: {POSES} has {law[place].tolist()}, not {columns}"
            yield Finding("pose-mismatch", message, FRAMES, bridge)


def _few(names: list[str]) -> str:
    shown = ", ".join(names[:3]) or "none"
    return shown + (f" and {len(names) - 3} more" if len(names) > 3 else "")
