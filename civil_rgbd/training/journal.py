"""What happens in a run, step by step: CSV for anyone, TensorBoard for those who have it."""

from __future__ import annotations

import csv
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, Final

from civil_rgbd.errors import MissingExtraError
from civil_rgbd.format.atomic import writing
from civil_rgbd.format.documents import write_text

STEPS: Final = "steps.csv"
"""Name of the file in a run folder."""

BOARD: Final = "tensorboard"
"""Name of the folder in a run folder."""


@dataclass(frozen=True, slots=True)
class StepRecord:
    """One step of the optimiser. No times: the same run gives the same rows.

    Attributes:
        step: counted from 1.
        epoch: passes over the training frames, begun.
        loss: of the batch of all processes.
        learning_rate: of the decoder.
        gradient_norm: before clipping.
        valid_pixels: that the loss is made of.
    """

    step: int
    epoch: int
    loss: float
    learning_rate: float
    gradient_norm: float
    valid_pixels: int


class Journal:
    """Writes a run's steps; close it at the end.

    Args:
        run: the run's folder; it exists.
        done: steps that are done: rows after them, of steps that a kill undid, are removed.
        board: write for TensorBoard, too.

    Raises:
        MissingExtraError: TensorBoard is asked for and not installed.
        OutputError: the folder cannot be written.
    """

    def __init__(self, run: Path, *, done: int, board: bool) -> None:
        self._path = run / STEPS
        names = [one.name for one in fields(StepRecord)]
        kept = [",".join(names), *(_rows(self._path)[:done])]
        write_text(self._path, "".join(f"{line}\n" for line in kept))
        with writing(self._path):
            self._stream = self._path.open("a", encoding="utf-8", newline="")
        self._rows = csv.writer(self._stream, lineterminator="\n")
        self._board = _summary_writer(run / BOARD, done) if board else None

    def close(self) -> None:
        """Close the files."""
        self._stream.close()
        if self._board is not None:
            self._board.close()

    def add(self, record: StepRecord) -> None:
        """Write one step.

        Raises:
            OutputError: the disk is full, or the like.
        """
        with writing(self._path):
            self._rows.writerow(asdict(record).values())
            self._stream.flush()
        if self._board is not None:
            for name in ("loss", "learning_rate", "gradient_norm"):
                self._board.add_scalar(f"train/{name}", getattr(record, name), record.step)


def read_steps(run: Path) -> list[StepRecord]:
    """Read the steps of a run so far; [] before the first."""
    numbers = (line.split(",") for line in _rows(run / STEPS))
    return [
        StepRecord(int(step), int(epoch), float(loss), float(rate), float(norm), int(pixels))
        for step, epoch, loss, rate, norm, pixels in numbers
    ]


def _rows(path: Path) -> list[str]:
    """Return the whole lines after the head; a kill may leave half of one."""
    if not path.is_file():
        return []
    *whole, _rest = path.read_text("utf-8").split("\n")
    return whole[1:]


def _summary_writer(folder: Path, done: int) -> Any:  # noqa: ANN401  # tensorboard has no types
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ImportError as error:
        raise MissingExtraError(
            f"TensorBoard cannot be imported: {error}",
            where="train",
            fix='pip install "civil-rgbd[train]", or give --no-tensorboard',
        ) from error
    return SummaryWriter(str(folder), purge_step=done + 1)
