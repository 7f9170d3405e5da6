"""A recording's messages, put into the map one by one, and kept while windows to come need them."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.domain.recipe import Recipe
from civil_rgbd.domain.recording import Recording
from civil_rgbd.pipeline.prepare import MappedScan, PointCounts, local_origin, map_scan

_KEPT_WINDOWS: Final = 2  # how many windows' worth of mapped points are kept for windows to come


@dataclass(slots=True)
class MappedScans:
    """Reads messages by their number; of one that was read lately the points are still there.

    Attributes:
        recording: where they come from.
        recipe: which points count, and how many a window has.
        counts: what became of the points of each message that was asked for, by its number.
        origin_map: (3,) float64, of the frame that the points are in.
    """

    recording: Recording
    recipe: Recipe
    counts: dict[int, PointCounts] = field(default_factory=dict, init=False)
    origin_map: NDArray[np.float64] = field(init=False)
    _recent: OrderedDict[int, MappedScan] = field(default_factory=OrderedDict, init=False)

    def __post_init__(self) -> None:
        self.origin_map = local_origin(self.recording.trajectory)

    def read(self, scan: int) -> MappedScan:
        """Return the points of one message in the map."""
        # The next chunk's window begins among the scans that the last one's ended with.
        mapped = self._recent.pop(scan, None) or map_scan(
            self.recording.read_scan(scan),
            trajectory=self.recording.trajectory,
            rig=self.recording.rig,
            recipe=self.recipe,
            origin_map=self.origin_map,
        )
        self._recent[scan] = mapped
        kept_points = sum(len(recent.stamps_ns) for recent in self._recent.values())
        while kept_points > _KEPT_WINDOWS * self._widest and len(self._recent) > 1:
            kept_points -= len(self._recent.popitem(last=False)[1].stamps_ns)
        self.counts[scan] = mapped.counts
        return mapped

    def forget_counts(self) -> None:
        """Begin to count points anew: each chunk speaks of its own windows."""
        self.counts = {}

    @property
    def _widest(self) -> int:
        """How many points the largest window has."""
        stage = self.recipe.visibility
        return max(self.recipe.accumulate.points, stage.points if stage else 0)
