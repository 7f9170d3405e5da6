"""Which frame is trained with when: a function of seed and step alone."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Place = tuple[int, int]
"""An epoch, and the number of a frame in the training set."""


@dataclass(frozen=True, slots=True)
class TrainingOrder:
    """An endless row of frames, a permutation an epoch, cut into batches.

    Batches go on over the end of an epoch: none is short, and a set smaller than a batch works.
    The state of this sampler is the number of steps done.

    Attributes:
        frames: how many there are.
        batch: frames a step, over all processes.
        seed: of the permutations.
    """

    frames: int
    batch: int
    seed: int

    def steps_of(self, epochs: int) -> int:
        """Count the steps of some epochs, rounded up."""
        return -(-epochs * self.frames // self.batch)

    def batch_at(self, step: int) -> list[Place]:
        """Return the frames of a step."""
        numbers = range(step * self.batch, (step + 1) * self.batch)
        epochs = {number // self.frames for number in numbers}
        orders = {epoch: self._permutation(epoch) for epoch in epochs}
        return [
            (number // self.frames, int(orders[number // self.frames][number % self.frames]))
            for number in numbers
        ]

    def batches(
        self, first: int, last: int, *, rank: int = 0, processes: int = 1
    ) -> Iterator[list[Place]]:
        """Yield what one of some processes sees: its share of each batch, from step to step.

        Args:
            first: step.
            last: step after the last.
            rank: which process.
            processes: how many; a divisor of ``batch``.
        """
        for step in range(first, last):
            yield self.batch_at(step)[rank::processes]

    def _permutation(self, epoch: int) -> NDArray[np.int64]:
        return np.random.default_rng([self.seed, epoch]).permutation(self.frames)


def seed_of(seed: int, place: Place) -> int:
    """Return the seed of one frame's random changes in one epoch."""
    return int(np.random.SeedSequence([seed, *place]).generate_state(1, np.uint64)[0])
