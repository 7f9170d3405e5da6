"""Schedules as functions of the step: BTS's polynomial, and torch's one-cycle."""

from __future__ import annotations

import pytest
import torch

from civil_rgbd.training.recipe import OptimiserStage, ScheduleStage
from civil_rgbd.training.schedule import learning_rate_share, momentum


def test_the_polynomial_goes_from_one_to_its_end() -> None:
    schedule = ScheduleStage(name="polynomial", power=0.9, end_share=0.1)
    shares = [learning_rate_share(schedule, step, 100) for step in range(101)]

    assert shares[0] == 1.0
    assert shares[50] == pytest.approx(0.9 * 0.5**0.9 + 0.1)
    assert shares[100] == pytest.approx(0.1)
    assert shares == sorted(shares, reverse=True)


@pytest.mark.parametrize(("start_div", "rise_share"), [(1.0, 0.7), (25.0, 0.3), (10.0, 0.1)])
def test_the_cycle_is_torchs_own(start_div: float, rise_share: float) -> None:
    schedule = ScheduleStage(
        name="one-cycle", start_div=start_div, rise_share=rise_share, end_div=1e4
    )
    numbers = OptimiserStage(learning_rate=1.61e-4)
    parameter = torch.nn.Parameter(torch.zeros(1))
    optimiser = torch.optim.AdamW([parameter], lr=numbers.learning_rate)
    theirs = torch.optim.lr_scheduler.OneCycleLR(
        optimiser,
        numbers.learning_rate,
        total_steps=50,
        pct_start=rise_share,
        div_factor=start_div,
        final_div_factor=1e4,
        base_momentum=0.85,
        max_momentum=0.95,
    )
    for step in range(50):
        (group,) = optimiser.param_groups
        share = learning_rate_share(schedule, step, 50)
        assert share * numbers.learning_rate == pytest.approx(group["lr"], rel=1e-9)
        assert momentum(schedule, numbers, step, 50) == pytest.approx(group["betas"][0])
        optimiser.step()
        theirs.step()


def test_other_schedules_leave_the_momentum_alone() -> None:
    constant = ScheduleStage(name="constant")

    assert momentum(constant, OptimiserStage(beta_1=0.8), 3, 10) == 0.8
    assert learning_rate_share(constant, 3, 10) == 1.0
