"""Which points a frame sees: a window over the recording's points that slides with the images."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.constants import NS_PER_S
from civil_rgbd.domain.recipe import AccumulateStage
from civil_rgbd.pipeline.prepare import MappedScan

_NO_LIMIT_NS = 1 << 62  # 146 years: longer than any recording, and no stamp overflows by it


@dataclass(frozen=True, slots=True, eq=False)
class PointWindow:
    """The points that one frame sees.

    Attributes:
        segments: (3, n) float32 each, metres, local frame, one row an axis; views, in order.
        stamps_ns: (n,) int64 each, ascending within a segment.
        places: where each segment comes from: the scan, its first point there, and after the last.
    """

    segments: list[NDArray[np.float32]]
    stamps_ns: list[NDArray[np.int64]]
    places: list[tuple[int, int, int]]

    @property
    def count(self) -> int:
        """Points in all segments."""
        return sum(len(stamps) for stamps in self.stamps_ns)

    @property
    def span_ns(self) -> int:
        """From the earliest point to the latest; 0 without points."""
        if not self.stamps_ns:
            return 0
        return int(max(s[-1] for s in self.stamps_ns) - min(s[0] for s in self.stamps_ns))

    def nearest_ns(self, stamp_ns: int) -> int:
        """Return how far in time the nearest point lies from an instant; 0 without points.

        Of past points this is the age of the newest one.

        Args:
            stamp_ns: the instant that the window is around: no segment has points on both sides.
        """
        return min(
            (
                int(stamp_ns - s[-1] if s[-1] < stamp_ns else s[0] - stamp_ns)
                for s in self.stamps_ns
            ),
            default=0,
        )

    def beyond(self, inner: PointWindow) -> list[NDArray[np.float32]]:
        """Return the points of this window that another one does not have.

        Args:
            inner: a window around the same instant, over the same recording.
        """
        theirs: dict[int, tuple[int, int]] = {}
        for scan, start, stop in inner.places:
            # A scan around the instant comes twice, as past and as future: one range, not two.
            known = theirs.get(scan, (start, stop))
            theirs[scan] = (min(start, known[0]), max(stop, known[1]))
        rest = []
        for segment, (scan, start, stop) in zip(self.segments, self.places, strict=True):
            begin, end = theirs.get(scan, (stop, stop))
            before, after = max(begin - start, 0), max(end - start, 0)
            rest += [part for part in (segment[:, :before], segment[:, after:]) if part.shape[1]]
        return rest


class SlidingWindow:
    """The points around ever later instants.

    Points are ordered by message, within a message by stamp; a point is *past* when its own stamp
    is strictly earlier than the instant, otherwise *future*. ``past`` is the last N past points,
    ``future`` the first N others, ``centred`` the last N//2 past points and the first N - N//2
    others. What a window holds does not depend on the instants that were asked for before: scans
    are read back until it is full or the recording starts.

    Args:
        read_mapped: reads a scan by index and puts its points into the map.
        scan_stamps_ns: (S,) int64 header stamps, message order.
        reach_ns: how far point stamps may lie from their header's: earliest, latest.
        stage: points, window, age limit.
    """

    def __init__(
        self,
        read_mapped: Callable[[int], MappedScan],
        *,
        scan_stamps_ns: NDArray[np.int64],
        reach_ns: tuple[int, int],
        stage: AccumulateStage,
    ) -> None:
        self._read_mapped = read_mapped
        self._held: dict[int, MappedScan] = {}
        # Bounds that ascend although header stamps may not: from scan i on no point is earlier
        # than _earliest_from[i], up to scan i none is later than _latest_until[i].
        earliest, latest = scan_stamps_ns + reach_ns[0], scan_stamps_ns + reach_ns[1]
        self._earliest_from = np.minimum.accumulate(earliest[::-1])[::-1]
        self._latest_until = np.maximum.accumulate(latest)
        half = stage.points // 2
        self._wanted = {
            "past": (stage.points, 0),
            "future": (0, stage.points),
            "centred": (half, stage.points - half),
        }[stage.window]
        self._max_age_ns = round(stage.max_age_s * NS_PER_S) if stage.max_age_s else _NO_LIMIT_NS

    def at(self, stamp_ns: int) -> PointWindow:
        """Return the points around an instant that is not before the one asked for last."""
        past, from_scan = self._past(stamp_ns)
        future = self._future(stamp_ns)
        parts = past + future
        window = PointWindow(
            segments=[self._held[scan].points_local[:, a:b] for scan, a, b in parts],
            stamps_ns=[self._held[scan].stamps_ns[a:b] for scan, a, b in parts],
            places=parts,
        )
        # A later instant never needs a scan before the first one this one looked at.
        self._held = {scan: held for scan, held in self._held.items() if scan >= from_scan}
        return window

    def _past(self, stamp_ns: int) -> tuple[list[tuple[int, int, int]], int]:
        """Walk back from the last scan that can hold past points until there are enough."""
        wanted = self._wanted[0]
        oldest_ns = stamp_ns - self._max_age_ns
        scan = int(np.searchsorted(self._earliest_from, stamp_ns, side="left"))
        if not wanted:
            return [], int(np.searchsorted(self._latest_until, stamp_ns, side="left"))
        parts = []
        while wanted and scan > 0 and self._latest_until[scan - 1] >= oldest_ns:
            scan -= 1
            held = self._scan(scan)
            stop = int(np.searchsorted(held.stamps_ns, stamp_ns, side="left"))
            young = int(np.searchsorted(held.stamps_ns, oldest_ns, side="left"))
            start = max(young, stop - wanted)
            if start < stop:
                parts.append((scan, start, stop))
                wanted -= stop - start
        return parts[::-1], scan

    def _future(self, stamp_ns: int) -> list[tuple[int, int, int]]:
        """Walk on from the first scan that can hold future points until there are enough."""
        wanted = self._wanted[1]
        newest_ns = stamp_ns + self._max_age_ns
        scan = int(np.searchsorted(self._latest_until, stamp_ns, side="left"))
        parts = []
        while wanted and scan < len(self._earliest_from) and self._earliest_from[scan] <= newest_ns:
            held = self._scan(scan)
            start = int(np.searchsorted(held.stamps_ns, stamp_ns, side="left"))
            near = int(np.searchsorted(held.stamps_ns, newest_ns, side="right"))
            stop = min(near, start + wanted)
            if start < stop:
                parts.append((scan, start, stop))
                wanted -= stop - start
            scan += 1
        return parts

    def _scan(self, scan: int) -> MappedScan:
        if scan not in self._held:
            self._held[scan] = self._read_mapped(scan)
        return self._held[scan]
