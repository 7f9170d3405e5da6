"""Where a model computes. Nothing here needs torch until a device or a network is asked for."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, TypeVar

from civil_rgbd.baselines.model import DepthModel, StoredDepth
from civil_rgbd.errors import UsageError

if TYPE_CHECKING:
    import torch

Model = TypeVar("Model", bound=DepthModel | StoredDepth)


def device_named(name: str, *, number: int = 0) -> torch.device:
    """Return a device of PyTorch that is there.

    Args:
        name: ``auto`` for a GPU where there is one and the CPU elsewhere; ``cpu``, ``cuda``,
            ``cuda:1``, ``mps``.
        number: of the GPU, where the name says none.

    Raises:
        UsageError: there is no such device.
    """
    import torch

    if name == "auto":
        name = "cuda" if torch.cuda.is_available() else "cpu"
    if name == "cuda":
        name = f"cuda:{number}"
    try:
        device = torch.device(name)
        torch.empty(1, device=device)
    except (RuntimeError, AssertionError) as error:
        raise UsageError(
            f"there is no device {name!r}: {str(error).splitlines()[0]}",
            where="--device",
            fix="give cpu, or cuda where PyTorch sees a GPU",
        ) from error
    return device


def on_device(model: Model, name: str) -> Model:
    """Move a network to a device, and return it; any other model is left as it is.

    Args:
        model: a :class:`~civil_rgbd.baselines.torch_model.TorchDepthModel` is moved. What others
            compute on is their own affair.
        name: as for :func:`device_named`.

    Raises:
        UsageError: there is no such device.
    """
    if "torch" not in sys.modules or sys.modules["torch"] is None:
        return model  # what was made without torch is no network of it
    from civil_rgbd.baselines.torch_model import TorchDepthModel

    if isinstance(model, TorchDepthModel):
        model.to(device_named(name))
    return model
