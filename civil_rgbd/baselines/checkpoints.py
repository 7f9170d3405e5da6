"""Trained models on disk: one file with name, options and weights; and others' checkpoints."""

from __future__ import annotations

import codecs
import pickle
import struct
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final
from zipfile import BadZipFile

import numpy as np
import torch
from torch import Tensor

from civil_rgbd.baselines.torch_model import TorchDepthModel
from civil_rgbd.errors import FormatError, MissingExtraError, UsageError
from civil_rgbd.storage.whole_files import whole_file

FILE_VERSION: Final = 1
"""Of what :func:`save_model` writes."""

_WRAPPED: Final = ("model", "state_dict", "model_state_dict", "weights")
"""Keys under which checkpoints keep the weights beside optimiser and counters."""

_PREFIXES: Final = ("module.", "_orig_mod.", "network.")
"""What wrappers (DataParallel, torch.compile, ours) put before every name."""

_SHOWN: Final = 6

_OPTION_LETTERS: Final = 60

_ADVICE: Final = ("weights_only", "Weights only", "torch.load")

UNREADABLE: Final = (
    *(RuntimeError, EOFError, BadZipFile, pickle.UnpicklingError, ValueError),
    *(LookupError, TypeError, AttributeError, AssertionError, OverflowError, struct.error),
    ImportError,
)
"""All that ``torch.load`` is seen to raise at files that are none of its own: a page of HTML makes
it a KeyError, other text an IndexError or AttributeError."""


@dataclass(frozen=True, slots=True, eq=False)
class SavedModel:
    """What a model file holds.

    Attributes:
        name: what ``load_model`` calls it.
        options: the keyword options that make the same model again.
        weights: tensors of its network by name.
    """

    name: str
    options: Mapping[str, Any]
    weights: Mapping[str, Tensor]


def save_model(model: TorchDepthModel, path: Path) -> None:
    """Write a model: the file is whole or absent.

    Args:
        model: any trainable model.
        path: the file to make, ``model.pt`` in a run folder; its folder exists.

    Raises:
        OutputError: the file cannot be written.
    """
    document = {
        "civil_rgbd_model": FILE_VERSION,
        "name": model.name,
        "options": dict(model.options),
        "weights": {key: value.cpu() for key, value in model.network.state_dict().items()},
    }
    write_tensors(path, document)


def write_tensors(path: Path, document: Mapping[str, Any]) -> None:
    """Write tensors, numbers, words, and dictionaries and lists of these: whole or not at all.

    Args:
        path: the file to make; its folder exists.
        document: for :func:`read_tensors`.

    Raises:
        OutputError: the file cannot be written.
    """
    with whole_file(path) as scratch, scratch.open("wb") as stream:
        try:
            torch.save(dict(document), stream)
        except RuntimeError as error:  # torch's word for a full disk
            raise OSError(str(error)) from error


def read_model_file(path: Path) -> SavedModel:
    """Read what :func:`save_model` wrote.

    Raises:
        FormatError: it is no such file, or a newer one, or damaged.
        UsageError: there is no such file.
    """
    document = read_tensors(path)
    version = document.get("civil_rgbd_model")
    if not isinstance(version, int):
        raise FormatError(
            f"the file is no model of civil_rgbd; it holds {', '.join(map(str, document))[:200]}",
            where=path,
            fix="a checkpoint of another program is loaded into a model: load_weights(model, path)",
        )
    if version > FILE_VERSION:
        raise FormatError(
            f"the model file has version {version}; this release reads up to {FILE_VERSION}",
            where=path,
            fix="update civil-rgbd",
        )
    kinds = {"name": str, "options": Mapping, "weights": Mapping}
    wanting = [key for key, kind in kinds.items() if not isinstance(document.get(key), kind)]
    if wanting:
        raise FormatError(
            f"the model file lacks {', '.join(wanting)}",
            where=path,
            fix="copy it again, or train the run again with --overwrite",
        )
    return SavedModel(document["name"], document["options"], document["weights"])


def damage_of(error: BaseException) -> str:
    """Say in a sentence what is wrong with a file, from what its reader raised.

    >>> damage_of(KeyError(101)), damage_of(EOFError())
    ('KeyError: 101', 'EOFError')
    """
    name = type(error).__name__
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    # torch wraps what it found in its advice to read the file unsafely.
    found = [line for line in lines if not any(words in line for words in _ADVICE)]
    if not found:
        return name
    said = found[0].removeprefix("WeightsUnpickler error: ").partition(". ")[0][:200]
    return f"{name}: {said}" if isinstance(error, LookupError) else said


def load_weights(model: TorchDepthModel, path: Path) -> None:
    """Load weights by name into a model: a file of ours, or a checkpoint of the original authors.

    Prefixes of wrappers are removed. Every tensor must be there with its shape.

    Args:
        model: takes the weights; unchanged when they do not fit.
        path: a file of :func:`save_model`, of ``torch.save``, or ``.safetensors``.

    Raises:
        UsageError: there is no such file.
        FormatError: it is damaged, or its tensors are not those of the model.
        MissingExtraError: a ``.safetensors`` file, and safetensors is not installed.
    """
    load_into(model, weights_of(read_tensors(path), where=path), where=path)


def weights_of(document: Mapping[str, Any], *, where: object) -> dict[str, Tensor]:
    """Find the tensors of a checkpoint, and take the wrappers' prefixes off their names.

    Raises:
        FormatError: there are none.
    """
    found: Mapping[str, Any] = document
    # Into the wrapper first: the authors of BTS keep tensors of best scores beside the weights.
    while inner := [found[key] for key in _WRAPPED if isinstance(found.get(key), Mapping)]:
        found = inner[0]
    tensors = {str(key): value for key, value in found.items() if isinstance(value, Tensor)}
    if not tensors:
        raise FormatError(
            f"the checkpoint holds no tensors under {', '.join(_WRAPPED)}; it has "
            f"{', '.join(map(str, found))[:200] or 'nothing'}",
            where=where,
            fix="save a state_dict: torch.save(model.state_dict(), path)",
        )
    while prefix := next((p for p in _PREFIXES if all(key.startswith(p) for key in tensors)), None):
        tensors = {key.removeprefix(prefix): value for key, value in tensors.items()}
    return tensors


def load_into(model: TorchDepthModel, weights: Mapping[str, Tensor], *, where: object) -> None:
    """Load tensors by name, after comparing all names and shapes.

    Args:
        model: takes the weights; unchanged when they do not fit.
        weights: by name in the model's network.
        where: what they come from, for the message.

    Raises:
        FormatError: a tensor is missing, too many, or of another shape; says which.
    """
    own = model.network.state_dict()
    differing = differences(own, weights)
    if differing:
        raise FormatError(
            f"the weights are not those of {model.name} with these options: " + differing,
            where=where,
            fix="make the model with the options that it was trained with; it has "
            + ", ".join(f"{key}={_shortened(value)}" for key, value in model.options.items()),
        )
    model.network.load_state_dict(
        {key: weights.get(key, value) for key, value in own.items()}, strict=True
    )
    model.is_trained = True


def _shortened(value: object) -> str:
    text = repr(value)
    return text if len(text) <= _OPTION_LETTERS else f"{text[:_OPTION_LETTERS]}..."


def differences(own: Mapping[str, Tensor], given: Mapping[str, Tensor]) -> str:
    """Say in words how tensors differ by name and shape; empty when they fit."""
    # Counters of batches came late to torch and say nothing about the weights.
    missing = [key for key in own if key not in given and not key.endswith("num_batches_tracked")]
    extra = [key for key in given if key not in own]
    shapes = [
        f"{key} is {tuple(given[key].shape)}, not {tuple(own[key].shape)}"
        for key in own
        if key in given and given[key].shape != own[key].shape
    ]
    groups = (("of another shape", shapes), ("missing", missing), ("too many", extra))
    return "; ".join(f"{len(found)} {kind}: {_some(found)}" for kind, found in groups if found)


def _some(names: list[str]) -> str:
    shown = ", ".join(names[:_SHOWN])
    return shown if len(names) <= _SHOWN else f"{shown} and {len(names) - _SHOWN} more"


def read_tensors(path: Path) -> Mapping[str, Any]:
    """Read a file of ``torch.save`` or safetensors, running no code of it.

    Raises:
        UsageError: there is no such file.
        FormatError: it is damaged, or holds more than tensors, numbers and words.
        MissingExtraError: a ``.safetensors`` file, and safetensors is not installed.
    """
    if not path.is_file():
        raise UsageError("there is no such file", where=path, fix="check the path")
    if path.suffix == ".safetensors":
        return _read_safetensors(path)
    try:
        # weights_only: a checkpoint from elsewhere must not run code. Counters in numpy's arrays,
        # which the authors of BTS keep beside the weights, are data.
        with warnings.catch_warnings(), torch.serialization.safe_globals(_numpy_data()):
            warnings.simplefilter("ignore")  # of pickle's version: it loads, or it is refused below
            document = torch.load(path, map_location="cpu", weights_only=True)
    except UNREADABLE as error:
        raise FormatError(
            f"the file cannot be read as tensors: {damage_of(error)}",
            where=path,
            fix="copy or download it again, it may be cut off; if it holds more than tensors, "
            "numbers and words, save its state_dict alone with the program that wrote it",
        ) from error
    if not isinstance(document, Mapping):
        raise FormatError(
            f"the file holds a {type(document).__name__}, not tensors by name",
            where=path,
            fix="save a state_dict: torch.save(model.state_dict(), path)",
        )
    return document


def _numpy_data() -> list[Any]:
    """What numpy's arrays and numbers are pickled with, by numpy 1 and 2: it makes data only."""
    arrays, numbers = np.zeros(1).__reduce__()[0], np.float64(0).__reduce__()[0]
    renamed = [
        (function, f"numpy.{module}.multiarray.{name}")
        for function, name in ((arrays, "_reconstruct"), (numbers, "scalar"))
        for module in ("core", "_core")
    ]
    kinds = {type(np.dtype(code)) for code in (*np.typecodes["All"], "U")}
    return [np.ndarray, np.dtype, (codecs.encode, "_codecs.encode"), *renamed, *kinds]


def _read_safetensors(path: Path) -> Mapping[str, Any]:
    try:
        from safetensors import SafetensorError
        from safetensors.torch import load_file
    except ImportError as error:
        raise MissingExtraError(
            "reading .safetensors needs safetensors",
            where=path,
            fix='pip install "civil-rgbd[zoe]"',
        ) from error
    try:
        tensors: Mapping[str, Any] = load_file(path)
    except SafetensorError as error:
        raise FormatError(
            f"the file cannot be read as tensors: {error}",
            where=path,
            fix="copy or download it again, it may be cut off",
        ) from error
    return tensors
