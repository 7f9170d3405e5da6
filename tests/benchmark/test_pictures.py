"""Pictures of predictions: any number may stand in one."""

from __future__ import annotations

import base64

import cv2
import numpy as np
from numpy.typing import NDArray

from civil_rgbd.benchmark.pictures import depth_uri, error_uri


def test_odd_predictions_are_drawn_as_wrong_without_a_word() -> None:
    truth = np.full((8, 8), 2.0, dtype=np.float32)
    whole = error_uri(np.full_like(truth, 4.0), truth)  # 100 % everywhere

    for odd in (np.nan, np.inf, -np.inf):
        assert error_uri(np.full_like(truth, odd), truth) == whole
        assert depth_uri(np.full_like(truth, odd), (1.0, 9.0)).startswith("data:image/png")


def test_a_lone_pixel_is_seen_and_errors_are_not_painted_larger() -> None:
    truth = np.zeros((9, 9), dtype=np.float32)
    truth[4, 4], truth[4, 6] = 2.0, 2.0
    prediction = np.full_like(truth, 2.0)
    prediction[4, 6] = 4.0  # 100 %
    rgb = _pixels(error_uri(prediction, truth))

    red, dark_blue, grey = (255, 0, 0), (0, 0, 128), (40, 40, 40)
    assert tuple(rgb[4, 6]) == tuple(rgb[4, 7]) == red
    assert tuple(rgb[4, 4]) == tuple(rgb[4, 3]) == dark_blue
    assert tuple(rgb[4, 5]) not in {red, dark_blue, grey}  # the mean of both neighbours
    assert tuple(rgb[0, 0]) == grey


def _pixels(uri: str) -> NDArray[np.uint8]:
    data = np.frombuffer(base64.b64decode(uri.partition(",")[2]), np.uint8)
    return np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR)[..., ::-1], dtype=np.uint8)
