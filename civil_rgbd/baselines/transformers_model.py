"""Any metric depth model of ``transformers``, prepared without its image processor.

The processors want torchvision for half of their work. What they do is little: resize, normalise.
"""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import torch
from torch import Tensor, nn
from torch.nn import Parameter, functional

from civil_rgbd.baselines import imagenet
from civil_rgbd.baselines.fitting import InputFit
from civil_rgbd.baselines.hub import reaching, read_preprocessor, require_transformers
from civil_rgbd.baselines.torch_model import TorchDepthModel, as_unit_range, trainable
from civil_rgbd.errors import FormatError, UsageError

if TYPE_CHECKING:
    from transformers import PreTrainedConfig

MIN_DEPTH_M: Final = 1e-3
"""The least depth that is answered: some heads give 0."""

_AS_IT_IS: Final = ((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
_HALVES: Final = ((0.5, 0.5, 0.5), (0.5, 0.5, 0.5))
_CUBIC: Final = 3  # PIL's number for bicubic, which the files use

_METRIC_BY_DESIGN: Final = ("depth_pro", "glpn", "tipsv2_dpt")
_NEVER_USED: Final = (
    "fusion_stage.layers.0.residual_layer1.",
    "fusion_stage.intermediate.0.residual_layer1.",
    "embeddings.mask_token",
)
"""Parameters of some of these networks that never get a gradient."""


@dataclass(frozen=True, slots=True)
class Preparation:
    """What is done to an image before the network sees it.

    Attributes:
        height_px: rows that are aimed at; None keeps the image's, but for the multiple.
        width_px: columns that are aimed at.
        keep_aspect: scale both sides by the factor of the one that changes less.
        side_multiple: sides are rounded to multiples of this.
        round_down: to the multiple below; otherwise to the nearest.
        cubic: interpolate bicubically; otherwise bilinearly.
        mean: of the normalisation, red first, image in 0 to 1.
        deviation: of the normalisation.
    """

    height_px: int | None = None
    width_px: int | None = None
    keep_aspect: bool = False
    side_multiple: int = 1
    round_down: bool = False
    cubic: bool = False
    mean: tuple[float, ...] = _AS_IT_IS[0]
    deviation: tuple[float, ...] = _AS_IT_IS[1]

    def size(self, *, height_px: int, width_px: int) -> tuple[int, int]:
        """Return rows and columns of the input for an image.

        >>> Preparation(518, 518, keep_aspect=True, side_multiple=14).size(
        ...     height_px=432, width_px=768
        ... )
        (518, 924)
        """
        if self.height_px is None or self.width_px is None:
            rows, columns = float(height_px), float(width_px)
        else:
            down, across = self.height_px / height_px, self.width_px / width_px
            if self.keep_aspect:
                down = across = across if abs(1 - across) < abs(1 - down) else down
            rows, columns = height_px * down, width_px * across
        return self._rounded(rows), self._rounded(columns)

    def _rounded(self, side: float) -> int:
        steps = side / self.side_multiple
        # round(), halves to even, as in the processors.
        whole = math.floor(steps) if self.round_down else round(steps)
        return max(1, whole) * self.side_multiple


class TransformersModel(TorchDepthModel):
    """A depth model of ``transformers`` that answers in metres.

    Args:
        source: name on the Hugging Face hub, or a folder that holds ``config.json`` and weights;
            None together with ``config``.
        config: a configuration instead, for random weights.
        preparation: keys of :class:`Preparation` that replace what ``source`` says.
        metric: whether the answers are metres; None asks the configuration.

    Raises:
        UsageError: the model answers relative depth, or the options do not go together.
        FormatError: ``source`` holds no depth model, or its weights are not complete.
        DownloadError: the hub cannot be reached.
        MissingExtraError: transformers is not installed.
    """

    mean: Tensor
    deviation: Tensor

    def __init__(
        self,
        source: str | None = None,
        *,
        config: dict[str, Any] | None = None,
        preparation: dict[str, Any] | None = None,
        metric: bool | None = None,
    ) -> None:
        require_transformers("a depth model of transformers")
        settings = _settings(source, config)
        _refuse_relative(settings, metric, where=source or "config")
        if config is not None:
            source = None  # a configuration says all; saved models bring theirs
        said = {} if source is None else read_preprocessor(source)
        rule = Preparation(**{**asdict(_preparation(settings, said)), **(preparation or {})})
        options = {
            "config": json.loads(settings.to_json_string(use_diff=False)),
            "preparation": {
                key: list(value) if isinstance(value, tuple) else value
                for key, value in asdict(rule).items()
            },
            "metric": True,
        }
        super().__init__(
            "transformers",
            options,
            fit=InputFit(),
            min_depth_m=MIN_DEPTH_M,
            max_depth_m=float(getattr(settings, "max_depth", None) or math.inf),
        )
        self.preparation, self.kind = rule, str(settings.model_type)
        self.network, self.is_trained = _network(source, settings), source is not None
        for buffer, values in (("mean", rule.mean), ("deviation", rule.deviation)):
            self.register_buffer(buffer, torch.tensor(values).view(3, 1, 1), persistent=False)
        for key, parameter in self.network.named_parameters():
            if any(mark in key for mark in _NEVER_USED):
                parameter.requires_grad = False

    def forward(self, rgb: Tensor, intrinsics: Tensor) -> Tensor:
        """Predict a batch of any size, with gradient; see :class:`TorchDepthModel`."""
        size = self.preparation.size(height_px=rgb.shape[-2], width_px=rgb.shape[-1])
        resized = functional.interpolate(
            as_unit_range(rgb),
            size=size,
            mode="bicubic" if self.preparation.cubic else "bilinear",
            align_corners=False,
            antialias=True,
        ).clamp(0, 1)
        answer = self.network((resized - self.mean) / self.deviation).predicted_depth
        answer = answer.float().reshape(len(rgb), 1, *answer.shape[-2:])
        if self.kind == "depth_pro":
            # It answers 1 / depth as of a camera whose focal length is the image's width.
            focal = (intrinsics[:, 0, 0] / rgb.shape[-1]).view(-1, 1, 1, 1)
            answer = focal / answer.clamp(min=1e-4, max=1e4)
        depth_m = functional.interpolate(
            answer, size=rgb.shape[-2:], mode="bilinear", align_corners=False
        )
        return depth_m.clamp_min(self.min_depth_m)

    def parameter_groups(self) -> dict[str, list[Parameter]]:
        """Return what is trained, by ``encoder`` and ``decoder``, without what is frozen."""
        children = dict(self.network.named_children())
        inner = str(getattr(self.network, "base_model_prefix", ""))
        encoder = [trainable(children.pop(one)) for one in ("backbone", inner) if one in children]
        return {
            "encoder": [one for part in encoder for one in part],
            "decoder": [one for child in children.values() for one in trainable(child)],
        }

    def freeze_early_layers(self) -> int:
        """Freeze nothing: what is left alone differs by model."""
        return 0


def transformers_model(source: str | None = None, **options: Any) -> TorchDepthModel:  # noqa: ANN401 - handed on
    """Make a depth model of ``transformers`` from the hub or a folder; ZoeDepth as our own."""
    require_transformers("a depth model of transformers")
    config = options.get("config")
    if getattr(_settings(source, config), "model_type", "") == "zoedepth":
        from civil_rgbd.baselines.zoedepth import ZoeModel

        return ZoeModel(source, **options)
    return TransformersModel(source, **options)


def _settings(source: str | None, config: dict[str, Any] | None) -> PreTrainedConfig:
    from transformers import AutoConfig

    if config is not None:
        return AutoConfig.for_model(**config)
    if source is None:
        raise UsageError(
            "no model is named", where="transformers", fix="load transformers:NAME_OR_FOLDER"
        )
    with reaching(source):
        return AutoConfig.from_pretrained(source, local_files_only=Path(source).is_dir())


def _refuse_relative(settings: PreTrainedConfig, metric: bool | None, *, where: str) -> None:  # noqa: FBT001 - tri-state
    from transformers.models.auto.modeling_auto import MODEL_FOR_DEPTH_ESTIMATION_MAPPING_NAMES

    kinds = sorted(MODEL_FOR_DEPTH_ESTIMATION_MAPPING_NAMES)
    if settings.model_type not in kinds:
        raise FormatError(
            f"a {settings.model_type!r} estimates no depth",
            where=where,
            fix=f"transformers has these that do: {', '.join(kinds)}",
        )
    if metric is None:
        said = getattr(settings, "depth_estimation_type", None)
        metric = said == "metric" or settings.model_type in _METRIC_BY_DESIGN
    if not metric:
        raise UsageError(
            f"this {settings.model_type!r} answers relative depth, which has no unit",
            where=where,
            fix="take a metric variant (such as Depth-Anything-V2-Metric-Outdoor), or give "
            "metric=True where you know that it answers metres",
        )


def _preparation(settings: PreTrainedConfig, said: dict[str, Any]) -> Preparation:
    """What the model's own file says, and where it says nothing, what models of its kind do."""
    patch = int(getattr(settings, "patch_size", None) or 1)
    mean, deviation = imagenet.MEAN, imagenet.DEVIATION
    height = width = None
    keep_aspect, multiple, cubic = False, 1, True
    match settings.model_type:
        case "depth_anything" | "prompt_depth_anything":
            height = width = 37 * patch
            keep_aspect, multiple = True, patch
        case "depth_pro":
            height = width = int(patch / min(settings.scaled_images_ratios))
            (mean, deviation), cubic = _HALVES, False
        case "glpn":
            (mean, deviation), cubic, multiple = _AS_IT_IS, False, 32
        case _:
            multiple = max(32, patch)
    size = said.get("size") or {}
    if not said.get("do_normalize", True):
        mean, deviation = _AS_IT_IS
    return Preparation(
        height_px=size.get("height", height),
        width_px=size.get("width", width),
        keep_aspect=bool(said.get("keep_aspect_ratio", keep_aspect)),
        side_multiple=int(said.get("ensure_multiple_of") or said.get("size_divisor") or multiple),
        round_down=settings.model_type == "glpn",
        cubic=said.get("resample", _CUBIC if cubic else None) == _CUBIC,
        mean=tuple(said.get("image_mean") or mean),
        deviation=tuple(said.get("image_std") or deviation),
    )


def _network(source: str | None, settings: PreTrainedConfig) -> nn.Module:
    from transformers import AutoModelForDepthEstimation

    if source is None:
        made: nn.Module = AutoModelForDepthEstimation.from_config(settings)
        return made
    with reaching(source):
        network, loading = AutoModelForDepthEstimation.from_pretrained(
            source, local_files_only=Path(source).is_dir(), output_loading_info=True
        )
    if loading["missing_keys"]:
        raise FormatError(
            f"the weights lack {', '.join(sorted(loading['missing_keys']))[:300]}",
            where=source,
            fix="use the config.json that belongs to the weights",
        )
    loaded: nn.Module = network
    return loaded
