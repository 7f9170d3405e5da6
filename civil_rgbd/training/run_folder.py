"""The folder of a training run: begun, held against the run that lies there, and emptied."""

from __future__ import annotations

import shutil
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

import torch

from civil_rgbd.baselines.model import MODEL_FILE
from civil_rgbd.format.atomic import writing
from civil_rgbd.format.documents import document_text, read_document, write_text
from civil_rgbd.format.split_files import write_split
from civil_rgbd.lineage import FIRST_WEIGHTS, RUN_FILE, SPLIT_FILE, Lineage
from civil_rgbd.training.checkpoint import CHECKPOINT, refuse_other_run
from civil_rgbd.training.job import TrainingJob
from civil_rgbd.training.journal import BOARD, STEPS, read_steps

_OWN_FILES: Final = (MODEL_FILE, CHECKPOINT, STEPS, SPLIT_FILE, RUN_FILE)


def prepare_folder(
    job: TrainingJob, identity: dict[str, Any], first: Lineage | None, *, overwrite: bool
) -> bool:
    """Write what the run is, or hold it against what lies there.

    Args:
        job: what to train; its folder is made if need be.
        identity: all that decides what the run comes to.
        first: what the first weights have seen; None without such weights.
        overwrite: delete the run that lies there, whichever it is.

    Returns:
        whether the run is a new one.

    Raises:
        TrainingError: another run lies in the folder.
        FormatError: the document of the run that lies there is damaged.
        OutputError: the folder cannot be written.
    """
    path = job.out / RUN_FILE
    with writing(job.out):
        job.out.mkdir(parents=True, exist_ok=True)
    if overwrite:
        delete_run(job.out)
    if path.is_file():
        found = read_document(path)
        recipes = found.get("recipe", {}), job.recipe.to_document()
        refuse_other_run(found["identity"], identity, where=job.out, recipes=recipes)
        return False
    write_split(job.out / SPLIT_FILE, job.split)
    document = {
        "civil_rgbd_run": 1,
        "identity": identity,
        "data": job.data.resolve().name,
        "recipe": job.recipe.to_document(),
        FIRST_WEIGHTS: None if first is None else first.to_document(),
        "software": {"civil_rgbd": version("civil-rgbd"), "torch": str(torch.__version__)},
    }
    write_text(path, document_text(document))
    return True


def is_begun(out: Path) -> bool:
    """Tell whether the run in a folder has anything to lose: a step, a checkpoint, a model."""
    return any((out / name).exists() for name in (MODEL_FILE, CHECKPOINT)) or bool(read_steps(out))


def delete_run(out: Path) -> None:
    """Delete the files of a run, and nothing else that lies in its folder.

    Raises:
        OutputError: the system refuses.
    """
    with writing(out):
        for name in _OWN_FILES:
            (out / name).unlink(missing_ok=True)
        shutil.rmtree(out / BOARD, ignore_errors=True)
