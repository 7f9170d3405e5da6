"""What a user named becomes a model and a set of frames."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from civil_rgbd.baselines.identity import run_folder_of
from civil_rgbd.baselines.model import MODEL_FILE, DepthModel, StoredDepth, load_model
from civil_rgbd.domain.split import Split
from civil_rgbd.errors import UsageError
from civil_rgbd.evaluation.frames import all_frames, open_bridges
from civil_rgbd.format.split_files import read_split

SPLIT_FILE: Final = "split.json"
"""The split that a run was trained with, in its folder."""

_STORED: Final = "predictions:"


def choose_model(named: str) -> DepthModel | StoredDepth:
    """Load a run, or any model by its name; a folder that is no run holds predictions.

    Raises:
        UsageError: there is no such model.
        FormatError: its file does not hold one.
        MissingExtraError: it needs a package that is not installed.
    """
    folder = Path(named)
    if folder.is_dir() and not (folder / MODEL_FILE).is_file():
        if (folder / SPLIT_FILE).is_file():
            raise UsageError(
                f"the run is not finished: it has no {MODEL_FILE} yet",
                where=folder,
                fix="give the `train` command again: it goes on where it was stopped",
            )
        return load_model(_STORED + named)
    return load_model(named)


def choose_split(
    named: str, data: Path, *, split_file: Path | None = None, bridges: Sequence[str] = ()
) -> Split:
    """Choose the frames to score: of a file, of bridges, of the run's own split, else all.

    Args:
        named: what the user named as the model: a run, by its folder or its ``model.pt``, or
            anything else.
        data: a dataset folder or one bridge folder.
        split_file: of a split.
        bridges: ids; all of their frames.

    Raises:
        UsageError: both a file and bridges are given, or a bridge is not there.
        FormatError: the split file is damaged.
    """
    if split_file is not None and bridges:
        raise UsageError(
            "a split and bridges are given: the split says which frames of which bridges",
            where="--split, --bridge",
            fix="give one of them",
        )
    own = own_split(named)
    if split_file is not None:
        chosen = read_split(split_file)
    elif own is not None and not bridges:
        return own
    else:
        chosen = Split(train={}, tests={"all": all_frames(open_bridges(data, bridges))})
    if own is not None:
        _warn_of_leakage(own, chosen)
    return chosen


def own_split(named: str) -> Split | None:
    """Return the split that a run was trained with; None for a model that is no run.

    Args:
        named: a run folder or its ``model.pt``, or any other model.

    Raises:
        FormatError: the split file is damaged.
    """
    folder = run_folder_of(named)
    if folder is None or not (folder / SPLIT_FILE).is_file():
        return None
    return read_split(folder / SPLIT_FILE)


def _warn_of_leakage(own: Split, chosen: Split) -> None:
    leaked = {
        bridge: len(set(ids).intersection(own.train.get(bridge, ())))
        for bridge, ids in chosen.scored().items()
    }
    counts = [f"{count} of bridge {bridge}" for bridge, count in leaked.items() if count]
    if counts:
        warnings.warn(
            f"the run was trained with frames that are scored here: {', '.join(counts)}",
            stacklevel=3,
        )
