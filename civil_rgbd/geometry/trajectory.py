"""The pose of a moving body at any instant: linear in position, slerp in rotation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.geometry.transforms import matrix_from_quaternion, transform_from

UNIT_NORM_TOLERANCE = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """Poses ``T_map_body`` over time.

    Attributes:
        stamps_ns: (P,) int64, LiDAR clock, strictly increasing.
        translations_m: (P, 3) float64, map frame.
        quaternions_xyzw: (P, 4) float64, unit, w >= 0.
        quality: (P,) float64, larger is better, 0 or more; None where nobody judged the poses.
    """

    stamps_ns: NDArray[np.int64]
    translations_m: NDArray[np.float64]
    quaternions_xyzw: NDArray[np.float64]
    quality: NDArray[np.float64] | None = None

    def __post_init__(self) -> None:
        count = len(self.stamps_ns)
        if self.translations_m.shape != (count, 3) or self.quaternions_xyzw.shape != (count, 4):
            raise ValueError(
                f"{count} stamps, but translations {self.translations_m.shape} and "
                f"quaternions {self.quaternions_xyzw.shape}"
            )
        if count == 0:
            raise ValueError("it holds no pose")
        steps = np.diff(self.stamps_ns)
        if (steps <= 0).any():
            at = int(np.argmax(steps <= 0)) + 1
            kind = "the same as" if steps[at - 1] == 0 else "before"
            raise ValueError(
                f"stamp {at} ({int(self.stamps_ns[at])} ns) is {kind} stamp {at - 1} "
                f"({int(self.stamps_ns[at - 1])} ns)"
            )
        if not np.isfinite(self.translations_m).all():
            raise ValueError("a translation is not finite")
        norms = np.sqrt((self.quaternions_xyzw**2).sum(axis=1))
        if not (np.abs(norms - 1) <= UNIT_NORM_TOLERANCE).all():
            raise ValueError("a quaternion is not of norm 1")
        if self.quality is not None:
            if self.quality.shape != (count,):
                raise ValueError(f"{count} stamps, but qualities {self.quality.shape}")
            if not (np.isfinite(self.quality) & (self.quality >= 0)).all():
                raise ValueError("a quality is negative or not finite")

    @property
    def start_ns(self) -> int:
        """Stamp of the first pose."""
        return int(self.stamps_ns[0])

    @property
    def end_ns(self) -> int:
        """Stamp of the last pose."""
        return int(self.stamps_ns[-1])

    def covers(self, stamps_ns: NDArray[np.int64], *, max_gap_ns: int) -> NDArray[np.bool_]:
        """Tell for each instant whether it has a pose.

        Both ends are inclusive, nothing is extrapolated, and an instant strictly between two
        poses that are more than ``max_gap_ns`` apart has none.

        Args:
            stamps_ns: (M,) int64.
            max_gap_ns: the longest stretch that is interpolated over.

        Returns:
            (M,) bool.
        """
        before, after = self._neighbours(stamps_ns)
        at_a_pose = self.stamps_ns[before] == stamps_ns
        within = (stamps_ns >= self.start_ns) & (stamps_ns <= self.end_ns)
        short = self.stamps_ns[after] - self.stamps_ns[before] <= max_gap_ns
        covered: NDArray[np.bool_] = within & (at_a_pose | short)
        return covered

    def covers_span(self, first_ns: int, last_ns: int, *, max_gap_ns: int) -> bool:
        """Tell whether every instant from ``first_ns`` to ``last_ns``, inclusive, has a pose."""
        if first_ns < self.start_ns or last_ns > self.end_ns:
            return False
        first = int(np.searchsorted(self.stamps_ns, first_ns, side="right")) - 1
        last = int(np.searchsorted(self.stamps_ns, last_ns, side="left"))
        return bool((np.diff(self.stamps_ns[first : last + 1]) <= max_gap_ns).all())

    def at(self, stamps_ns: NDArray[np.int64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Interpolate: translation linearly, rotation by slerp (Shoemake 1985).

        Args:
            stamps_ns: (M,) int64, inside the trajectory; ask :meth:`covers` first.

        Returns:
            translations (M, 3) float64 metres, map frame; unit quaternions (M, 4) float64, xyzw.

        Raises:
            ValueError: a stamp lies outside the trajectory.
        """
        if len(stamps_ns) and (stamps_ns.min() < self.start_ns or stamps_ns.max() > self.end_ns):
            raise ValueError("a stamp lies outside the trajectory; nothing is extrapolated")
        from civil_rgbd.geometry.motion import poses_between  # numba: reading a bridge needs none

        translations, quaternions = np.empty((len(stamps_ns), 3)), np.empty((len(stamps_ns), 4))
        poses_between(
            stamps_ns,
            self.stamps_ns,
            self.translations_m,
            self.quaternions_xyzw,
            translations,
            quaternions,
        )
        return translations, quaternions

    def transforms_at(self, stamps_ns: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return ``T_map_body`` (M, 4, 4) float64 at (M,) int64 stamps inside the trajectory."""
        translations, quaternions = self.at(stamps_ns)
        return transform_from(matrix_from_quaternion(quaternions), translations)

    def quality_at(self, stamps_ns: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the quality of poses between poses: that of the worse neighbour.

        Args:
            stamps_ns: (M,) int64; outside of the trajectory the quality is 0.

        Returns:
            (M,) float64.

        Raises:
            ValueError: nobody judged these poses.
        """
        if self.quality is None:
            raise ValueError("the trajectory has no quality")
        before, after = self._neighbours(stamps_ns)
        at_a_pose = self.stamps_ns[before] == stamps_ns
        worse = np.minimum(self.quality[before], self.quality[np.where(at_a_pose, before, after)])
        within = (stamps_ns >= self.start_ns) & (stamps_ns <= self.end_ns)
        judged: NDArray[np.float64] = np.where(within, worse, 0.0)
        return judged

    def _neighbours(
        self, stamps_ns: NDArray[np.int64]
    ) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        last = len(self.stamps_ns) - 1
        before = np.clip(np.searchsorted(self.stamps_ns, stamps_ns, side="right") - 1, 0, last)
        return before, np.minimum(before + 1, last)
