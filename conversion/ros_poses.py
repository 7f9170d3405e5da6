"""Poses of a recording to a trajectory, and tf to what stands still and what moves."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.constants import NS_PER_S
from civil_rgbd.conversion.clocks import ascending
from civil_rgbd.conversion.frame_tree import FrameTree
from civil_rgbd.conversion.gathering import GatheredTransforms
from civil_rgbd.errors import RecordingError
from civil_rgbd.geometry.trajectory import Trajectory
from civil_rgbd.geometry.transforms import matrix_from_quaternion, transform_from, unit_quaternion

_NORM_TOLERANCE: Final = 1e-3  # float32 and a few digits pass; a forgotten quaternion does not
_STILL_TOLERANCE: Final = 1e-9


def without_broken(
    stamps_ns: NDArray[np.int64], poses: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.float64], dict[str, int]]:
    """Leave out what damage may do to single poses.

    Args:
        stamps_ns: (P,) in message order.
        poses: (P, 7) tx ty tz qx qy qz qw.

    Returns:
        stamps and poses of those that are poses and whose stamps ascend; how many are left out, by
        reason. Where hardly any would stay, all of them: that is no damage.
    """
    proper = np.flatnonzero(_are_poses(poses))
    kept = proper[ascending(stamps_ns[proper])]
    counts = {"pose-broken": len(poses) - len(proper), "pose-stamp-astray": len(proper) - len(kept)}
    if 2 * len(kept) < len(poses):
        return stamps_ns, poses, {}
    return stamps_ns[kept], poses[kept], {name: count for name, count in counts.items() if count}


def trajectory_from(
    stamps_ns: NDArray[np.int64], poses: NDArray[np.float64], *, where: object
) -> Trajectory:
    """Check and normalise recorded poses.

    Args:
        stamps_ns: (P,) in message order.
        poses: (P, 7) tx ty tz qx qy qz qw, metres.
        where: file and topic, for errors.

    Raises:
        RecordingError: stamps repeat or step back, or a pose is no pose.
    """
    _check_order(stamps_ns, where)
    bad = ~_are_poses(poses)
    if bad.any():
        at = int(np.argmax(bad))
        raise RecordingError(
            f"pose {at} is no pose: translation {poses[at, :3].tolist()}, quaternion xyzw "
            f"{poses[at, 3:].tolist()} of norm {_norms(poses)[at]:.6g}",
            where=where,
            fix="choose other poses with --pose-topic, or leave out single ones: --salvage",
        )
    return Trajectory(stamps_ns, poses[:, :3].copy(), unit_quaternion(poses[:, 3:]))


def _are_poses(poses: NDArray[np.float64]) -> NDArray[np.bool_]:
    finite, of_norm_1 = np.isfinite(poses), np.abs(_norms(poses) - 1) <= _NORM_TOLERANCE
    proper: NDArray[np.bool_] = finite.all(axis=1) & of_norm_1
    return proper


def _norms(poses: NDArray[np.float64]) -> NDArray[np.float64]:
    with np.errstate(invalid="ignore", over="ignore"):  # broken poses are refused by their norm
        norms: NDArray[np.float64] = np.sqrt((poses[:, 3:] ** 2).sum(axis=1))
    return norms


def _check_order(stamps_ns: NDArray[np.int64], where: object) -> None:
    steps = np.diff(stamps_ns)
    if not (steps <= 0).any():
        return
    at = int(np.argmax(steps <= 0)) + 1
    here, before = int(stamps_ns[at]), int(stamps_ns[at - 1])
    relation = "the same as" if here == before else "earlier than"
    raise RecordingError(
        f"pose {at} is stamped {_seconds(here)}, {relation} pose {at - 1} at {_seconds(before)}",
        where=where,
        fix="choose other poses with --pose-topic, record from one publisher only, or leave out "
        "single ones: --salvage",
    )


def _seconds(stamp_ns: int) -> str:
    return f"{stamp_ns // NS_PER_S}.{stamp_ns % NS_PER_S:09d} s"


@dataclass(frozen=True, slots=True, eq=False)
class MovingLink:
    """A frame that moves in another, as tf says.

    Attributes:
        parent: the frame it moves in.
        child: the frame that moves.
        stamps_ns: (P,) in message order.
        poses: (P, 7) tx ty tz qx qy qz qw.
    """

    parent: str
    child: str
    stamps_ns: NDArray[np.int64]
    poses: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Transforms:
    """All tf of a recording.

    Attributes:
        fixed: the frames that do not move against each other.
        moving: the others.
        changed: static links that were published with different values; the last one holds.
        broken: links without a proper rotation, left out.
    """

    fixed: FrameTree
    moving: tuple[MovingLink, ...]
    changed: tuple[str, ...]
    broken: tuple[str, ...]


def transforms_from(
    static: list[GatheredTransforms], other: list[GatheredTransforms]
) -> Transforms:
    """Sort tf into what stands still and what moves.

    Links on ``/tf`` that never change are taken for fixed: many drivers publish so.

    Args:
        static: from tf_static topics.
        other: from tf topics.
    """
    fixed, moving = FrameTree(), []
    changed, broken = [], []
    for gathered in (*static, *other):
        for (parent, child), history in gathered.links.items():
            stamps_ns, poses = history.in_order()
            norms = _norms(poses)
            with np.errstate(invalid="ignore", over="ignore"):  # of broken ones
                still = bool((np.abs(poses - poses[0]) <= _STILL_TOLERANCE).all())
            name = f"{parent} -> {child}"
            if gathered in static or still:
                if not (abs(norms[-1] - 1) <= _NORM_TOLERANCE and np.isfinite(poses[-1]).all()):
                    broken.append(name)
                    continue
                if not still:
                    changed.append(name)
                fixed.link(parent, child, _matrix(poses[-1]))
            else:
                moving.append(MovingLink(parent, child, stamps_ns, poses))
    return Transforms(fixed, tuple(moving), tuple(changed), tuple(broken))


def _matrix(pose: NDArray[np.float64]) -> NDArray[np.float64]:
    return transform_from(matrix_from_quaternion(unit_quaternion(pose[3:])), pose[:3])


def link_that_carries(sensor: str, transforms: Transforms) -> list[MovingLink]:
    """Return the moving links whose child is fixed to a sensor: wheels and arms are not."""
    return [
        link for link in transforms.moving if transforms.fixed.find(link.child, sensor) is not None
    ]
