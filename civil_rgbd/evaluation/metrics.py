"""The metrics of the field as a pure pair: ``update`` adds images, ``compute`` scores them.

AbsRel, SqRel, RMSE, RMSElog, Log10, SILog and the shares within 1.25, 1.25^2 and 1.25^3, per image
(each image is scored, then the mean over images: what BTS, AdaBins and ZoeDepth publish) and pooled
(all pixels of all images as one). The two differ: say which.

The state holds the sums of each image, so that neither the batch size nor the order of the images
changes a bit of the result.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from civil_rgbd.evaluation import sums as s
from civil_rgbd.evaluation.sums import RANGES_M, ImageSums, MetricRules, measure_image

State = tuple[ImageSums, ...]
"""One entry an image; ``()`` is the state before any."""

METRICS: Final[Mapping[str, Callable[[NDArray[np.float64]], float]]] = {
    "abs_rel": lambda mean: mean[s.ABS_REL],
    "sq_rel": lambda mean: mean[s.SQ_REL],
    "rmse": lambda mean: math.sqrt(mean[s.SQUARE]),
    "rmse_log": lambda mean: math.sqrt(mean[s.LOG_SQUARE]),
    "log10": lambda mean: mean[s.ABS_LOG] / math.log(10.0),
    # The difference is a variance; rounding may leave a perfect prediction just below zero.
    "silog": lambda mean: 100 * math.sqrt(max(mean[s.LOG_SQUARE] - mean[s.LOG] ** 2, 0.0)),
    "delta_1": lambda mean: mean[s.DELTA_1],
    "delta_2": lambda mean: mean[s.DELTA_2],
    "delta_3": lambda mean: mean[s.DELTA_3],
}
"""Each metric from the (10,) means of the columns of :mod:`civil_rgbd.evaluation.sums`."""

LABELS: Final = {
    "abs_rel": "AbsRel",
    "sq_rel": "SqRel",
    "rmse": "RMSE",
    "rmse_log": "RMSElog",
    "log10": "Log10",
    "silog": "SILog",
    "delta_1": "δ1",
    "delta_2": "δ2",
    "delta_3": "δ3",
}
"""What tables call them."""

MEDIAN_SCALED: Final = "_median_scaled"
"""Ends the name of every metric of predictions that were scaled by the truth's median."""

RANGE_NAMES: Final = ("0-5 m", "5-10 m", "10-20 m", "20+ m")
"""Names of :data:`RANGES_M`, in its order."""


@dataclass(frozen=True, slots=True)
class Counts:
    """What was scored, and what was not or not as it came.

    Attributes:
        images: seen.
        images_skipped: had too few valid pixels.
        pixels: scored.
        pixels_skipped: valid, in images that were skipped.
        unmeasured: pixels without truth.
        truth_near: measured, at or below the minimum.
        truth_far: measured, at or above the maximum.
        truth_odd: NaN or negative truth.
        clamped_low: scored predictions that were raised to the minimum.
        clamped_high: scored predictions that were lowered to the maximum.
        prediction_nan: scored predictions that were NaN, taken as the minimum.
        prediction_infinite: scored predictions that were infinite, taken as an end of the range.
    """

    images: int
    images_skipped: int
    pixels: int
    pixels_skipped: int
    unmeasured: int
    truth_near: int
    truth_far: int
    truth_odd: int
    clamped_low: int
    clamped_high: int
    prediction_nan: int
    prediction_infinite: int


@dataclass(frozen=True, slots=True)
class RangeScores:
    """Scores of the pixels in one range of true depth; as :class:`Scores`."""

    per_image: Mapping[str, float]
    pooled: Mapping[str, float]
    images: int
    pixels: int


@dataclass(frozen=True, slots=True)
class Scores:
    """Every metric of some images.

    Attributes:
        per_image: metric by name: the mean over the images that were not skipped; NaN for none.
        pooled: metric by name, over all their pixels as one; NaN for none.
        ranges: the same by range of true depth; an image counts in a range in which it has enough
            pixels, its pixels count in any case.
        counts: what was scored, and what was not.
    """

    per_image: Mapping[str, float]
    pooled: Mapping[str, float]
    ranges: Mapping[str, RangeScores]
    counts: Counts


def update(
    state: State,
    prediction_m: ArrayLike,
    truth_m: ArrayLike,
    *,
    rules: MetricRules | None = None,
) -> State:
    """Return the state with one image, or a batch of them, added; the given state stays.

    Args:
        state: so far; ``()`` before the first.
        prediction_m: (H, W), (B, H, W) or (B, 1, H, W), metres along the optical axis.
        truth_m: of the same shape, metres, 0 = nothing measured.
        rules: which pixels count; None for the defaults. The same for all images.

    Raises:
        ValueError: the two are not images of one size.
    """
    predictions, truths = np.asarray(prediction_m), np.asarray(truth_m)
    if predictions.shape != truths.shape or truths.ndim < 2:
        raise ValueError(
            f"prediction {predictions.shape} and truth {truths.shape} are not (..., H, W) alike"
        )
    size = truths.shape[-2:]
    pairs = zip(predictions.reshape(-1, *size), truths.reshape(-1, *size), strict=True)
    return (*state, *(measure_image(one, true, rules=rules) for one, true in pairs))


def compute(state: Sequence[ImageSums], *, rules: MetricRules | None = None) -> Scores:
    """Score all images of the state.

    Args:
        state: of :func:`update`, or any selection of its images.
        rules: those that the state was made with; None for the defaults.
    """
    rules = rules or MetricRules()
    kept = [image for image in state if image.valid_px >= rules.min_valid_px]
    whole = [_exact_sum(image.sums) for image in kept]
    ranges = {
        name: _range_scores([image.sums[row] for image in kept], rules)
        for row, name in enumerate(RANGE_NAMES)
    }
    return Scores(
        _mean_of_images(whole, rules), _pooled(whole, rules), ranges, _counts(state, kept)
    )


def image_scores(image: ImageSums, *, rules: MetricRules | None = None) -> dict[str, float]:
    """Score one image; all NaN when it has no valid pixel."""
    return _pooled([_exact_sum(image.sums)], rules or MetricRules())


def metric_names(rules: MetricRules | None = None) -> tuple[str, ...]:
    """Return the names of the metrics under these rules, in the order of tables.

    >>> metric_names()[:2], metric_names(MetricRules(median_scaling=True))[0]
    (('abs_rel', 'sq_rel'), 'abs_rel_median_scaled')
    """
    ending = MEDIAN_SCALED if rules and rules.median_scaling else ""
    return tuple(name + ending for name in METRICS)


def label_of(name: str) -> str:
    """Return what tables call a metric.

    >>> label_of("abs_rel"), label_of("abs_rel_median_scaled")
    ('AbsRel', 'AbsRel (median-scaled)')
    """
    scaled = name.endswith(MEDIAN_SCALED)
    return LABELS[name.removesuffix(MEDIAN_SCALED)] + (" (median-scaled)" if scaled else "")


def _range_scores(rows: Sequence[NDArray[np.float64]], rules: MetricRules) -> RangeScores:
    enough = [row for row in rows if row[s.PIXELS] >= rules.min_valid_px]
    return RangeScores(
        _mean_of_images(enough, rules),
        _pooled(rows, rules),
        images=len(enough),
        pixels=int(sum(row[s.PIXELS] for row in rows)),
    )


def _pooled(rows: Sequence[NDArray[np.float64]], rules: MetricRules) -> dict[str, float]:
    total = _exact_sum(np.array(rows).reshape(-1, s.COLUMNS))
    values = (_of_means(total) if total[s.PIXELS] else dict.fromkeys(METRICS, math.nan)).values()
    return dict(zip(metric_names(rules), values, strict=True))


def _mean_of_images(rows: Sequence[NDArray[np.float64]], rules: MetricRules) -> dict[str, float]:
    each = [_of_means(row) for row in rows]
    means = (
        math.fsum(one[name] for one in each) / len(each) if each else math.nan for name in METRICS
    )
    return dict(zip(metric_names(rules), means, strict=True))


def _of_means(total: NDArray[np.float64]) -> dict[str, float]:
    mean = total / total[s.PIXELS]
    return {name: float(metric(mean)) for name, metric in METRICS.items()}


def _exact_sum(rows: NDArray[np.float64]) -> NDArray[np.float64]:
    # fsum is rounded once, whatever the order: images may be added in any.
    return np.array([math.fsum(column) for column in rows.T])


def _counts(state: Sequence[ImageSums], kept: Sequence[ImageSums]) -> Counts:
    every = sum((image.counts for image in state), np.zeros(7, dtype=np.int64))
    scored = sum((image.counts for image in kept), np.zeros(7, dtype=np.int64))
    pixels = sum(image.valid_px for image in kept)
    return Counts(
        images=len(state),
        images_skipped=len(state) - len(kept),
        pixels=pixels,
        pixels_skipped=sum(image.valid_px for image in state) - pixels,
        unmeasured=sum(image.unmeasured_px for image in state),
        truth_near=int(every[s.NEAR]),
        truth_far=int(every[s.FAR]),
        truth_odd=int(every[s.ODD]),
        clamped_low=int(scored[s.LOW]),
        clamped_high=int(scored[s.HIGH]),
        prediction_nan=int(scored[s.NAN]),
        prediction_infinite=int(scored[s.INFINITE]),
    )


__all__ = [
    "LABELS",
    "METRICS",
    "RANGES_M",
    "RANGE_NAMES",
    "Counts",
    "MetricRules",
    "RangeScores",
    "Scores",
    "State",
    "compute",
    "image_scores",
    "label_of",
    "metric_names",
    "update",
]
