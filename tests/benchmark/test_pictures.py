"""Pictures of predictions: any number may stand in one."""

from __future__ import annotations

import numpy as np

from civil_rgbd.benchmark.pictures import depth_uri, error_uri


def test_odd_predictions_are_drawn_as_wrong_without_a_word() -> None:
    truth = np.full((8, 8), 2.0, dtype=np.float32)
    whole = error_uri(np.full_like(truth, 4.0), truth)  # 100 % everywhere

    for odd in (np.nan, np.inf, -np.inf):
        assert error_uri(np.full_like(truth, odd), truth) == whole
        assert depth_uri(np.full_like(truth, odd), (1.0, 9.0)).startswith("data:image/png")
