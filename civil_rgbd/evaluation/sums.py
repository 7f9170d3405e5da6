"""One image's prediction against its truth, as sums by range: all that any metric needs."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

RANGES_M: Final = ((0.0, 5.0), (5.0, 10.0), (10.0, 20.0), (20.0, math.inf))
"""Ranges of true depth that are scored apart: from (inclusive) and to (exclusive)."""

PIXELS, ABS_REL, SQ_REL, SQUARE, ABS_LOG, LOG, LOG_SQUARE, DELTA_1, DELTA_2, DELTA_3 = range(10)
"""Columns of the sums; with p the prediction and g the truth, over pixels: 1, |p - g| / g,
(p - g)^2 / g, (p - g)^2, |ln p/g|, ln p/g, (ln p/g)^2, and how many have max(p/g, g/p) < 1.25^k."""
COLUMNS: Final = 10

NEAR, FAR, ODD, LOW, HIGH, NAN, INFINITE = range(7)
"""Places of the counts; see :class:`ImageSums`."""

_BLOCK: Final = 1024  # pixels at a time: what is gathered stays in the first-level cache


@dataclass(frozen=True, slots=True)
class MetricRules:
    """Which pixels count, and what is done to predictions first. Part of every result.

    Attributes:
        min_depth_m: true depths must be greater; predictions are raised to it.
        max_depth_m: true depths must be smaller; predictions are lowered to it.
        min_valid_px: images with fewer such pixels are skipped, and counted.
        median_scaling: multiply each prediction by median(truth) / median(prediction) of the pixels
            that count; the metrics then carry it in their names.
    """

    min_depth_m: float = 1e-3
    max_depth_m: float = 80.0
    min_valid_px: int = 10
    median_scaling: bool = False

    def __post_init__(self) -> None:
        if not 0 < self.min_depth_m < self.max_depth_m < math.inf:
            raise ValueError(
                f"min_depth_m {self.min_depth_m!r} and max_depth_m {self.max_depth_m!r} "
                "are not 0 < min < max"
            )
        if self.min_valid_px < 1:
            raise ValueError(f"min_valid_px is {self.min_valid_px}, not at least 1")


@dataclass(frozen=True, slots=True, eq=False)
class ImageSums:
    """What one image adds to every metric.

    Attributes:
        sums: (4, 10) float64: a row for each of :data:`RANGES_M`, the columns above.
        counts: (7,) int64. Measured pixels that do not count because their truth is at or below
            the minimum (``NEAR``), at or above the maximum (``FAR``), or NaN or negative (``ODD``).
            Among those that count, predictions raised to the minimum (``LOW``), lowered to the
            maximum (``HIGH``), NaN and taken as the minimum (``NAN``), infinite and taken as the
            end they lie beyond (``INFINITE``).
        unmeasured_px: pixels without truth.
    """

    sums: NDArray[np.float64]
    counts: NDArray[np.int64]
    unmeasured_px: int

    @property
    def valid_px(self) -> int:
        """Pixels that count."""
        return int(self.sums[:, PIXELS].sum())


def measure_image(
    prediction_m: ArrayLike, truth_m: ArrayLike, *, rules: MetricRules | None = None
) -> ImageSums:
    """Compare one prediction with its truth.

    Args:
        prediction_m: (H, W), metres along the optical axis; anything may stand in it.
        truth_m: (H, W), metres along the optical axis, 0 = nothing measured.
        rules: which pixels count; None for the defaults.

    Raises:
        ValueError: the two are not images of one size.
    """
    rules = rules or MetricRules()
    predicted, true = _plane(prediction_m), _plane(truth_m)
    if predicted.shape != true.shape or true.ndim != 2:
        raise ValueError(f"prediction {predicted.shape} and truth {true.shape} are not one (H, W)")
    scale = _median_scale(predicted, true, rules) if rules.median_scaling else 1.0
    sums = np.zeros((len(RANGES_M), COLUMNS))
    counts = np.zeros(7, dtype=np.int64)
    unmeasured = _add(
        predicted.ravel(), true.ravel(), (rules.min_depth_m, rules.max_depth_m), scale, sums, counts
    )
    return ImageSums(sums, counts, int(unmeasured))


def _plane(values: ArrayLike) -> NDArray[np.floating]:
    plane = np.ascontiguousarray(values)
    # The kernel is compiled for these two; every other kind of number fits into the larger.
    kept = plane.dtype in (np.float32, np.float64)
    return plane if kept else plane.astype(np.float64)


def _median_scale(
    predicted: NDArray[np.floating], true: NDArray[np.floating], rules: MetricRules
) -> float:
    true = true.astype(np.float64)  # as the kernel compares: the limits are no float32
    valid = (true > rules.min_depth_m) & (true < rules.max_depth_m)
    if not valid.any():
        return 1.0
    known = predicted[valid].astype(np.float64)
    known = known[np.isfinite(known) & (known > 0)]
    return float(np.median(true[valid]) / np.median(known)) if len(known) else 1.0


# One pass in a fixed order, float64: the sums of an image depend on nothing but the image. Valid
# pixels are gathered a block at a time without a branch: which are valid cannot be predicted, and a
# branch on each pixel would cost more than the metrics do.
@numba.njit(cache=True, nogil=True, error_model="numpy")
def _add(predicted, true, limits, scale, sums, counts):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202, PLR0917  # a kernel
    low, high = limits
    known = np.empty(_BLOCK, dtype=np.float64)
    guessed = np.empty(_BLOCK, dtype=np.float64)
    unmeasured = np.int64(0)
    for first in range(0, true.size, _BLOCK):
        end = min(first + _BLOCK, true.size)
        valid, empty = np.int64(0), np.int64(0)
        for i in range(first, end):
            g = np.float64(true[i])
            known[valid], guessed[valid] = g, np.float64(predicted[i]) * scale
            valid += np.int64((g > low) & (g < high))
            empty += np.int64(g == 0.0)
        unmeasured += empty
        if valid + empty < end - first:
            _count_refused(true[first:end], low, high, counts)
        for i in range(valid):
            g, p = known[i], guessed[i]
            if not (p >= low and p <= high):
                p = _clamped(p, low, high, counts)
            error, ratio = p - g, p / g
            relative, log = error / g, math.log(ratio)
            row = sums[np.int64(g >= 5.0) + np.int64(g >= 10.0) + np.int64(g >= 20.0)]
            worse = max(ratio, g / p)
            row[PIXELS] += 1.0
            row[ABS_REL] += abs(relative)
            row[SQ_REL] += relative * error
            row[SQUARE] += error * error
            row[ABS_LOG] += abs(log)
            row[LOG] += log
            row[LOG_SQUARE] += log * log
            row[DELTA_1] += np.float64(worse < 1.25)
            row[DELTA_2] += np.float64(worse < 1.5625)
            row[DELTA_3] += np.float64(worse < 1.953125)
    return unmeasured


@numba.njit(cache=True, nogil=True)
def _clamped(p, low, high, counts):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202  # a kernel
    if p != p:  # noqa: PLR0124  # only NaN differs from itself
        counts[NAN] += 1
        return low
    if p < low:
        counts[INFINITE if p == -np.inf else LOW] += 1
        return low
    counts[INFINITE if p == np.inf else HIGH] += 1
    return high


@numba.njit(cache=True, nogil=True)
def _count_refused(true, low, high, counts):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202  # a kernel
    for g in true:
        if g == 0.0 or (g > low and g < high):
            continue
        if g != g or g < 0.0:  # noqa: PLR0124  # only NaN differs from itself
            counts[ODD] += 1
        elif g >= high:
            counts[FAR] += 1
        else:
            counts[NEAR] += 1
