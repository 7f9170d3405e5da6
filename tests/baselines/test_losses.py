"""SILog: the formulas, their gradients at the edges, and a batch that is divided over processes."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
import torch
from torch import Tensor, distributed, multiprocessing, nn

from civil_rgbd.baselines.losses import LOSSES, log_sums, over_processes
from civil_rgbd.training.processes import leave

SHAPE = (2, 1, 5, 7)


def batch(seed: int = 0, *, share: float = 0.4) -> tuple[Tensor, Tensor, Tensor]:
    generator = torch.Generator().manual_seed(seed)
    prediction = torch.rand(SHAPE, generator=generator) * 20 + 0.5
    truth = torch.rand(SHAPE, generator=generator) * 20 + 0.5
    valid = torch.rand(SHAPE, generator=generator) < share
    return prediction.requires_grad_(), torch.where(valid, truth, 0.0), valid


def by_hand(name: str, prediction: Tensor, truth: Tensor, valid: Tensor) -> Tensor:
    d = prediction[valid].double().log() - truth[valid].double().log()
    if name == "bts":
        return 10 * torch.sqrt((d**2).mean() - 0.85 * d.mean() ** 2)
    return 10 * torch.sqrt(torch.var(d) + 0.15 * d.mean() ** 2)


@pytest.mark.parametrize("name", LOSSES)
def test_value_and_gradient_are_those_of_the_formula(name: str) -> None:
    prediction, truth, valid = batch()
    loss = LOSSES[name](log_sums(prediction, truth, valid))
    (gradient,) = torch.autograd.grad(loss, prediction)
    wanted = by_hand(name, prediction, truth, valid)
    (wanted_gradient,) = torch.autograd.grad(wanted, prediction)

    torch.testing.assert_close(loss, wanted, rtol=1e-6, atol=0)
    torch.testing.assert_close(gradient, wanted_gradient, rtol=1e-4, atol=1e-7)
    assert (gradient[valid] != 0).all()


def test_the_two_losses_differ_by_the_unbiased_variance() -> None:
    prediction, truth, valid = batch()
    sums = log_sums(prediction.detach(), truth, valid)
    n, mean = sums.count, sums.log / sums.count
    variance = sums.log_square / n - mean**2

    assert float(LOSSES["zoedepth"](sums)) == pytest.approx(
        10 * math.sqrt(float(variance * n / (n - 1) + 0.15 * mean**2))
    )
    assert float(LOSSES["zoedepth"](sums)) > float(LOSSES["bts"](sums))


@pytest.mark.parametrize("name", LOSSES)
@pytest.mark.parametrize("case", ["no valid pixel", "one", "perfect", "nearly perfect", "scaled"])
def test_edges_have_a_finite_loss_and_gradient(name: str, case: str) -> None:
    prediction, truth, valid = batch()
    if case in {"no valid pixel", "one"}:
        valid = torch.zeros_like(valid)
        valid[1, 0, 2, 3] = case == "one"
        truth[1, 0, 2, 3] = 4.0
    else:
        factor = {"perfect": 1.0, "nearly perfect": 1 + 1e-7, "scaled": 2.0}[case]
        truth = torch.where(valid, prediction.detach() / factor, 0.0)
    loss = LOSSES[name](log_sums(prediction, truth, valid))
    loss.backward()

    assert math.isfinite(float(loss.detach()))
    assert prediction.grad is not None
    assert prediction.grad.isfinite().all()
    if case in {"no valid pixel", "perfect"}:
        assert float(loss.detach()) == 0
        assert not prediction.grad.any()


@pytest.mark.parametrize("name", LOSSES)
def test_what_stands_in_pixels_without_truth_does_not_matter(name: str) -> None:
    prediction, truth, valid = batch()
    wanted = LOSSES[name](log_sums(prediction, truth, valid))
    spoilt = prediction.detach().clone()
    spoilt[~valid] = torch.tensor([math.nan, math.inf, 0.0, -1.0]).repeat(100)[
        : int((~valid).sum())
    ]
    spoilt.requires_grad_()
    loss = LOSSES[name](log_sums(spoilt, truth, valid))
    loss.backward()

    assert loss == wanted
    assert spoilt.grad is not None
    assert spoilt.grad.isfinite().all()
    assert not spoilt.grad[~valid].any()


class Small(nn.Module):
    """A network with a norm and a parameter that each pixel needs."""

    def __init__(self) -> None:
        super().__init__()
        torch.manual_seed(3)
        self.layers = nn.Sequential(
            nn.Conv2d(3, 4, 3, padding=1),
            nn.BatchNorm2d(4),
            nn.ELU(),
            nn.Conv2d(4, 1, 3, padding=1),
        )

    def forward(self, image: Tensor) -> Tensor:
        depth_m: Tensor = self.layers(image).exp()
        return depth_m


def loss_of(model: nn.Module, part: slice, name: str) -> Tensor:
    generator = torch.Generator().manual_seed(1)
    images = torch.rand((4, 3, 8, 8), generator=generator)
    truth = torch.rand((4, 1, 8, 8), generator=generator) * 9 + 1
    valid = torch.rand((4, 1, 8, 8), generator=generator) < 0.5
    # One process has many valid pixels, the other few; in the last case none.
    valid[2:] &= torch.rand((2, 1, 8, 8), generator=generator) < 0.1
    if name.endswith("empty"):
        valid[2:] = False
    sums = log_sums(model(images[part]), truth[part], valid[part])
    return LOSSES[name.split(maxsplit=1)[0]](over_processes(sums))


CASES = ("bts", "zoedepth", "bts empty")


def one_process_of_two(rank: int, folder: str) -> None:
    torch.set_num_threads(1)
    store = distributed.FileStore(f"{folder}/store", 2)
    distributed.init_process_group("gloo", store=store, rank=rank, world_size=2)
    for name in CASES:
        save_loss_and_gradients(name, rank, folder)
    leave()


def save_loss_and_gradients(name: str, rank: int, folder: str) -> None:
    model = nn.parallel.DistributedDataParallel(Small().eval())
    loss = loss_of(model, slice(2 * rank, 2 * rank + 2), name)
    loss.backward()
    gradients = [parameter.grad for parameter in model.module.parameters()]
    torch.save((loss.detach(), gradients), f"{folder}/{name} {rank}.pt")


@pytest.fixture(scope="module")
def from_two_processes(tmp_path_factory: pytest.TempPathFactory, spawned_tests: None) -> Path:
    """What two processes, each with half of the batch, make of every case."""
    del spawned_tests  # asked for what it does
    folder = tmp_path_factory.mktemp("two_processes")
    multiprocessing.spawn(one_process_of_two, (str(folder),), nprocs=2)
    return folder


@pytest.mark.parametrize("name", CASES)
def test_two_processes_have_loss_and_gradients_of_the_undivided_batch(
    name: str, from_two_processes: Path
) -> None:
    model = Small().eval()
    whole = loss_of(model, slice(0, 4), name)
    whole.backward()

    for rank in range(2):
        path = from_two_processes / f"{name} {rank}.pt"
        loss, gradients = torch.load(path, weights_only=True)
        torch.testing.assert_close(loss, whole.detach(), rtol=1e-5, atol=0)
        for found, parameter in zip(gradients, model.parameters(), strict=True):
            torch.testing.assert_close(found, parameter.grad, rtol=1e-5, atol=1e-6)
            assert found.any()
