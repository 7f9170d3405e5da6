"""Learning rate and momentum as functions of the step: nothing to save, nothing to restore."""

from __future__ import annotations

import math

from civil_rgbd.training.recipe import OptimiserStage, ScheduleStage


def learning_rate_share(schedule: ScheduleStage, step: int, steps: int) -> float:
    """Return the learning rate of a step over the highest.

    Args:
        schedule: its shape.
        step: from 0 to ``steps`` - 1.
        steps: of the whole run.
    """
    if schedule.name == "constant":
        return 1.0
    if schedule.name == "polynomial":
        share: float = (1 - step / steps) ** schedule.power
        return (1 - schedule.end_share) * share + schedule.end_share
    low = 1 / schedule.start_div
    rising, done = _cycle(schedule, step, steps)
    if rising:
        return _cosine(low, 1.0, done)
    return _cosine(1.0, low / schedule.end_div, done)


def momentum(schedule: ScheduleStage, optimiser: OptimiserStage, step: int, steps: int) -> float:
    """Return AdamW's first beta at a step; arguments as of :func:`learning_rate_share`."""
    if schedule.name != "one-cycle":
        return optimiser.beta_1
    rising, done = _cycle(schedule, step, steps)
    high, low = schedule.momentum_high, schedule.momentum_low
    return _cosine(high, low, done) if rising else _cosine(low, high, done)


def _cycle(schedule: ScheduleStage, step: int, steps: int) -> tuple[bool, float]:
    """Tell whether the rate rises, and how much of its rise or fall is done: 0 to 1."""
    # As torch's OneCycleLR counts: the peak is step ``top``, the end is the last step.
    top, last = schedule.rise_share * steps - 1, steps - 1
    if step <= top:
        return True, step / top if top > 0 else 1.0
    return False, (step - top) / (last - top) if last > top else 1.0


def _cosine(start: float, end: float, done: float) -> float:
    return end + (start - end) / 2 * (1 + math.cos(math.pi * done))
