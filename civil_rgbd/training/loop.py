"""The loop: forward, loss, backward, step; and all of its state, to save and to restore."""

from __future__ import annotations

import math
from collections.abc import Iterable
from contextlib import AbstractContextManager
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn import Parameter

from civil_rgbd.baselines.losses import LOSSES, log_sums, over_processes
from civil_rgbd.baselines.torch_model import TorchDepthModel
from civil_rgbd.errors import TrainingError
from civil_rgbd.training.averages import WeightAverage
from civil_rgbd.training.checkpoint import random_states, restore_random
from civil_rgbd.training.frames import Batch
from civil_rgbd.training.journal import StepRecord
from civil_rgbd.training.order import TrainingOrder
from civil_rgbd.training.processes import Processes, spread
from civil_rgbd.training.recipe import TrainingRecipe
from civil_rgbd.training.schedule import learning_rate_share, momentum

_PRECISIONS = {"bfloat16": torch.bfloat16, "float16": torch.float16}


class TrainingLoop:
    """A model in training.

    Args:
        model: on its device.
        recipe: every number.
        order: which frames when; says how many steps an epoch has.
        processes: this one among those of the run.

    Attributes:
        done: steps that are done.
        steps: of the whole run.
        average: of the weights; None when the recipe asks for none.
    """

    def __init__(
        self,
        model: TorchDepthModel,
        recipe: TrainingRecipe,
        order: TrainingOrder,
        processes: Processes,
    ) -> None:
        self.model, self.recipe, self.order, self.processes = model, recipe, order, processes
        self.steps = recipe.run.steps or order.steps_of(recipe.run.epochs)
        self.done = 0
        self._called: nn.Module = spread(model, processes)
        self._optimiser = optimiser_of(model, recipe)
        self._scaler = torch.amp.GradScaler(
            processes.device.type, enabled=recipe.run.amp == "float16"
        )
        decay = recipe.run.ema_decay
        self.average = WeightAverage(model, decay) if decay else None

    def step(self, batch: Batch) -> StepRecord:
        """Train with one batch: this process's part of it.

        Raises:
            TrainingError: the loss is not finite.
        """
        rate = self._set_rates()
        self._called.train()
        sums = over_processes(
            log_sums(
                self.forward(batch),
                batch["depth"].to(self.processes.device),
                batch["valid"].to(self.processes.device),
            )
        )
        loss = LOSSES[self.recipe.run.loss](sums)
        value = float(loss.detach())
        if not math.isfinite(value):
            raise _diverged(value, self.done + 1, batch)
        self._optimiser.zero_grad(set_to_none=True)
        scaled: Tensor = self._scaler.scale(loss)
        scaled.backward()  # type: ignore[no-untyped-call]  # torch's own lack
        self._scaler.unscale_(self._optimiser)
        norm = nn.utils.clip_grad_norm_(
            self._parameters(), self.recipe.optimiser.clip_norm or math.inf
        )
        self._scaler.step(self._optimiser)
        self._scaler.update()
        if self.average is not None:
            self.average.update(self.model)
        self.done += 1
        epoch = (self.done * self.order.batch - 1) // self.order.frames + 1
        return StepRecord(self.done, epoch, value, rate, float(norm), int(sums.count.detach()))

    def forward(self, batch: Batch) -> Tensor:
        """Predict a batch: (B, 1, H, W) metres, with gradient unless it is switched off."""
        device = self.processes.device
        with self._precision():
            depth_m: Tensor = self._called(
                batch["image"].to(device), batch["intrinsics"].to(device)
            )
        return depth_m.float()

    def state(self) -> dict[str, Any]:
        """Return all that it takes to go on; every process calls it, the first one writes it."""
        return {
            "done": self.done,
            "model": self.model.network.state_dict(),
            "optimiser": self._optimiser.state_dict(),
            "scaler": self._scaler.state_dict(),
            "average": None if self.average is None else self.average.state_dict(),
            "random": random_states(self.processes.device),
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Go on from :meth:`state`."""
        self.done = state["done"]
        self.model.network.load_state_dict(state["model"])
        self._optimiser.load_state_dict(state["optimiser"])
        self._scaler.load_state_dict(state["scaler"])
        if self.average is not None:
            self.average.load_state_dict(state["average"])
        restore_random(state["random"], self.processes.rank, self.processes.device)

    def _set_rates(self) -> float:
        recipe = self.recipe
        share = learning_rate_share(recipe.schedule, self.done, self.steps)
        beta_1 = momentum(recipe.schedule, recipe.optimiser, self.done, self.steps)
        for group in self._optimiser.param_groups:
            group["lr"] = group["highest"] * share
            group["betas"] = (beta_1, recipe.optimiser.beta_2)
        return recipe.optimiser.learning_rate * share

    def _precision(self) -> AbstractContextManager[object]:
        kind = _PRECISIONS.get(self.recipe.run.amp)
        return torch.autocast(self.processes.device.type, dtype=kind, enabled=kind is not None)

    def _parameters(self) -> Iterable[Parameter]:
        return (one for group in self._optimiser.param_groups for one in group["params"])


def optimiser_of(model: TorchDepthModel, recipe: TrainingRecipe) -> torch.optim.AdamW:
    """Return AdamW over the model's groups, each with its rate and decay."""
    numbers = recipe.optimiser
    decays = {"encoder": numbers.encoder_decay, "decoder": numbers.decoder_decay}
    shares = {"encoder": numbers.encoder_share, "decoder": 1.0}
    groups = [
        {
            "params": parameters,
            "lr": numbers.learning_rate * shares[name],
            "highest": numbers.learning_rate * shares[name],
            "weight_decay": decays[name],
        }
        for name, parameters in model.parameter_groups().items()
        if parameters
    ]
    return torch.optim.AdamW(groups, betas=(numbers.beta_1, numbers.beta_2), eps=numbers.eps)


def _diverged(value: float, step: int, batch: Batch) -> TrainingError:
    names = batch["names"]
    shown = ", ".join(names[:4]) + (f" and {len(names) - 4} more" if len(names) > 4 else "")
    return TrainingError(
        f"the loss is {value} at step {step}: the training diverged",
        where=f"frames {shown}",
        fix="a smaller --set optimiser.learning_rate=..., or clipping: "
        "--set optimiser.clip_norm=1.0",
    )
