"""What is asked of a training run, how it is to be done, and what was done."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from civil_rgbd.domain.split import Split
from civil_rgbd.training.journal import StepRecord
from civil_rgbd.training.recipe import TrainingRecipe


@dataclass(frozen=True, slots=True)
class TrainingJob:
    """What to train.

    Attributes:
        data: a dataset folder.
        split: its ``train`` is trained with.
        recipe: every number.
        out: the run's folder.
        seed: of weights, order and random changes.
        weights: a run or checkpoint whose weights come first; None for the recipe's.
    """

    data: Path
    split: Split
    recipe: TrainingRecipe
    out: Path
    seed: int = 0
    weights: Path | None = None


@dataclass(frozen=True, slots=True)
class TrainingOptions:
    """How to train; nothing here changes what comes out, on one kind of device.

    Attributes:
        device: ``auto``, ``cpu``, ``cuda``, ``mps``.
        workers: processes that decode; 0 for none.
        imagenet: file of ImageNet weights; None fetches them when the recipe asks for them.
        tensorboard: write for TensorBoard.
        overwrite: delete the run in the same folder, whichever it is, and train from the start.
        on_step: called with each step and the number of steps, in the first process.
    """

    device: str = "auto"
    workers: int = 0
    imagenet: Path | None = None
    tensorboard: bool = True
    overwrite: bool = False
    on_step: Callable[[StepRecord, int], object] = lambda _record, _steps: None


@dataclass(frozen=True, slots=True)
class TrainingReport:
    """What was done.

    Attributes:
        out: the run's folder; ``model.pt`` is there.
        frames: trained with.
        steps: of the run.
        steps_found: that were done before.
        last_loss: of the last step.
        seconds: that this took.
    """

    out: Path
    frames: int
    steps: int
    steps_found: int
    last_loss: float
    seconds: float
