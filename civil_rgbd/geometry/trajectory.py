"""The pose of a moving body at any instant: linear in position, slerp in rotation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.geometry.transforms import matrix_from_quaternion, transform_from

UNIT_NORM_TOLERANCE = 1e-9
_SMALL_ANGLE_RAD = 1e-8  # below this sin x = x in float64: slerp becomes linear


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """Poses ``T_map_body`` over time.

    Attributes:
        stamps_ns: (P,) int64, LiDAR clock, strictly increasing.
        translations_m: (P, 3) float64, map frame.
        quaternions_xyzw: (P, 4) float64, unit, w >= 0.
    """

    stamps_ns: NDArray[np.int64]
    translations_m: NDArray[np.float64]
    quaternions_xyzw: NDArray[np.float64]

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
        before, after = self._neighbours(stamps_ns)
        t0, t1 = self.stamps_ns[before], self.stamps_ns[after]
        share = (stamps_ns - t0).astype(np.float64) / np.maximum(t1 - t0, 1).astype(np.float64)
        p0, p1 = self.translations_m[before], self.translations_m[after]
        translations = p0 + share[:, np.newaxis] * (p1 - p0)
        segment, where = np.unique(before, return_inverse=True)
        following = np.minimum(segment + 1, len(self.stamps_ns) - 1)
        nearer, theta = _shorter_way(
            self.quaternions_xyzw[segment], self.quaternions_xyzw[following]
        )
        return translations, _slerp(
            self.quaternions_xyzw[before], nearer[where], theta[where], share
        )

    def transforms_at(self, stamps_ns: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return ``T_map_body`` (M, 4, 4) float64 at (M,) int64 stamps inside the trajectory."""
        translations, quaternions = self.at(stamps_ns)
        return transform_from(matrix_from_quaternion(quaternions), translations)

    def _neighbours(
        self, stamps_ns: NDArray[np.int64]
    ) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        last = len(self.stamps_ns) - 1
        before = np.clip(np.searchsorted(self.stamps_ns, stamps_ns, side="right") - 1, 0, last)
        return before, np.minimum(before + 1, last)


def _shorter_way(
    q0: NDArray[np.float64], q1: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return ``q1`` on the side of ``q0``, and the angle between the two, 0 to pi/2."""
    product = q0 * q1
    dot = ((product[:, 0] + product[:, 1]) + product[:, 2]) + product[:, 3]
    q1 = np.where(dot[:, np.newaxis] < 0, -q1, q1)
    chord = (q1 - q0) ** 2
    half_chord = 0.5 * np.sqrt(((chord[:, 0] + chord[:, 1]) + chord[:, 2]) + chord[:, 3])
    return q1, 2 * _arcsin(half_chord)


def _slerp(
    q0: NDArray[np.float64],
    q1: NDArray[np.float64],
    theta: NDArray[np.float64],
    share: NDArray[np.float64],
) -> NDArray[np.float64]:
    tiny = theta < _SMALL_ANGLE_RAD
    angle = np.where(tiny, 1.0, theta)
    whole = _sin(angle)
    weight_0 = np.where(tiny, 1 - share, _sin((1 - share) * angle) / whole)
    weight_1 = np.where(tiny, share, _sin(share * angle) / whole)
    q = weight_0[:, np.newaxis] * q0 + weight_1[:, np.newaxis] * q1
    norm = np.sqrt(((q[:, 0] ** 2 + q[:, 1] ** 2) + q[:, 2] ** 2) + q[:, 3] ** 2)
    unit: NDArray[np.float64] = q / norm[:, np.newaxis]
    return unit


# Libraries pick sin and arcsin by processor and differ in the last bit; these two use only
# operations that IEEE 754 rounds exactly.


def _sin(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Sine by its Taylor series to x^21, for 0 <= x <= pi/2: error below 3e-16."""
    square = x * x
    series = np.ones_like(x)
    for n in range(20, 0, -2):
        series = 1 - series * square / (n * (n + 1))
    return x * series


def _arcsin(y: NDArray[np.float64]) -> NDArray[np.float64]:
    """Arcsine by Newton's method on :func:`_sin`, for 0 <= y <= sqrt(1/2)."""
    x = y * (1 + y * y / 6)
    for _ in range(4):
        sin = _sin(x)
        x = x + (y - sin) / np.sqrt(1 - sin * sin)
    return x
