"""ZoeDepth (arXiv 2302.12288) on the network of ``transformers``, with the authors' numbers.

Three settings of the published weights do not give the authors' outputs, and are put right here:
the norms' epsilon (1e-6, not 1e-12), the largest depth (``Intel/zoedepth-kitti`` says 10 m for a
head that was trained to 80 m, so its answers are 8 times too small), and stochastic depth, which
the authors do not use.
"""

from __future__ import annotations

import json
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal

from torch import Tensor, nn
from torch.nn import Parameter, functional

from civil_rgbd.baselines.fitting import InputFit
from civil_rgbd.baselines.hub import reaching, require_transformers
from civil_rgbd.baselines.torch_model import TorchDepthModel, as_unit_range, trainable
from civil_rgbd.errors import FormatError, UsageError

if TYPE_CHECKING:
    from transformers import ZoeDepthConfig

Head = Literal["normed", "softplus"]

HEADS: Final = ("normed", "softplus")
"""Bin centres: bounded by the largest depth (the authors' for KITTI), or unbounded (for NYU)."""

HUB_NAME: Final = "Intel/zoedepth-kitti"
"""The authors' ZoeD-M12-K."""

SIDE_MULTIPLE: Final = 32
"""Of the network's input: patches of 16, and a feature map of half their number."""

_LAYER_NORM_EPS: Final = 1e-6
_NEVER_USED: Final = "neck.fusion_stage.layers.0.residual_layer1."
"""The first fusion has nothing to add: these tensors exist, and never get a gradient."""


class ZoeModel(TorchDepthModel):
    """ZoeDepth with its preprocessing; images and predictions may have any size.

    Args:
        source: name on the Hugging Face hub, or a folder that holds ``config.json`` and weights;
            None together with ``config``.
        config: a configuration instead, for random weights.
        head: ``normed`` or ``softplus``; None keeps that of ``source``. Where the weights are those
            of the other head, tensors that do not fit start at random, with a warning.
        min_depth_m: the least depth.
        max_depth_m: the largest depth of the bounded head, the scale of the other one. A network
            of several heads keeps its own.
        width_px: columns of the network's input, a multiple of 32.
        height_px: rows of the network's input, a multiple of 32.

    Raises:
        UsageError: the options do not go together.
        FormatError: ``source`` holds no ZoeDepth, or its weights are not complete.
        DownloadError: the hub cannot be reached.
        MissingExtraError: transformers is not installed.
    """

    def __init__(
        self,
        source: str | None = HUB_NAME,
        *,
        config: dict[str, Any] | None = None,
        head: Head | None = None,
        min_depth_m: float = 1e-3,
        max_depth_m: float = 80.0,
        width_px: int = 768,
        height_px: int = 384,
        name: str = "zoe",
    ) -> None:
        require_transformers("ZoeDepth")
        from transformers import ZoeDepthForDepthEstimation

        _refuse(head, width_px=width_px, height_px=height_px)
        if config is not None:
            source = None  # a configuration says all; saved models bring theirs
        settings = _settings(source, config)
        _put_right(settings, head, min_depth_m=min_depth_m, max_depth_m=max_depth_m)
        network = (
            ZoeDepthForDepthEstimation(settings)
            if source is None
            else _with_weights(source, settings, head)
        )
        heads = settings.bin_configurations
        min_depth_m = min(float(one["min_depth"]) for one in heads)
        max_depth_m = max(float(one["max_depth"]) for one in heads)
        options = {
            "config": json.loads(settings.to_json_string(use_diff=False)),
            "min_depth_m": min_depth_m,
            "max_depth_m": max_depth_m,
            "width_px": width_px,
            "height_px": height_px,
        }
        super().__init__(
            name, options, fit=InputFit(), min_depth_m=min_depth_m, max_depth_m=max_depth_m
        )
        self.input_px = (height_px, width_px)
        self.network, self.is_trained = network, source is not None
        for key, parameter in network.named_parameters():
            if key.startswith(_NEVER_USED):
                parameter.requires_grad = False

    def forward(self, rgb: Tensor, intrinsics: Tensor) -> Tensor:
        """Predict a batch, with gradient; see :class:`TorchDepthModel`. The camera is not used."""
        del intrinsics
        answer = self.network(zoe_input(as_unit_range(rgb), self.input_px)).predicted_depth
        # Corners on corners there and back, as the authors resize.
        depth_m = functional.interpolate(
            answer[:, None].float(), size=rgb.shape[-2:], mode="bilinear", align_corners=True
        )
        return depth_m.clamp_min(self.min_depth_m)

    def parameter_groups(self) -> dict[str, list[Parameter]]:
        """Return what is trained, by ``encoder`` and ``decoder``; position bias is encoder."""
        children = dict(self.network.named_children())
        encoder = trainable(children.pop("backbone"))
        return {
            "encoder": encoder,
            "decoder": [one for child in children.values() for one in trainable(child)],
        }

    def freeze_early_layers(self) -> int:
        """Freeze nothing: the authors train everything, the encoder slowly."""
        return 0


def zoe_input(rgb: Tensor, input_px: tuple[int, int]) -> Tensor:
    """Make the network's input.

    Args:
        rgb: (B, 3, H, W) in 0 to 1.
        input_px: rows and columns of the input.

    Returns:
        (B, 3, rows, columns) in -1 to 1.
    """
    resized = functional.interpolate(rgb, size=input_px, mode="bilinear", align_corners=True)
    return (resized - 0.5) / 0.5


def zoe_small(
    *,
    config: dict[str, Any] | None = None,
    head: Head | None = None,
    min_depth_m: float = 1e-3,
    max_depth_m: float = 80.0,
    width_px: int = 192,
    height_px: int = 96,
) -> ZoeModel:
    """Make a ZoeDepth that a CPU can train, with random weights: 4 layers of 64 features."""
    return ZoeModel(
        None,
        config=config or _small_config(width_px=width_px, height_px=height_px),
        head=head,
        min_depth_m=min_depth_m,
        max_depth_m=max_depth_m,
        width_px=width_px,
        height_px=height_px,
        name="zoe-small",
    )


def _small_config(*, width_px: int, height_px: int) -> dict[str, Any]:
    return {
        "backbone_config": {
            "model_type": "beit",
            "image_size": [height_px, width_px],
            "num_hidden_layers": 4,
            "hidden_size": 64,
            "intermediate_size": 256,
            "num_attention_heads": 4,
            "use_relative_position_bias": True,
            "reshape_hidden_states": False,
            "out_features": ["stage1", "stage2", "stage3", "stage4"],
        },
        "neck_hidden_sizes": [16, 32, 64, 64],
        "fusion_hidden_size": 32,
        "bottleneck_features": 32,
        "num_relative_features": 32,
        "bin_embedding_dim": 32,
        "bin_centers_type": "normed",
    }


def _refuse(head: str | None, *, width_px: int, height_px: int) -> None:
    if head not in (None, *HEADS):
        raise UsageError(
            f"ZoeDepth has no head {head!r}", where="head", fix=f"choose {' or '.join(HEADS)}"
        )
    if min(width_px, height_px) < 1 or width_px % SIDE_MULTIPLE or height_px % SIDE_MULTIPLE:
        raise UsageError(
            f"ZoeDepth's input has sides of multiples of {SIDE_MULTIPLE} px, not "
            f"{width_px} x {height_px}",
            where="width_px, height_px",
            fix="the authors use 768 x 384 outdoors; images of any size are resized to it",
        )


def _settings(source: str | None, config: dict[str, Any] | None) -> ZoeDepthConfig:
    from transformers import AutoConfig, ZoeDepthConfig

    if source is None:
        return ZoeDepthConfig.from_dict(dict(config or {}))
    with reaching(source):
        settings = AutoConfig.from_pretrained(source, local_files_only=Path(source).is_dir())
    if not isinstance(settings, ZoeDepthConfig):
        raise FormatError(
            f"the configuration describes {settings.model_type!r}, not ZoeDepth",
            where=source,
            fix=f"load it as transformers:{source}",
        )
    return settings


def _put_right(
    settings: ZoeDepthConfig, head: str | None, *, min_depth_m: float, max_depth_m: float
) -> None:
    settings.backbone_config.layer_norm_eps = _LAYER_NORM_EPS
    settings.backbone_config.drop_path_rate = 0.0
    settings.bin_centers_type = head or settings.bin_centers_type
    heads = settings.bin_configurations
    if len(heads) == 1:
        settings.bin_configurations = [
            {**heads[0], "min_depth": min_depth_m, "max_depth": max_depth_m}
        ]


def _with_weights(source: str, settings: ZoeDepthConfig, head: str | None) -> nn.Module:
    from transformers import ZoeDepthForDepthEstimation

    with reaching(source):
        network, loading = ZoeDepthForDepthEstimation.from_pretrained(
            source,
            config=settings,
            local_files_only=Path(source).is_dir(),
            ignore_mismatched_sizes=True,  # told apart below, in our own words
            output_loading_info=True,
        )
    other_shape = sorted(str(entry[0]) for entry in loading["mismatched_keys"])
    missing = sorted(loading["missing_keys"])
    if missing or (other_shape and head is None):
        raise FormatError(
            "the weights are not those of this ZoeDepth: "
            f"missing {', '.join(missing) or 'none'}; of another shape "
            f"{', '.join(other_shape) or 'none'}",
            where=source,
            fix="use the config.json that belongs to the weights, or choose the head",
        )
    if other_shape:
        warnings.warn(
            f"{source}: the head {head!r} is not that of the weights; these start at random: "
            + ", ".join(other_shape),
            stacklevel=4,
        )
    made: nn.Module = network
    return made
