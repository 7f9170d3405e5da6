"""A run on disk: all that it takes to go on as if it had never been stopped."""

from __future__ import annotations

import pickle
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final
from zipfile import BadZipFile

import torch
from torch import Tensor, distributed

from civil_rgbd.errors import FormatError, TrainingError
from civil_rgbd.format.atomic import whole_file

CHECKPOINT: Final = "checkpoint.pt"
"""Name of the file in a run folder."""


def write_checkpoint(path: Path, state: Mapping[str, Any]) -> None:
    """Write a checkpoint, whole or not at all.

    Args:
        path: the file to make; its folder exists.
        state: tensors, numbers, words, and dictionaries and lists of these.

    Raises:
        OutputError: the file cannot be written.
    """
    with whole_file(path) as scratch, scratch.open("wb") as stream:
        try:
            torch.save(dict(state), stream)
        except RuntimeError as error:  # torch's word for a full disk
            raise OSError(str(error)) from error


def read_checkpoint(path: Path, *, identity: Mapping[str, Any]) -> dict[str, Any] | None:
    """Read the checkpoint of a run; None where there is none.

    Args:
        path: the file.
        identity: what the run is: recipe, seed, split, processes.

    Raises:
        FormatError: the file is damaged.
        TrainingError: it is of another run; says what differs.
    """
    if not path.is_file():
        return None
    try:
        state: dict[str, Any] = torch.load(path, map_location="cpu", weights_only=True)
    except (RuntimeError, EOFError, BadZipFile, pickle.UnpicklingError, ValueError) as error:
        raise FormatError(
            f"the checkpoint cannot be read: {str(error).splitlines()[0][:200]}",
            where=path,
            fix="delete it to train from the start; it is written whole, so the disk is suspect",
        ) from error
    refuse_other_run(state["identity"], identity, where=path)
    return state


def refuse_other_run(found: Mapping[str, Any], wanted: Mapping[str, Any], *, where: object) -> None:
    """Refuse to go on with a run that was begun otherwise.

    Raises:
        TrainingError: it is so; says what differs.
    """
    differing = [
        f"{key} {found.get(key)!r} -> {wanted.get(key)!r}"
        for key in sorted({*found, *wanted})
        if found.get(key) != wanted.get(key)
    ]
    if differing:
        raise TrainingError(
            f"another run lies here: {', '.join(differing)[:400]}",
            where=where,
            fix="give another --out; or --overwrite to delete what is there",
        )


def random_states(device: torch.device) -> list[Tensor]:
    """Return the state of every process's random numbers, in the order of ranks.

    All processes call it together; a process has one tensor, or on a GPU the two joined.
    """
    own = torch.random.get_rng_state()
    if device.type == "cuda":
        own = torch.cat([own, torch.cuda.get_rng_state(device)])
    if not distributed.is_initialized():
        return [own]
    every: list[Any] = [None] * distributed.get_world_size()
    distributed.all_gather_object(every, own)
    return every


def restore_random(states: list[Tensor], rank: int, device: torch.device) -> None:
    """Put this process's random numbers back to where they were."""
    length = len(torch.random.get_rng_state())
    torch.random.set_rng_state(states[rank][:length])
    if device.type == "cuda":
        torch.cuda.set_rng_state(states[rank][length:], device)
