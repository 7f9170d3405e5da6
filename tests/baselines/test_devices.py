"""Where models compute."""

from __future__ import annotations

import pytest
import torch

from civil_rgbd.baselines.bts_model import bts_small
from civil_rgbd.baselines.devices import device_named, on_device
from civil_rgbd.errors import UsageError


class Flat:
    """A model of somebody's own, that no device is told to."""

    def predict(self, rgb: object, camera: object) -> None:
        """Answer nothing."""


def test_auto_is_a_gpu_where_there_is_one() -> None:
    assert device_named("auto").type == ("cuda" if torch.cuda.is_available() else "cpu")


def test_a_device_that_is_not_there_is_refused() -> None:
    with pytest.raises(UsageError, match="there is no device 'nonsense'"):
        device_named("nonsense")


def test_a_network_is_moved_and_another_model_left_alone() -> None:
    flat = Flat()

    assert on_device(bts_small(features=16), "meta").device.type == "meta"
    assert on_device(flat, "meta") is flat  # type: ignore[type-var]  # its answer is of no matter
