"""What a maintainer wants to know of a bridge in numbers: track, spacing, coverage, density."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.constants import NS_PER_S
from civil_rgbd.domain.frame import FrameRow
from civil_rgbd.format.reader import Bridge
from civil_rgbd.geometry.transforms import matrix_from_quaternion

LOOKED_AT: Final = 48
"""Frames whose depth is opened: enough for shares and ranges, few enough for minutes."""

BLOCK_PX: Final = 16
"""Side of the blocks that density is counted in."""

_BINS: Final = 40
_MAP_COLUMNS: Final = 96


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """Where the camera was.

    Attributes:
        seconds: (N,) since the first frame.
        plan_m: (N, 2) seen from above.
        looking: (N, 2) horizontal part of the viewing direction.
        height_m: (N,) along map_up, from the first frame.
        along_m: (N,) length of the walk so far.
        spacing_m: (N - 1,) between frames.
        gap_s: (N - 1,) between frames.
    """

    seconds: NDArray[np.float64]
    plan_m: NDArray[np.float64]
    looking: NDArray[np.float64]
    height_m: NDArray[np.float64]
    along_m: NDArray[np.float64]
    spacing_m: NDArray[np.float64]
    gap_s: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class DepthFigures:
    """What the depth of some frames is like.

    Attributes:
        frames: how many were opened.
        near_far_m: 2nd and 98th percentile of depth; (1, 10) where there is none.
        range_edges_m: (B + 1,) bins of depth.
        range_shares: (B,) of the measured pixels.
        density_edges: (B + 1,) bins of the share of measured pixels in a block.
        density_shares: (B,) of the blocks that hold any.
        empty_blocks: share of the blocks that hold none.
        coverage: (rows, columns) share of measured pixels, by place in the image.
    """

    frames: int
    near_far_m: tuple[float, float]
    range_edges_m: NDArray[np.float64]
    range_shares: NDArray[np.float64]
    density_edges: NDArray[np.float64]
    density_shares: NDArray[np.float64]
    empty_blocks: float
    coverage: NDArray[np.float64]


def spread(rows: Sequence[FrameRow], count: int) -> list[FrameRow]:
    """Return at most ``count`` rows, evenly spread, the first and the last among them."""
    indices = np.unique(np.linspace(0, len(rows) - 1, min(count, len(rows))).astype(int))
    return [rows[int(index)] for index in indices]


def track_of(rows: Sequence[FrameRow], map_up: tuple[float, float, float] | None) -> Track:
    """Return where the camera was.

    Args:
        rows: at least one, by ascending stamp.
        map_up: unit vector against gravity, map frame; None takes z.
    """
    position_m = np.array([(row.tx, row.ty, row.tz) for row in rows])
    position_m = position_m - position_m[0]  # maps may have coordinates of a country
    quaternions_xyzw = np.array([(row.qx, row.qy, row.qz, row.qw) for row in rows])
    forward = matrix_from_quaternion(quaternions_xyzw)[..., 2]
    up = np.array(map_up or (0.0, 0.0, 1.0))
    side = np.array((1.0, 0.0, 0.0)) if abs(up[0]) < 0.9 else np.array((0.0, 1.0, 0.0))
    east = side - up * (side * up).sum()
    east = east / np.sqrt((east * east).sum())
    north = np.cross(up, east)
    steps_m = np.sqrt((np.diff(position_m, axis=0) ** 2).sum(axis=1))
    stamps_ns = np.array([row.stamp_ns for row in rows], dtype=np.int64)
    return Track(
        seconds=(stamps_ns - stamps_ns[0]) / NS_PER_S,
        plan_m=np.stack([_along(position_m, east), _along(position_m, north)], axis=1),
        looking=np.stack([_along(forward, east), _along(forward, north)], axis=1),
        height_m=_along(position_m, up),
        along_m=np.concatenate([[0.0], np.cumsum(steps_m)]),
        spacing_m=steps_m,
        gap_s=np.diff(stamps_ns) / NS_PER_S,
    )


def _along(vectors: NDArray[np.float64], axis: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray((vectors * axis).sum(axis=1))


def depth_figures(bridge: Bridge) -> DepthFigures:
    """Open the depth of some frames, evenly spread, and count.

    Raises:
        FormatError: a depth image is missing or damaged.
    """
    rows = spread(bridge.rows, LOOKED_AT)
    far_m = max(row.depth_max_m for row in rows)
    fine = np.linspace(0.0, max(far_m, 1.0) * (1 + 1e-6), 4001)
    counts = np.zeros(len(fine) - 1, dtype=np.int64)
    blocks, total = [], np.zeros((bridge.camera.height_px, bridge.camera.width_px))
    for row in rows:
        depth_m = bridge.read_depth(row)
        valid = depth_m > 0
        counts += np.histogram(depth_m[valid], fine)[0]
        blocks.append(_block_shares(valid, BLOCK_PX).ravel())
        total += valid
    shares = np.concatenate(blocks)
    filled = shares[shares > 0]
    density_edges = np.linspace(0.0, 1.0, _BINS // 2 + 1)
    edges_m, range_shares = _coarser(fine, counts)
    cell_px = max(1, -(-bridge.camera.width_px // _MAP_COLUMNS))
    return DepthFigures(
        frames=len(rows),
        near_far_m=_near_far(fine, counts),
        range_edges_m=edges_m,
        range_shares=range_shares,
        density_edges=density_edges,
        density_shares=np.histogram(filled, density_edges)[0] / max(len(filled), 1),
        empty_blocks=1 - len(filled) / max(len(shares), 1),
        coverage=_block_shares(total / len(rows), cell_px),
    )


def _block_shares(values: NDArray[np.generic], side_px: int) -> NDArray[np.float64]:
    """Mean over blocks; those at the right and lower edge may be smaller."""
    sums = values.astype(np.float64)
    for axis in (0, 1):
        starts = np.arange(0, values.shape[axis], side_px)
        sums = np.add.reduceat(sums, starts, axis=axis)
        sizes = np.diff(np.append(starts, values.shape[axis]))
        sums = sums / (sizes[:, np.newaxis] if axis == 0 else sizes)
    return sums


def _quantile(edges: NDArray[np.float64], counts: NDArray[np.int64], share: float) -> float:
    total = np.cumsum(counts)
    index = int(np.searchsorted(total, share * total[-1]))
    return float(edges[min(index + 1, len(edges) - 1)])


def _near_far(edges: NDArray[np.float64], counts: NDArray[np.int64]) -> tuple[float, float]:
    if not counts.any():
        return 1.0, 10.0
    near_m, far_m = _quantile(edges, counts, 0.02), _quantile(edges, counts, 0.98)
    return near_m, max(far_m, near_m * 1.01)


def _coarser(
    fine: NDArray[np.float64], counts: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Forty bins up to the 99.5th percentile; the few beyond are in the last."""
    if not counts.any():
        return np.linspace(0, 1, _BINS + 1), np.zeros(_BINS)
    last_m = max(_quantile(fine, counts, 0.995), fine[_BINS])
    edges = np.linspace(0.0, last_m, _BINS + 1)
    middle = np.minimum((fine[:-1] + fine[1:]) / 2, last_m)
    binned = np.histogram(middle, edges, weights=counts)[0]
    return edges, binned / counts.sum()
