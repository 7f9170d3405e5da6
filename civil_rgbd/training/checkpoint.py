"""A run on disk: all that it takes to go on as if it had never been stopped."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import torch
from torch import Tensor, distributed

from civil_rgbd.baselines.checkpoints import UNREADABLE, damage_of
from civil_rgbd.errors import FormatError, TrainingError

CHECKPOINT: Final = "checkpoint.pt"
"""Name of the file in a run folder."""

_HASH_DIGITS: Final = 64


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
    except UNREADABLE as error:
        raise FormatError(
            f"the checkpoint cannot be read: {damage_of(error)}",
            where=path,
            fix="delete it to train from the start; it is written whole, so the disk is suspect",
        ) from error
    refuse_other_run(state["identity"], identity, where=path)
    return state


def refuse_other_run(
    found: Mapping[str, Any],
    wanted: Mapping[str, Any],
    *,
    where: object,
    recipes: tuple[Mapping[str, Any], Mapping[str, Any]] = ({}, {}),
    fix: str = "give another --out; or --overwrite to delete what is there",
) -> None:
    """Refuse to go on with a run that was begun otherwise.

    Args:
        found: what the run is that lies there.
        wanted: what was asked for.
        where: for the error.
        recipes: documents of both recipes: where they differ, their keys are named.
        fix: for the error.

    Raises:
        TrainingError: it is so; says what differs.
    """
    differing = []
    for key in sorted({*found, *wanted}):
        if found.get(key) != wanted.get(key):
            inner = _differences(*recipes) if key == "recipe" else []
            differing += inner or [f"{key} {_short(found.get(key))} -> {_short(wanted.get(key))}"]
    if differing:
        raise TrainingError(
            f"another run lies here: {', '.join(differing)[:400]}",
            where=where,
            fix=fix,
        )


def _differences(found: Mapping[str, Any], wanted: Mapping[str, Any], stem: str = "") -> list[str]:
    """Say which keys of two documents differ, and how."""
    differing = []
    for key in sorted({*found, *wanted}):
        one, other = found.get(key), wanted.get(key)
        if isinstance(one, Mapping) and isinstance(other, Mapping):
            differing += _differences(one, other, stem=f"{stem}{key}.")
        elif one != other:
            differing.append(f"{stem}{key} {one!r} -> {other!r}")
    return differing


def _short(value: object) -> str:
    """Return a value as it is shown; of a hash its first digits."""
    is_hash = isinstance(value, str) and len(value) == _HASH_DIGITS
    return f"{str(value)[:12]}..." if is_hash else repr(value)


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
