"""What a training run is: a run of the same identity comes out the same, and need not be redone."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from civil_rgbd.baselines.model import MODEL_FILE
from civil_rgbd.domain.split import Split
from civil_rgbd.errors import UsageError
from civil_rgbd.format.content import frames_sha256
from civil_rgbd.format.hashes import file_sha256
from civil_rgbd.format.layout import bridge_folders
from civil_rgbd.format.reader import Bridge, read_bridge
from civil_rgbd.lineage import Lineage, seen_of
from civil_rgbd.training.recipe import TrainingRecipe


def run_identity(
    *,
    recipe: TrainingRecipe,
    seed: int,
    split: Split,
    processes: int,
    weights: Path | None,
    bridges: Mapping[str, Bridge],
) -> dict[str, Any]:
    """Return all that decides what a run comes to, as JSON values.

    Args:
        recipe: every number.
        seed: of weights, order and random changes.
        split: its ``train`` is trained with.
        processes: that share each batch.
        weights: a run or file whose weights come first; None for the recipe's.
        bridges: by id, those of the training frames: images and depth enter as their index says.

    Raises:
        UsageError: the weights are not there.
    """
    return {
        "recipe": recipe.sha256(),
        "seed": seed,
        "split": split.sha256(),
        "processes": processes,
        "weights": None if weights is None else file_sha256(weights_file(weights)),
        "data": frames_sha256(bridges, {k: v for k, v in split.train.items() if k in bridges}),
    }


def weights_file(weights: Path) -> Path:
    """Return the file of the weights that a run starts from.

    Args:
        weights: a run folder or a file.

    Raises:
        UsageError: it is not there.
    """
    file = weights / MODEL_FILE if weights.is_dir() else weights
    if not file.is_file():
        raise UsageError("there are no weights", where=file, fix="check the path of --from")
    return file


def warn_of_leakage(first: Lineage, split: Split) -> None:
    """Warn when first weights have seen frames that are scored now, or nobody knows what they saw.

    Args:
        first: what the weights were trained with, by their run and by those before it.
        split: of the run that starts from them.
    """
    seen = seen_of(first, split.scored())
    if seen.scored:
        warnings.warn(
            f"{first.name} was trained with {seen.scored} frames that are scored of this run: its "
            "weights have seen them, and results of this run will say so",
            stacklevel=3,
        )
    if seen.unknown:
        warnings.warn(
            f"nobody wrote down which frames {', '.join(seen.unknown)} was trained with: results "
            "of this run will say so",
            stacklevel=3,
        )


def training_bridges(data: Path, split: Split) -> dict[str, Bridge]:
    """Read the documents of the bridges that train; those that are not there are left out."""
    bridges = [read_bridge(folder) for folder in bridge_folders(data).values()]
    found = {bridge.manifest.info.bridge_id: bridge for bridge in bridges}
    return {name: found[name] for name in split.train if name in found}


def refuse_nothing_to_learn(
    bridges: Mapping[str, Bridge], split: Split, recipe: TrainingRecipe, *, where: object
) -> None:
    """Refuse a training set without one measured pixel in range: the index knows without images.

    Raises:
        UsageError: it is so.
    """
    low, high = recipe.input.min_depth_m, recipe.input.max_depth_m
    wanted = {name: set(ids) for name, ids in split.train.items()}
    rows = [
        row
        for name, bridge in bridges.items()
        for row in bridge.rows
        if row.frame_id in wanted[name]
    ]
    if not any(r.valid_share > 0 and r.depth_min_m < high and r.depth_max_m > low for r in rows):
        raise UsageError(
            f"there is nothing to learn: none of {len(rows)} training frames has a measured pixel "
            f"between {low:g} and {high:g} m",
            where=where,
            fix="choose other bridges, or widen input.min_depth_m and input.max_depth_m",
        )
