"""Which model it is: its run folder, and the hash of all that its answers come from."""

from __future__ import annotations

import hashlib
import json
import sys
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING

from civil_rgbd.baselines.model import MODEL_FILE, DepthModel, StoredDepth, model_names

if TYPE_CHECKING:
    from civil_rgbd.baselines.torch_model import TorchDepthModel


def run_folder_of(location: str | Path) -> Path | None:
    """Return the folder of a run that is named by it or by its ``model.pt``; None for others.

    Args:
        location: what :func:`~civil_rgbd.baselines.model.load_model` takes.
    """
    if str(location).partition(":")[0] in model_names():
        return None
    path = Path(location)
    if path.is_dir():
        return path
    return path.parent if path.is_file() else None


def model_sha256(model: DepthModel | StoredDepth, location: str | Path) -> str | None:
    """Return the hash of what a model answers with, lower-case hex; None where nobody can know it.

    A run is known by its ``model.pt``, a built-in network by its options and weights. A model in a
    file of one's own may lean on anything, and stored predictions may change: these are not known.

    Args:
        model: that was loaded.
        location: what it was loaded from.
    """
    folder = run_folder_of(location)
    if folder is not None:
        path = folder / MODEL_FILE if Path(location).is_dir() else Path(location)
        if not path.is_file():
            return None
        with path.open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()
    if sys.modules.get("torch") is None or not type(model).__module__.startswith("civil_rgbd."):
        return None
    from civil_rgbd.baselines.torch_model import TorchDepthModel

    return _network_sha256(model) if isinstance(model, TorchDepthModel) else None


def _network_sha256(model: TorchDepthModel) -> str:
    told = [version("civil-rgbd"), model.name, model.options, repr(model.fit)]
    digest = hashlib.sha256(json.dumps(told, sort_keys=True, default=repr).encode())
    for name, tensor in model.network.state_dict().items():
        values = tensor.cpu().contiguous()
        digest.update(f"{name} {values.dtype} {tuple(values.shape)}\n".encode())
        digest.update(values.numpy().tobytes() if values.ndim else repr(values.item()).encode())
    return digest.hexdigest()
