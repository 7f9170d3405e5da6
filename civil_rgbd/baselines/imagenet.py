"""ImageNet weights for an encoder: from a local file, or fetched by their published hash."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Final
from urllib.error import URLError

import torch
from torch import Tensor

from civil_rgbd.baselines.checkpoints import differences, read_tensors, weights_of
from civil_rgbd.baselines.encoders import TappedEncoder
from civil_rgbd.errors import DownloadError, FormatError, UsageError

IMAGENET: Final = "imagenet"
"""Instead of a file: the weights that torchvision publishes."""

MEAN: Final = (0.485, 0.456, 0.406)
"""Of ImageNet's images, red first, in 0 to 1: what encoders trained on it expect taken off."""

DEVIATION: Final = (0.229, 0.224, 0.225)
"""The same of their standard deviation: what the rest is divided by."""

_ADDRESS: Final = "https://download.pytorch.org/models/"
_CLASSIFIERS: Final = ("classifier.", "fc.")
_OLD_DENSENET: Final = re.compile(r"(denselayer\d+\.(?:norm|relu|conv))\.([12])\.")


def load_encoder_weights(encoder: TappedEncoder, source: str | Path = IMAGENET) -> None:
    """Give an encoder pretrained weights.

    Args:
        encoder: takes the weights (``model.network.encoder`` of a BTS); unchanged on an error.
        source: a file in torchvision's layout, or ``imagenet`` to fetch torchvision's own into
            torch's cache.

    Raises:
        UsageError: there is no such file, or no published weights for this encoder.
        DownloadError: they cannot be fetched, or are not what was published.
        FormatError: the file is damaged, or its tensors are not those of the encoder.
    """
    if str(source) == IMAGENET:
        weights, where = _fetched(encoder.spec.weights_file), _ADDRESS
    else:
        weights, where = weights_of(read_tensors(Path(source)), where=source), str(source)
    own = encoder.base_model.state_dict()
    # The classifier is never used: a file without one, or with other classes, will do.
    needed = {key: value for key, value in own.items() if not key.startswith(_CLASSIFIERS)}
    given = {
        key: value
        for key, value in torchvision_names(weights).items()
        if not key.startswith(_CLASSIFIERS)
    }
    differing = differences(needed, given)
    if differing:
        raise FormatError(
            f"the weights are not those of this encoder: {differing}",
            where=where,
            fix="give the ImageNet weights of this very encoder"
            + (f", {encoder.spec.weights_file}" if encoder.spec.weights_file else ""),
        )
    encoder.base_model.load_state_dict({**own, **given})


def torchvision_names(weights: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """Rename what is older or wider than the encoder: ``norm.1`` to ``norm1``.

    >>> list(torchvision_names({"features.denseblock1.denselayer2.norm.1.weight": torch.ones(1)}))
    ['denseblock1.denselayer2.norm1.weight']
    """
    return {
        _OLD_DENSENET.sub(r"\1\2.", key.removeprefix("features.")): value
        for key, value in weights.items()
    }


def _fetched(file: str | None) -> Mapping[str, Tensor]:
    if file is None:
        raise UsageError(
            "nobody published ImageNet weights for the small encoder",
            where="encoder weights",
            fix="train it from random weights, or choose another encoder",
        )
    try:
        fetched: Mapping[str, Tensor] = torch.hub.load_state_dict_from_url(
            _ADDRESS + file, map_location="cpu", check_hash=True, progress=False, weights_only=True
        )
    except (URLError, OSError, RuntimeError) as error:  # RuntimeError: another hash
        raise DownloadError(
            f"cannot fetch ImageNet weights: {error}",
            where=_ADDRESS + file,
            fix="check the network, or fetch the file elsewhere and put it into "
            f"{Path(torch.hub.get_dir()) / 'checkpoints'}, where it is looked for first "
            "(`train` also takes it by --imagenet)",
        ) from error
    return fetched
