"""One process or many: what ``torchrun`` says in the environment, and the device to use."""

from __future__ import annotations

import gc
import os
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import torch
from torch import distributed, nn
from torch.nn.parallel import DistributedDataParallel

from civil_rgbd.baselines.devices import device_named


@dataclass(frozen=True, slots=True)
class Processes:
    """This process among those of a run.

    Attributes:
        rank: its number.
        count: how many there are.
        device: that it computes on.
    """

    rank: int
    count: int
    device: torch.device

    @property
    def is_first(self) -> bool:
        """The first process writes files and speaks."""
        return self.rank == 0

    def wait(self) -> None:
        """Wait until every process is here: what the first one wrote is there for all."""
        if self.count > 1:
            distributed.barrier()


@contextmanager
def joined(device: str) -> Iterator[Processes]:
    """Join the processes that ``torchrun`` started; alone where it did not.

    No model may be held any more when the process leaves.

    Args:
        device: ``auto``, ``cpu``, ``cuda``, ``cuda:1``, ``mps``.

    Raises:
        UsageError: there is no such device.
    """
    count = int(os.environ.get("WORLD_SIZE", "1"))
    chosen = device_named(device, number=int(os.environ.get("LOCAL_RANK", "0")))
    if chosen.type == "cuda":
        torch.cuda.set_device(chosen)
    if count == 1 or distributed.is_initialized():
        rank = distributed.get_rank() if distributed.is_initialized() else 0
        count = distributed.get_world_size() if distributed.is_initialized() else 1
        yield Processes(rank, count, chosen)
        return
    distributed.init_process_group("nccl" if chosen.type == "cuda" else "gloo")
    try:
        yield Processes(distributed.get_rank(), count, chosen)
    finally:
        leave()


def leave() -> None:
    """Leave the other processes.

    A distributed model keeps gloo's threads for as long as it lives, and a model in a cycle of
    references lives until Python ends, which aborts when it meets those threads.
    """
    gc.collect()
    distributed.destroy_process_group()


def spread(model: nn.Module, processes: Processes) -> nn.Module:
    """Return what to call for a forward pass whose gradients are those of all processes.

    On GPUs the norms' statistics are those of the undivided batch. PyTorch has no such norm for
    CPUs: a warning says so.
    """
    if processes.count == 1:
        return model
    has_norms = any(isinstance(one, nn.modules.batchnorm._BatchNorm) for one in model.modules())  # noqa: SLF001  # torch has no public name for all of them
    if has_norms and processes.device.type != "cuda":
        if processes.is_first:
            warnings.warn(
                "each process has norms' statistics of its own: SyncBatchNorm needs GPUs, so "
                f"this run of {processes.count} processes differs from that of one",
                stacklevel=2,
            )
    elif has_norms:
        model = nn.SyncBatchNorm.convert_sync_batchnorm(model)  # type: ignore[no-untyped-call]  # torch's own lack
    return DistributedDataParallel(model)
