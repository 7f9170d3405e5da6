"""The scale-invariant logarithmic loss of BTS and of ZoeDepth, right under any split of a batch.

With d = ln prediction - ln truth over the valid pixels of the whole batch:

- ``bts``: 10 sqrt(mean(d^2) - 0.85 mean(d)^2)
- ``zoedepth``: 10 sqrt(var(d) + 0.15 mean(d)^2), the variance unbiased

Both are statistics of the batch, not means over its images: taken by each process of a distributed
run for itself, they are another loss. So what is summed over processes is n, sum d and sum d^2.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

import torch
from torch import Tensor, distributed

_FACTOR: Final = 10.0
_MEAN_WEIGHT: Final = 0.15  # of mean(d)^2 in both: lambda = 0.85
_LEAST_SQUARE: Final = 1e-14
"""Below this the root's gradient says nothing any more: the prediction is perfect."""


@dataclass(frozen=True, slots=True)
class LogSums:
    """The loss's three sums; each a float64 scalar (float32 where the device has none).

    Attributes:
        count: n, the valid pixels.
        log: sum of d, with gradient.
        log_square: sum of d^2, with gradient.
    """

    count: Tensor
    log: Tensor
    log_square: Tensor


def log_sums(prediction_m: Tensor, truth_m: Tensor, valid: Tensor) -> LogSums:
    """Sum d and d^2 over the valid pixels of this process's part of the batch.

    Pixels that are not valid take no part, whatever stands in them: NaN, too. Without any valid
    pixel the sums are zero, and still depend on the prediction, with zero gradient: a process that
    saw nothing takes part in the exchange of gradients.

    Args:
        prediction_m: (B, 1, H, W), metres, with gradient, positive where valid.
        truth_m: of the same shape, metres.
        valid: of the same shape, bool.
    """
    # where() before and after the logarithm: the gradient of a log that is not chosen must not be
    # multiplied by zero, since 0 x Inf is NaN.
    predicted = torch.where(valid, prediction_m.float(), 1.0)
    true = torch.where(valid, truth_m.float(), 1.0)
    d = torch.where(valid, predicted.log() - true.log(), 0.0)
    d = d.to(torch.float32 if d.device.type == "mps" else torch.float64)  # mps has no float64
    return LogSums(valid.sum().to(d.dtype), d.sum(), d.square().sum())


def over_processes(sums: LogSums) -> LogSums:
    """Add up the sums of all processes of a distributed run; without one, return them as they are.

    Every process gets the loss of the undivided batch. DistributedDataParallel divides the added
    gradients by the number of processes; the backward pass multiplies by it, so that the gradient,
    too, is that of the undivided batch.
    """
    if not (distributed.is_available() and distributed.is_initialized()):
        return sums
    parts = torch.stack([sums.count, sums.log, sums.log_square])
    together: Tensor = _SumOverProcesses.apply(parts)  # type: ignore[no-untyped-call]  # torch's own
    count, log, log_square = together.unbind()
    return LogSums(count.detach(), log, log_square)


class _SumOverProcesses(torch.autograd.Function):
    """Adds forward; hands the gradient back, times the number of processes."""

    @staticmethod
    def forward(_context: Any, values: Tensor) -> Tensor:  # noqa: ANN401  # torch's own signature
        total = values.clone()
        distributed.all_reduce(total)
        return total

    @staticmethod
    def backward(_context: Any, *gradients: Tensor) -> Tensor:  # noqa: ANN401  # torch's own
        return gradients[0] * distributed.get_world_size()


def bts_silog(sums: LogSums) -> Tensor:
    """Return 10 sqrt(mean(d^2) - 0.85 mean(d)^2): a scalar; 0 without a valid pixel."""
    n = sums.count.clamp(min=1)
    mean = sums.log / n
    return _FACTOR * _root(sums.log_square / n - (1 - _MEAN_WEIGHT) * mean.square())


def zoedepth_silog(sums: LogSums) -> Tensor:
    """Return 10 sqrt(var(d) + 0.15 mean(d)^2), var unbiased: a scalar; 0 without a valid pixel.

    The variance of a single pixel is taken as 0.
    """
    n = sums.count.clamp(min=1)
    mean = sums.log / n
    variance = (sums.log_square - n * mean.square()) / (sums.count - 1).clamp(min=1)
    return _FACTOR * _root(variance + _MEAN_WEIGHT * mean.square())


LOSSES: Final[Mapping[str, Callable[[LogSums], Tensor]]] = {
    "bts": bts_silog,
    "zoedepth": zoedepth_silog,
}
"""The losses by the name that recipes use."""


def _root(value: Tensor) -> Tensor:
    """Return the root; 0 with zero gradient where the root's own gradient would be infinite."""
    enough = value > _LEAST_SQUARE
    return torch.where(enough, torch.where(enough, value, 1.0).sqrt(), value * 0.0)
