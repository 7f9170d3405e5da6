"""Shares of a build for job arrays: part i of N, the same wherever it is worked out."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import re
from dataclasses import dataclass
from typing import Final

from civil_rgbd.errors import UsageError
from civil_rgbd.format.atomic import whole_file
from civil_rgbd.storage.places import Place

BEGIN_WAIT_S: Final = 600.0
"""How long to wait at the gate: other parts of the same build plan and check meanwhile."""

_DIVISION: Final = "division-"


def gate_of(partial: Place) -> Place:
    """Name what those lock who begin a part of a build, or finish it: one after the other."""
    return partial.with_name(f"{partial.name}.begin")


@dataclass(frozen=True, slots=True)
class Share:
    """One part of a build that many jobs share.

    Attributes:
        number: which, from 1.
        of: how many there are.
    """

    number: int
    of: int

    def __post_init__(self) -> None:
        if not 1 <= self.number <= self.of:
            raise UsageError(
                f"part {self.number} of {self.of} does not exist: parts count from 1",
                where="--chunk",
                fix=f"give --chunk 1/{max(self.of, 1)} and so on; with SLURM, sbatch "
                f"--array=1-{max(self.of, 1)} and --chunk "
                "$SLURM_ARRAY_TASK_ID/$SLURM_ARRAY_TASK_COUNT",
            )

    def __str__(self) -> str:
        return f"{self.number}/{self.of}"

    def frames_of(self, frames: int, *, bridge: int, bridges: int) -> tuple[int, int]:
        """Return which frames of a bridge belong to this share.

        The bridges lie on a line, each one unit long; share i of N has the i-th of N equal parts
        of the line. So a job need not know bridges that its share does not touch.

        Args:
            frames: how many the bridge's plan has.
            bridge: the bridge's place among all, from 0.
            bridges: how many there are.

        Returns:
            first frame, and the one after the last, as indices of the plan.

        >>> [Share(i, 3).frames_of(10, bridge=0, bridges=1) for i in (1, 2, 3)]
        [(0, 3), (3, 6), (6, 10)]
        >>> [Share(i, 2).frames_of(10, bridge=1, bridges=2) for i in (1, 2)]
        [(0, 0), (0, 10)]
        """
        first = (self.number - 1) * bridges - bridge * self.of
        stop = self.number * bridges - bridge * self.of
        return self._clip(first) * frames // self.of, self._clip(stop) * frames // self.of

    def touches(self, *, bridge: int, bridges: int) -> bool:
        """Tell whether any of a bridge belongs to this share, however many frames it has."""
        first, stop = self.frames_of(self.of, bridge=bridge, bridges=bridges)
        return first < stop

    def _clip(self, ticks: int) -> int:
        return min(max(ticks, 0), self.of)


def share_from(text: str) -> Share:
    """Read ``i/N``.

    Raises:
        UsageError: it is something else.

    >>> share_from("2/8")
    Share(number=2, of=8)
    """
    found = re.fullmatch(r"([0-9]{1,9})/([0-9]{1,9})", text.strip())
    if not found:
        raise UsageError(
            f"{text!r} is no part of a build",
            where="--chunk",
            fix="give part and number of parts, for example --chunk 3/8 for the third of eight",
        )
    return Share(int(found[1]), int(found[2]))


@dataclass(frozen=True, slots=True)
class Division:
    """How a bridge was divided among jobs: what its parts can be counted from.

    Attributes:
        of: how many parts there are.
        bridge: the bridge's place among all, from 0.
        bridges: how many there are.
    """

    of: int
    bridge: int
    bridges: int


def write_division(partial: Place, division: Division) -> None:
    """Remember how an unfinished bridge is divided; all its jobs write the same.

    Raises:
        OutputError: the file cannot be written.
    """
    with whole_file(partial / f"{_DIVISION}{division.of}.json") as scratch:
        scratch.write_text(json.dumps(dataclasses.asdict(division)), encoding="utf-8")


def read_divisions(partial: Place) -> list[Division]:
    """Return how an unfinished bridge was divided, the latest division last."""
    found: list[Place] = [*partial.glob(f"{_DIVISION}*.json")]
    found.sort(key=lambda path: path.stat().st_mtime_ns)
    divisions = []
    for path in found:
        with contextlib.suppress(OSError, ValueError, TypeError):  # it only helps to say what lacks
            divisions.append(Division(**json.loads(path.read_text("utf-8"))))
    return divisions
