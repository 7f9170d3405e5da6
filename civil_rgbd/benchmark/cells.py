"""One cell of the table: a model, a seed, a number of shots; trained, scored, kept."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch

from civil_rgbd.baselines.devices import on_device
from civil_rgbd.baselines.identity import model_sha256
from civil_rgbd.baselines.model import DepthModel, StoredDepth, load_model
from civil_rgbd.benchmark.protocol import ShotRequest, draw_split
from civil_rgbd.domain.split import Split
from civil_rgbd.errors import CivilRgbdError
from civil_rgbd.evaluation.frames import open_bridges
from civil_rgbd.evaluation.metrics import MetricRules
from civil_rgbd.evaluation.results import RESULTS, Scored, write_results
from civil_rgbd.evaluation.run import EvaluationOptions, evaluate
from civil_rgbd.format.atomic import writing
from civil_rgbd.format.content import frames_sha256
from civil_rgbd.format.documents import read_document
from civil_rgbd.format.split_files import write_split
from civil_rgbd.lineage import RUN_FILE, SPLIT_FILE, Seen, lineage_of, seen_of
from civil_rgbd.training.checkpoint import refuse_other_run
from civil_rgbd.training.identity import run_identity, training_bridges
from civil_rgbd.training.job import TrainingJob, TrainingOptions
from civil_rgbd.training.recipe_files import load_training_recipe, training_recipe_texts
from civil_rgbd.training.run import train


@dataclass(frozen=True, slots=True)
class Cell:
    """What to train and score; sent to worker processes.

    Attributes:
        data: a dataset folder.
        out: the benchmark's folder.
        model: a training recipe (by name or ``.toml``), or anything that ``load_model`` takes:
            that is scored as it is.
        request: test bridge, shots, seed, draw.
        settings: changes of the recipe.
        device: to train and to score on.
        threads: of torch; 0 leaves them alone.
        rules: which pixels count.
        flip: average predictions over flips.
        tensorboard: write for TensorBoard.
    """

    data: Path
    out: Path
    model: str
    request: ShotRequest
    settings: tuple[str, ...] = ()
    device: str = "auto"
    threads: int = 0
    rules: MetricRules = field(default_factory=MetricRules)
    flip: bool = False
    tensorboard: bool = True

    @property
    def name(self) -> str:
        """What tables call the model."""
        return Path(self.model).stem if self.model.endswith(".toml") else self.model

    @property
    def folder(self) -> Path:
        """Where the cell's run and results lie."""
        model = re.sub(r"[^A-Za-z0-9._-]+", "-", self.name).strip("-")
        request = self.request
        return self.out / "cells" / model / f"seed-{request.seed}" / f"shots-{request.shots}"


@dataclass(frozen=True, slots=True)
class CellResult:
    """What came out of a cell.

    Attributes:
        model: what tables call it.
        seed: of the draw and the training.
        shots: frames of the test bridge that trained.
        folder: where run and results lie.
        results: the document of ``results.json``.
        seen: what a run of the user's own, or one that its first weights are of, has seen of the
            test bridge; nothing for what is trained here.
    """

    model: str
    seed: int
    shots: int
    folder: Path
    results: dict[str, Any]
    seen: Seen = field(default_factory=Seen)


@dataclass(frozen=True, slots=True)
class CellFailure:
    """A cell that could not be trained or scored.

    Attributes:
        model: what tables call it.
        seed: of the draw and the training.
        shots: frames of the test bridge that trained.
        folder: where run and results lie.
        what: went wrong.
        where: it did.
        fix: what to do about it.
    """

    model: str
    seed: int
    shots: int
    folder: Path
    what: str
    where: str
    fix: str


Outcome = CellResult | CellFailure
"""Of a cell."""


def failure_of(cell: Cell, error: Exception) -> CellFailure:
    """Say which cell failed, and why."""
    if isinstance(error, CivilRgbdError):
        told = (error.what, error.where, error.fix)
    else:
        fix = "its trace has been logged; give the command again when it is mended"
        told = (f"{type(error).__name__}: {error}", str(cell.folder), fix)
    return CellFailure(cell.name, cell.request.seed, cell.request.shots, cell.folder, *told)


def is_trained(model: str) -> bool:
    """Tell whether a model is named by a training recipe, and is trained for each cell.

    >>> is_trained("bts-small"), is_trained("predictions:folder")
    (True, False)
    """
    return model.endswith(".toml") or model in training_recipe_texts()


def split_of(cell: Cell) -> Split:
    """Draw the cell's split.

    Raises:
        UsageError: the data does not have what it takes.
    """
    return draw_split(open_bridges(cell.data), cell.request, where=cell.data)


def model_of(cell: Cell) -> DepthModel | StoredDepth:
    """Load the model of a cell that is done.

    Raises:
        UsageError: there is none.
    """
    return on_device(load_model(_location_of(cell)), cell.device)


def seen_frames(cell: Cell, split: Split) -> Seen:
    """Return what a model has seen of the test bridge that is not trained here.

    Raises:
        FormatError: a document of the model's run is damaged.
    """
    if is_trained(cell.model):
        return Seen()
    return seen_of(lineage_of(cell.model), split.scored())


def refuse_other_cell(cell: Cell) -> None:
    """Refuse to train a cell where another run lies.

    Raises:
        TrainingError: it is so; says what differs.
        FormatError: its document is damaged.
    """
    path = cell.folder / RUN_FILE
    if not is_trained(cell.model) or not path.is_file():
        return
    split = split_of(cell)
    recipe = load_training_recipe(cell.model, cell.settings)
    found = read_document(path)
    identity = run_identity(
        recipe=recipe,
        seed=cell.request.seed,
        split=split,
        processes=1,
        weights=None,
        bridges=training_bridges(cell.data, split),
    )
    recipes = found.get("recipe", {}), recipe.to_document()
    refuse_other_run(
        found.get("identity", {}),
        identity,
        where=cell.folder,
        recipes=recipes,
        fix="give another --out; or delete this folder, and its cell is trained anew",
    )


def _location_of(cell: Cell) -> str | Path:
    return cell.folder if is_trained(cell.model) else cell.model


def run_cell(cell: Cell) -> CellResult:
    """Train and score a cell; what is done already is kept.

    Raises:
        CivilRgbdError: as :func:`civil_rgbd.training.run.train` and
            :func:`civil_rgbd.evaluation.run.evaluate`.
    """
    if cell.threads:
        torch.set_num_threads(cell.threads)
    split = split_of(cell)
    if is_trained(cell.model):
        recipe = load_training_recipe(cell.model, cell.settings)
        job = TrainingJob(cell.data, split, recipe, cell.folder, seed=cell.request.seed)
        train(job, TrainingOptions(device=cell.device, tensorboard=cell.tensorboard))
    else:
        with writing(cell.folder):
            cell.folder.mkdir(parents=True, exist_ok=True)
        write_split(cell.folder / SPLIT_FILE, split)
    request, seen = cell.request, seen_frames(cell, split)
    document = _results(cell, split)
    return CellResult(cell.name, request.seed, request.shots, cell.folder, document, seen)


def _results(cell: Cell, split: Split) -> dict[str, Any]:
    """Score a cell, unless its results are there already."""
    model = model_of(cell)
    model_hash = model_sha256(model, _location_of(cell))
    frames = split.scored()
    data_hash = frames_sha256(open_bridges(cell.data, frames), frames, opened=True)
    known = _known_results(cell, split, (model_hash, data_hash))
    if known is not None:
        return known
    options = EvaluationOptions(rules=cell.rules, flip=cell.flip)
    scored = Scored(
        model=cell.name,
        data=cell.data.resolve().name,
        model_sha256=model_hash,
        data_sha256=data_hash,
        location=_location_of(cell),
    )
    return write_results(cell.folder, evaluate(model, cell.data, split, options), scored)


def _known_results(
    cell: Cell, split: Split, hashes: tuple[str | None, str]
) -> dict[str, Any] | None:
    """Return the results that are there, unless they are of another model, other data or rules."""
    path = cell.folder / RESULTS
    if hashes[0] is None or not path.is_file():
        return None
    document: dict[str, Any] = json.loads(path.read_text("utf-8"))
    if "seen" not in document:  # of an earlier release
        return None
    if (document.get("model_sha256"), document.get("data_sha256")) != hashes:
        return None
    rules = document["rules"]
    same_rules = all(
        rules[name] == getattr(cell.rules, name) for name in MetricRules.__dataclass_fields__
    )
    same = document["split"]["sha256"] == split.sha256() and rules["flip_averaged"] == cell.flip
    return document if same and same_rules else None
