"""Do images, clouds and poses tell the same time?"""

from __future__ import annotations

from bisect import bisect_left

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.constants import NS_PER_S
from civil_rgbd.errors import RecordingError


def ascending(stamps_ns: NDArray[np.int64]) -> NDArray[np.intp]:
    """Return the indices of the longest run that ascends strictly, others left out.

    A single stamp that is astray, in either direction, costs itself and no other.

    Args:
        stamps_ns: (M,) int64.

    Returns:
        (K,) ascending indices.

    >>> ascending(np.array([1, 2, 99, 3, 4, 0, 5])).tolist()
    [0, 1, 3, 4, 6]
    """
    count = len(stamps_ns)
    if not (np.diff(stamps_ns) <= 0).any():
        return np.arange(count)
    ends: list[int] = []  # smallest stamp that a run of each length ends with
    places: list[int] = []  # where it is
    before = np.full(count, -1)
    for at, stamp in enumerate(stamps_ns.tolist()):
        length = bisect_left(ends, stamp)
        before[at] = places[length - 1] if length else -1
        ends[length : length + 1], places[length : length + 1] = [stamp], [at]
    kept = [places[-1]]
    while before[kept[-1]] >= 0:
        kept.append(int(before[kept[-1]]))
    return np.array(kept[::-1], dtype=np.intp)


def check_overlap(
    *,
    images_ns: NDArray[np.int64],
    scans_ns: NDArray[np.int64],
    reach_ns: tuple[int, int],
    poses_ns: NDArray[np.int64],
    where: object,
) -> None:
    """Refuse a recording whose three streams share no instant.

    Args:
        images_ns: (I,) stamps, brought to the LiDAR clock.
        scans_ns: (S,) header stamps.
        reach_ns: how far points may lie from their header.
        poses_ns: (P,) stamps.
        where: the file, for errors.

    Raises:
        RecordingError: there is no instant inside all three.
    """
    ranges = {
        "images": (int(images_ns.min()), int(images_ns.max())),
        "point clouds": (int(scans_ns.min()), int(scans_ns.max())),
        "poses": (int(poses_ns.min()), int(poses_ns.max())),
    }
    starts = [
        first + (reach_ns[0] if "point" in name else 0) for name, (first, _) in ranges.items()
    ]
    ends = [last + (reach_ns[1] if "point" in name else 0) for name, (_, last) in ranges.items()]
    if max(starts) <= min(ends):
        return
    said = "; ".join(
        f"{name} {first / NS_PER_S:.3f} to {last / NS_PER_S:.3f} s"
        for name, (first, last) in ranges.items()
    )
    raise RecordingError(
        f"the clocks do not overlap: {said}",
        where=where,
        fix="where one clock counts from power-on and another from 1970, give their difference as "
        "camera_time_offset_s in a rig file (--rig; it is added to image stamps), and for poses as "
        "--trajectory-offset (it is added to theirs, from a file or recorded): all three on the "
        "LiDAR's clock",
    )
