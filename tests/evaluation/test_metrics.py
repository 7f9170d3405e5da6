"""Metrics: equal to a slow twin, and the same however the images come."""

from __future__ import annotations

import math
import subprocess
import sys
from dataclasses import asdict, astuple

import numpy as np
import pytest

from civil_rgbd.evaluation.metrics import (
    METRICS,
    RANGE_NAMES,
    RANGES_M,
    MetricRules,
    compute,
    image_scores,
    update,
)

from ..reference.metrics import errors, valid_pairs

RULES = MetricRules(min_depth_m=0.5, max_depth_m=60.0)


def scene(seed: int, *, share: float = 0.4) -> tuple[np.ndarray, np.ndarray]:
    """A prediction of all kinds of numbers, and a truth with holes and depths out of range."""
    rng = np.random.default_rng(seed)
    truth = np.exp(rng.uniform(np.log(0.3), np.log(90), (47, 61))).astype(np.float32)
    truth[rng.random(truth.shape) > share] = 0
    prediction = (np.where(truth > 0, truth, 5) * np.exp(rng.normal(0, 0.4, truth.shape))).astype(
        np.float32
    )
    odd = rng.random(truth.shape)
    prediction[odd < 0.02] = np.nan
    prediction[(odd > 0.02) & (odd < 0.03)] = np.inf
    prediction[(odd > 0.03) & (odd < 0.04)] = -np.inf
    prediction[(odd > 0.04) & (odd < 0.05)] = 0
    return prediction, truth


SCENES = [scene(seed, share=share) for seed, share in enumerate((0.4, 0.05, 0.9, 0.2))]


def test_an_image_scores_as_the_slow_twin_says() -> None:
    for prediction, truth in SCENES:
        (one,) = update((), prediction, truth, rules=RULES)

        assert image_scores(one, rules=RULES) == pytest.approx(
            errors(*valid_pairs(prediction, truth, 0.5, 60.0)), rel=1e-11
        )


def test_images_are_scored_each_and_then_averaged() -> None:
    state = ()
    for prediction, truth in SCENES:
        state = update(state, prediction, truth, rules=RULES)

    each = [errors(*valid_pairs(*pair, 0.5, 60.0)) for pair in SCENES]
    assert compute(state, rules=RULES).per_image == pytest.approx(
        {name: np.mean([one[name] for one in each]) for name in METRICS}, rel=1e-11
    )


def test_pooled_scores_take_all_pixels_as_one_image() -> None:
    state = ()
    for prediction, truth in SCENES:
        state = update(state, prediction, truth, rules=RULES)

    pairs = [valid_pairs(*pair, 0.5, 60.0) for pair in SCENES]
    p, g = (np.concatenate(some) for some in zip(*pairs, strict=True))
    assert compute(state, rules=RULES).pooled == pytest.approx(errors(p, g), rel=1e-11)


def test_ranges_are_those_of_the_true_depth() -> None:
    state = ()
    for prediction, truth in SCENES:
        state = update(state, prediction, truth, rules=RULES)
    scores = compute(state, rules=RULES).ranges

    assert list(scores) == list(RANGE_NAMES)
    for (low, high), found in zip(RANGES_M, scores.values(), strict=True):
        parts = []
        for pair in SCENES:
            p, g = valid_pairs(*pair, 0.5, 60.0)
            inside = (g >= low) & (g < high)
            parts.append((p[inside], g[inside]))
        p, g = (np.concatenate(some) for some in zip(*parts, strict=True))
        assert found.pixels == len(p)
        assert found.pooled == pytest.approx(errors(p, g), rel=1e-11)
        each = [errors(*part)["abs_rel"] for part in parts if len(part[0]) >= 10]
        assert found.images == len(each)
        assert found.per_image["abs_rel"] == pytest.approx(np.mean(each), rel=1e-11)


def test_neither_batches_nor_their_order_change_a_bit() -> None:
    pairs = [scene(seed) for seed in range(7)]
    predictions, truths = (np.stack(some) for some in zip(*pairs, strict=True))
    together = compute(update((), predictions, truths, rules=RULES), rules=RULES)
    backwards = ()
    for first, end in ((5, 7), (1, 5), (0, 1)):
        part = slice(first, end)
        backwards = update(
            backwards, predictions[part, np.newaxis], truths[part, np.newaxis], rules=RULES
        )

    assert astuple(compute(backwards, rules=RULES)) == astuple(together)


def test_updating_leaves_the_given_state_as_it_was() -> None:
    state = update((), *SCENES[0])
    before = asdict(compute(state))
    update(state, *SCENES[1])

    assert len(state) == 1
    assert asdict(compute(state)) == before


def test_everything_that_is_left_out_or_changed_is_counted() -> None:
    truth = np.full((8, 8), 5.0)
    truth[0] = [0, 0, 0.5, 0.4, 60, 70, np.nan, -1]
    prediction = np.full((8, 8), 5.0)
    prediction[0] = np.nan  # none of these pixels counts
    prediction[1, :6] = [0.1, 0.2, 99, np.nan, np.inf, -np.inf]

    counts = compute(update((), prediction, truth, rules=RULES), rules=RULES).counts

    assert asdict(counts) == {
        "images": 1,
        "images_skipped": 0,
        "pixels": 56,
        "pixels_skipped": 0,
        "unmeasured": 2,
        "truth_near": 2,
        "truth_far": 2,
        "truth_odd": 2,
        "clamped_low": 2,
        "clamped_high": 1,
        "prediction_nan": 1,
        "prediction_infinite": 2,
    }


def test_an_image_with_nine_valid_pixels_is_skipped_and_with_ten_it_is_not() -> None:
    truth = np.zeros((4, 4))
    truth.flat[:9] = 3.0
    nine = update((), np.full((4, 4), 6.0), truth)
    truth.flat[9] = 3.0
    both = update(nine, np.full((4, 4), 3.0), truth)
    scores = compute(both)

    assert math.isnan(compute(nine).per_image["abs_rel"])
    assert (scores.counts.images_skipped, scores.counts.pixels_skipped) == (1, 9)
    assert scores.counts.pixels == 10
    assert scores.per_image["abs_rel"] == scores.pooled["abs_rel"] == 0.0


def test_a_perfect_prediction_has_no_error() -> None:
    truth = SCENES[2][1]

    scores = compute(update((), truth, truth, rules=RULES), rules=RULES).per_image

    assert [scores[name] for name in METRICS] == [0, 0, 0, 0, 0, 0, 1, 1, 1]


def test_numbers_by_hand() -> None:
    truth = np.full((4, 4), 4.0)
    prediction = np.full((4, 4), 8.0)
    prediction[:2] = 2.0

    scores = compute(update((), prediction, truth)).pooled

    assert scores["abs_rel"] == pytest.approx(0.75)  # (0.5 + 1) / 2
    assert scores["sq_rel"] == pytest.approx(2.5)  # (4 / 4 + 16 / 4) / 2
    assert scores["rmse"] == pytest.approx(math.sqrt(10))
    assert scores["rmse_log"] == pytest.approx(math.log(2))
    assert scores["log10"] == pytest.approx(math.log10(2))
    assert scores["silog"] == pytest.approx(100 * math.log(2))  # ln 1/2 and ln 2: mean 0
    assert scores["delta_3"] == 0


def test_silog_does_not_see_scale_and_the_shares_exclude_their_limit() -> None:
    truth = np.full((4, 4), 4.0)

    at_limit = compute(update((), truth * 1.25, truth)).pooled
    below = compute(update((), truth * 1.2499, truth)).pooled

    assert at_limit["silog"] == pytest.approx(0, abs=1e-5)
    assert (at_limit["delta_1"], at_limit["delta_2"]) == (0, 1)
    assert below["delta_1"] == 1


def test_median_scaling_is_said_in_every_name_and_undoes_a_factor() -> None:
    rules = MetricRules(median_scaling=True)
    truth = SCENES[0][1]

    scores = compute(update((), truth * 7, truth, rules=rules), rules=rules).per_image

    assert set(scores) == {f"{name}_median_scaled" for name in METRICS}
    assert scores["abs_rel_median_scaled"] == pytest.approx(0, abs=1e-6)


def test_shapes_that_differ_are_refused() -> None:
    with pytest.raises(ValueError, match=r"\(4, 4\) and truth \(4, 5\)"):
        update((), np.zeros((4, 4)), np.zeros((4, 5)))


@pytest.mark.parametrize(("low", "high"), [(0.0, 80.0), (5.0, 5.0), (1.0, math.inf)])
def test_limits_that_make_no_range_are_refused(low: float, high: float) -> None:
    with pytest.raises(ValueError, match="not 0 < min < max"):
        MetricRules(min_depth_m=low, max_depth_m=high)


def test_scoring_needs_no_torch() -> None:
    code = "import sys, civil_rgbd.evaluation.metrics; print('torch' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)

    assert done.stdout.strip() == "False"


def test_truth_at_an_end_of_the_range_does_not_scale_either() -> None:
    rules = MetricRules(min_depth_m=0.1, max_depth_m=0.9, min_valid_px=1, median_scaling=True)
    # As float32, 0.1 is above the limit and 0.9 below it: those count; 1.0 does not.
    truth = np.array([[0.1, 0.9, 0.9, 1.0]], dtype=np.float32)
    assert float(truth[0, 0]) > 0.1
    assert float(truth[0, 1]) < 0.9
    image = update((), truth * 2, truth, rules=rules)
    scores = compute(image, rules=rules)

    assert scores.counts.pixels == 3
    assert scores.pooled["abs_rel_median_scaled"] == pytest.approx(0, abs=1e-6)
    one_low = np.array([[0.1, 0.5, 0.5]], dtype=np.float32)
    wrong = one_low * np.array([[4, 1, 1]], dtype=np.float32)
    found = compute(update((), wrong, one_low, rules=rules), rules=rules).pooled
    slow = np.median([np.float64(v) for v in one_low[0]]) / np.median(wrong.astype(np.float64))
    expected = np.mean(np.abs(np.clip(wrong * slow, 0.1, 0.9) - one_low) / one_low)
    assert found["abs_rel_median_scaled"] == pytest.approx(expected, rel=1e-6)
