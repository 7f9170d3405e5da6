"""What a user named becomes a model and a set of frames."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from civil_rgbd.baselines.model import MODEL_FILE, DepthModel, StoredDepth, load_model
from civil_rgbd.domain.split import Split
from civil_rgbd.errors import UsageError
from civil_rgbd.evaluation.frames import all_frames, open_bridges
from civil_rgbd.format.split_files import read_split
from civil_rgbd.lineage import SPLIT_FILE, Lineage, lineage_of, split_of_run

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
    own = split_of_run(named)
    if split_file is not None:
        chosen = read_split(split_file)
    elif own is not None and not bridges:
        chosen = own
    else:
        chosen = Split(train={}, tests={"all": all_frames(open_bridges(data, bridges))})
    _warn_of_leakage(lineage_of(named), chosen)
    return chosen


def _warn_of_leakage(lineage: Lineage | None, chosen: Split) -> None:
    if lineage is None:
        return
    leaked = {
        bridge: len(set(ids).intersection(lineage.trained_with.get(bridge, ())))
        for bridge, ids in chosen.scored().items()
    }
    counts = [f"{count} of bridge {bridge}" for bridge, count in leaked.items() if count]
    if counts:
        warnings.warn(
            "the run, or one that its first weights are of, was trained with frames that are "
            f"scored here: {', '.join(counts)}",
            stacklevel=3,
        )
    if lineage.unknown:
        warnings.warn(
            f"it is not known which frames {', '.join(lineage.unknown)} was trained with, from "
            "whose weights the run, or one before it, started",
            stacklevel=3,
        )
