"""A moving average of the weights: what is saved when a recipe asks for it."""

from __future__ import annotations

from collections.abc import Iterator

import torch
from torch import Tensor, nn


class WeightAverage:
    """An exponential moving average of a model's trained weights.

    Early on it follows quickly: after n steps the decay is at most (1 + n) / (10 + n).
    """

    def __init__(self, model: nn.Module, decay: float) -> None:
        self._decay = decay
        self._count = 0
        self._values = {name: value.detach().clone() for name, value in _weights(model)}

    @torch.no_grad()
    def update(self, model: nn.Module) -> None:
        """Take in the model's weights after a step."""
        self._count += 1
        decay = min(self._decay, (1 + self._count) / (10 + self._count))
        for name, value in _weights(model):
            self._values[name].lerp_(value, 1 - decay)

    @torch.no_grad()
    def put_into(self, model: nn.Module) -> None:
        """Give the model the averaged weights, for good."""
        for name, value in _weights(model):
            value.copy_(self._values[name])

    def state_dict(self) -> dict[str, object]:
        """Return all of it for a checkpoint."""
        return {"count": self._count, "values": self._values}

    def load_state_dict(self, state: dict[str, object]) -> None:
        """Go on from a checkpoint."""
        count, values = state["count"], state["values"]
        assert isinstance(count, int)  # noqa: S101  # our own file; tells mypy
        assert isinstance(values, dict)  # noqa: S101  # same
        self._count = count
        for name, value in values.items():
            self._values[name].copy_(value)


def _weights(model: nn.Module) -> Iterator[tuple[str, Tensor]]:
    return ((name, value) for name, value in model.named_parameters() if value.requires_grad)
