"""Recordings that live in memory: everything about them is known, and reads are counted."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.domain.recording import CameraImage, RecordingNotes, SourceFile
from civil_rgbd.domain.rig import Rig
from civil_rgbd.domain.scan import LidarScan
from civil_rgbd.errors import ImageDecodeError
from civil_rgbd.geometry.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class MemoryRecording:
    """Fulfils :class:`civil_rgbd.domain.recording.Recording` from arrays.

    Attributes:
        rig: camera, extrinsics, time offset.
        trajectory: ``T_map_body``.
        scans: all LiDAR messages, message order.
        image_stamps_ns: (I,) header stamps, camera clock.
        images: (H, W, 3) uint8 each; None for one that cannot be decoded.
        name: what it calls itself.
        sources: none, as there is no file.
        notes: what else there is to know.
        scans_read: how often each scan was read.
        images_read: how often each image was asked for.
    """

    rig: Rig
    trajectory: Trajectory
    scans: Sequence[LidarScan] = ()
    image_stamps_ns: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    images: Sequence[NDArray[np.uint8] | None] = ()
    name: str = "memory"
    sources: tuple[SourceFile, ...] = ()
    notes: RecordingNotes = field(default_factory=RecordingNotes)
    scans_read: Counter[int] = field(default_factory=Counter)
    images_read: Counter[int] = field(default_factory=Counter)

    @property
    def scan_stamps_ns(self) -> NDArray[np.int64]:
        """(S,) header stamps of all scans."""
        return np.array([scan.stamp_ns for scan in self.scans], dtype=np.int64)

    @property
    def point_reach_ns(self) -> tuple[int, int]:
        """How far point stamps lie from their header's, over all scans."""
        return reach_of(self.scans)

    def read_scan(self, index: int) -> LidarScan:
        """Hand out one scan."""
        self.scans_read[index] += 1
        return self.scans[index]

    def read_image(self, index: int) -> CameraImage:
        """Hand out one image."""
        self.images_read[index] += 1
        rgb = self.images[index]
        if rgb is None:
            raise ImageDecodeError("no image", where=f"image {index}", fix="take another")
        return CameraImage(index, int(self.image_stamps_ns[index]), rgb)


def reach_of(scans: Sequence[LidarScan]) -> tuple[int, int]:
    """Return the earliest and latest point offset from a header stamp, (0, 0) without points."""
    offsets = [bound - scan.stamp_ns for scan in scans for bound in (scan.start_ns, scan.end_ns)]
    return min(offsets, default=0), max(offsets, default=0)


def trajectory_of(
    stamps_ns: Sequence[int],
    translations_m: Sequence[Sequence[float]],
    quaternions_xyzw: Sequence[Sequence[float]] | None = None,
) -> Trajectory:
    """Make a trajectory from plain lists; it does not turn where no quaternions are given."""
    if quaternions_xyzw is None:
        quaternions_xyzw = [(0.0, 0.0, 0.0, 1.0)] * len(stamps_ns)
    return Trajectory(
        np.array(stamps_ns, dtype=np.int64),
        np.array(translations_m, dtype=np.float64),
        np.array(quaternions_xyzw, dtype=np.float64),
    )


def standing_still(*, start_ns: int = 0, end_ns: int = 10**10) -> Trajectory:
    """A body at the map's origin, looking along its axes; a pose every 0.1 s."""
    stamps = range(start_ns, end_ns + 1, 10**8)
    return trajectory_of(stamps, [(0.0, 0.0, 0.0)] * len(stamps))
