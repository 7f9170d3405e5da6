"""A training recipe: every number of a training run."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True, slots=True)
class InputStage:
    """What of an image is trained with, in this order: common camera, resize, crop.

    Attributes:
        camera: width, height, fx, fy, cx, cy in pixels of one camera that all images are brought
            to; empty for none.
        width_px: images that are wider are resized to this width; 0 for none. Height follows.
        model_resizes: tell the model that size, so that it predicts at the scale it was trained at.
        crop_width_px: of a random crop; 0 for the most that the model takes; never more than that.
        crop_height_px: same.
        min_depth_m: truth must be greater to be trained with.
        max_depth_m: truth must be smaller.
    """

    camera: tuple[float, ...] = ()
    width_px: int = 0
    model_resizes: bool = True
    crop_width_px: int = 0
    crop_height_px: int = 0
    min_depth_m: float = 1e-3
    max_depth_m: float = 80.0


@dataclass(frozen=True, slots=True)
class AugmentStage:
    """Random changes.

    Attributes:
        flip: share of samples that are mirrored.
        roll_deg: the largest turn about the optical axis.
        zoom: the largest enlargement; 1 for none.
        zoom_keeps_camera: enlarged images keep their focal length, and depth is divided.
        colour: gamma, brightness and channels change by up to this.
        colour_share: of samples whose colours change.
    """

    flip: float = 0.5
    roll_deg: float = 0.0
    zoom: float = 1.0
    zoom_keeps_camera: bool = True
    colour: float = 0.1
    colour_share: float = 0.5


@dataclass(frozen=True, slots=True)
class OptimiserStage:
    """AdamW, and what is done to gradients.

    Attributes:
        learning_rate: of the decoder, at its highest.
        encoder_share: the encoder's learning rate is this times that.
        encoder_decay: weight decay of the encoder.
        decoder_decay: weight decay of the decoder.
        eps: of AdamW.
        beta_1: of AdamW; a one-cycle schedule moves it.
        beta_2: of AdamW.
        clip_norm: gradients are scaled down to this norm; 0 for no clipping.
    """

    learning_rate: float = 1e-4
    encoder_share: float = 1.0
    encoder_decay: float = 0.0
    decoder_decay: float = 0.0
    eps: float = 1e-8
    beta_1: float = 0.9
    beta_2: float = 0.999
    clip_norm: float = 0.0


@dataclass(frozen=True, slots=True)
class ScheduleStage:
    """How learning rate and momentum go over the run.

    Attributes:
        name: ``polynomial``, ``one-cycle`` or ``constant``.
        power: of the polynomial.
        end_share: the polynomial's last learning rate over its first.
        rise_share: share of the run in which the cycle's learning rate rises.
        start_div: the cycle starts at the highest learning rate over this.
        end_div: it ends at the first over this.
        momentum_low: of the cycle where the learning rate is highest.
        momentum_high: of the cycle at its ends.
    """

    name: str = "polynomial"
    power: float = 0.9
    end_share: float = 0.1
    rise_share: float = 0.3
    start_div: float = 25.0
    end_div: float = 1e4
    momentum_low: float = 0.85
    momentum_high: float = 0.95


@dataclass(frozen=True, slots=True)
class RunStage:
    """How long, and in which way.

    Attributes:
        batch: images a step, over all processes.
        epochs: passes over the training frames; 0 when ``steps`` says.
        steps: steps of the optimiser; 0 when ``epochs`` says.
        loss: ``bts`` or ``zoedepth``.
        pretrained: ``imagenet`` for an encoder that starts with ImageNet weights; empty for random.
        freeze_early_layers: keep fixed what fine-tuning leaves alone.
        amp: ``off``, ``bfloat16`` or ``float16``.
        ema_decay: of an average of the weights, which is what is saved; 0 for none.
        norm_batches: batches to estimate the norms' statistics with once more at the end: in short
            runs they lag behind the weights. 0 for none.
        checkpoint_every: steps between checkpoints; 0 for the end of each epoch.
    """

    batch: int = 8
    epochs: int = 0
    steps: int = 0
    loss: str = "bts"
    pretrained: str = ""
    freeze_early_layers: bool = False
    amp: str = "off"
    ema_decay: float = 0.0
    norm_batches: int = 0
    checkpoint_every: int = 0


@dataclass(frozen=True, slots=True)
class TrainingRecipe:
    """Every number of a run but its seed.

    Attributes:
        name: the file's stem.
        model: what ``load_model`` calls the model.
        model_options: handed to it.
    """

    name: str
    model: str
    model_options: Mapping[str, Any] = field(default_factory=dict)
    input: InputStage = field(default_factory=InputStage)
    augment: AugmentStage = field(default_factory=AugmentStage)
    optimiser: OptimiserStage = field(default_factory=OptimiserStage)
    schedule: ScheduleStage = field(default_factory=ScheduleStage)
    run: RunStage = field(default_factory=RunStage)

    def to_document(self) -> dict[str, Any]:
        """Return all of it as plain JSON values."""
        document: dict[str, Any] = json.loads(json.dumps(dataclasses.asdict(self)))
        return document

    def sha256(self) -> str:
        """Return the hash of all of it, lower-case hex."""
        text = json.dumps(self.to_document(), sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()
