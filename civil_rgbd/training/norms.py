"""Statistics of norms, estimated once more: in short runs they lag behind the weights."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import torch
from torch import nn

from civil_rgbd.training.frames import Batch

Norm = nn.modules.batchnorm._BatchNorm  # noqa: SLF001  # torch has no public name for all of them


@torch.no_grad()
def estimate_norms(
    model: nn.Module, batches: Iterable[Batch], forward: Callable[[Batch], object]
) -> None:
    """Replace the norms' running averages by plain means over batches; the weights stay.

    Args:
        model: changed in place; without a norm nothing happens.
        batches: some, as trained with.
        forward: runs the model on a batch.
    """
    norms = [module for module in model.modules() if isinstance(module, Norm)]
    momenta = [norm.momentum for norm in norms]
    if not norms:
        return
    was_training = model.training
    for norm in norms:
        norm.reset_running_stats()
        norm.momentum = None  # torch's word for a plain mean over what is seen
    model.train()
    for batch in batches:
        forward(batch)
    for norm, momentum in zip(norms, momenta, strict=True):
        norm.momentum = momentum
    model.train(was_training)
