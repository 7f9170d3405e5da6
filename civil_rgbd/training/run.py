"""A training run in a folder: begun, gone on with after a kill, and finished by its model file."""

from __future__ import annotations

import time
from typing import Any

import torch

from civil_rgbd.baselines.checkpoints import load_weights, save_model, write_tensors
from civil_rgbd.baselines.imagenet import load_encoder_weights
from civil_rgbd.baselines.model import ENTRY_POINT_GROUP, MODEL_FILE, load_model, model_names
from civil_rgbd.baselines.torch_model import TorchDepthModel
from civil_rgbd.errors import TrainingError, UsageError
from civil_rgbd.format.atomic import writing
from civil_rgbd.lineage import lineage_of_weights
from civil_rgbd.training.checkpoint import CHECKPOINT, read_checkpoint
from civil_rgbd.training.frames import TrainingFrames, load_batches
from civil_rgbd.training.identity import (
    refuse_nothing_to_learn,
    run_identity,
    training_bridges,
    warn_of_leakage,
    weights_file,
)
from civil_rgbd.training.job import TrainingJob, TrainingOptions, TrainingReport
from civil_rgbd.training.journal import STEPS, Journal, read_steps
from civil_rgbd.training.loop import TrainingLoop
from civil_rgbd.training.norms import estimate_norms
from civil_rgbd.training.order import TrainingOrder
from civil_rgbd.training.processes import Processes, joined
from civil_rgbd.training.recipe import TrainingRecipe
from civil_rgbd.training.run_folder import delete_run, is_begun, prepare_folder


def train(job: TrainingJob, options: TrainingOptions | None = None) -> TrainingReport:
    """Train a model; a run that was stopped is gone on with, one that is finished is left alone.

    Under ``torchrun`` every process calls this.

    Args:
        job: what to train.
        options: how.

    Raises:
        UsageError: a bridge, frame, model or device is not there, or there is nothing to learn.
        TrainingError: another run lies in the folder, the loss is not finite, or there was no pixel
            to learn from.
        FormatError: a file is damaged.
        OutputError: the folder cannot be written.
        MissingExtraError: a package is missing.
    """
    options = options or TrainingOptions()
    started = time.monotonic()
    bridges = training_bridges(job.data, job.split)
    refuse_nothing_to_learn(bridges, job.split, job.recipe, where=job.data)
    is_new = False
    with joined(options.device) as processes:
        _refuse_uneven(job.recipe, processes)
        identity = run_identity(
            recipe=job.recipe,
            seed=job.seed,
            split=job.split,
            processes=processes.count,
            weights=job.weights,
            bridges=bridges,
        )
        if processes.is_first:
            first = None if job.weights is None else lineage_of_weights(job.weights)
            if first is not None:
                warn_of_leakage(first, job.split)
            is_new = prepare_folder(job, identity, first, overwrite=options.overwrite)
        processes.wait()
        frames = TrainingFrames(job.data, job.split.train, job.recipe, seed=job.seed)
        try:
            found = _train_model(job, options, frames, processes, identity)
        except BaseException:
            if is_new and not is_begun(job.out):
                delete_run(job.out)  # so that the command may take the folder once it is mended
            raise
        order = TrainingOrder(len(frames), job.recipe.run.batch, job.seed)
        return _report(job, order, found=found, seconds=time.monotonic() - started)


def _train_model(
    job: TrainingJob,
    options: TrainingOptions,
    frames: TrainingFrames,
    processes: Processes,
    identity: dict[str, Any],
) -> int | None:
    """Train what is missing; return the steps that were found done, None where all were.

    A function of its own, so that the model is gone when the process leaves.
    """
    if (job.out / MODEL_FILE).is_file():
        return None
    order = TrainingOrder(len(frames), job.recipe.run.batch, job.seed)
    loop = _begun(job, options, frames, order, processes)
    state = read_checkpoint(job.out / CHECKPOINT, identity=identity)
    if state is not None:
        loop.restore(state)
    found = loop.done
    _run(loop, frames, job, options, identity)
    _finish(loop, frames, job, options)
    return found


def _refuse_uneven(recipe: TrainingRecipe, processes: Processes) -> None:
    if recipe.run.batch % processes.count:
        raise UsageError(
            f"a batch of {recipe.run.batch} does not divide among {processes.count} processes",
            where="run.batch",
            fix=f"give a multiple: --set run.batch={processes.count * 4}",
        )


def _begun(
    job: TrainingJob,
    options: TrainingOptions,
    frames: TrainingFrames,
    order: TrainingOrder,
    processes: Processes,
) -> TrainingLoop:
    torch.manual_seed(job.seed)
    if processes.device.type == "cuda":
        torch.backends.cudnn.benchmark = False
        torch.use_deterministic_algorithms(mode=True, warn_only=True)
    recipe = job.recipe
    model = _model(recipe, frames)
    if job.weights is not None:
        load_weights(model, weights_file(job.weights))
    elif recipe.run.pretrained and not (job.out / CHECKPOINT).is_file():
        load_encoder_weights(model.network.encoder, *filter(None, [options.imagenet]))  # type: ignore[arg-type]  # only BTS has such an encoder; its recipe says so
    if recipe.run.freeze_early_layers:
        model.freeze_early_layers()
    frames.crop_to_multiples(model.side_multiple)
    model.to(processes.device)
    torch.manual_seed(job.seed + processes.rank)  # each process has its own random numbers
    return TrainingLoop(model, recipe, order, processes)


def _model(recipe: TrainingRecipe, frames: TrainingFrames) -> TorchDepthModel:
    options = dict(recipe.model_options)
    if recipe.input.width_px and recipe.input.model_resizes:
        height, width = frames.prepared_px
        options = {"height_px": height, "width_px": width} | options
    try:
        model = load_model(recipe.model, **options)
    except UsageError as error:
        if "height_px" in recipe.model_options or "'height_px'" not in error.what:
            raise
        raise UsageError(
            f"the model {recipe.model!r} takes no height_px and width_px, and images are resized",
            where=f"training recipe {recipe.name}",
            fix="let the model take them, or set input.model_resizes = false",
        ) from error
    if not isinstance(model, TorchDepthModel):
        raise UsageError(
            f"the model {recipe.model!r} cannot be trained: it is a {type(model).__name__}",
            where=f"training recipe {recipe.name}",
            fix="derive it from civil_rgbd.baselines.torch_model.TorchDepthModel",
        )
    if model.name not in model_names():
        raise UsageError(
            f"nobody could load the run: its model would be saved as {model.name!r}, and no "
            "installed model has that name",
            where=f"training recipe {recipe.name}",
            fix=f"announce it as the entry point {model.name!r} of the group {ENTRY_POINT_GROUP}; "
            "docs/tutorials/your_model_in_the_table.md shows how",
        )
    return model


def _run(
    loop: TrainingLoop,
    frames: TrainingFrames,
    job: TrainingJob,
    options: TrainingOptions,
    identity: dict[str, Any],
) -> None:
    processes, order = loop.processes, loop.order
    every = job.recipe.run.checkpoint_every or order.steps_of(1)
    places = order.batches(loop.done, loop.steps, rank=processes.rank, processes=processes.count)
    batches = load_batches(frames, places, workers=options.workers)
    journal = (
        Journal(job.out, done=loop.done, board=options.tensorboard) if processes.is_first else None
    )
    try:
        for batch in batches:
            record = loop.step(batch)
            if journal is not None:
                journal.add(record)
                options.on_step(record, loop.steps)
                if record.step == min(order.steps_of(1), loop.steps):
                    _refuse_nothing_learnt(job)
            if record.step % every == 0 or record.step == loop.steps:
                state = loop.state()
                if processes.is_first:
                    write_tensors(job.out / CHECKPOINT, state | {"identity": identity})
    finally:
        if journal is not None:
            journal.close()


def _refuse_nothing_learnt(job: TrainingJob) -> None:
    """Refuse to go on after an epoch without a pixel: the index, asked before, knows ranges only.

    Raises:
        TrainingError: it is so.
    """
    if not any(record.valid_pixels for record in read_steps(job.out)):
        low, high = job.recipe.input.min_depth_m, job.recipe.input.max_depth_m
        raise TrainingError(
            f"nothing was learnt: in a whole epoch no pixel was measured between {low:g} and "
            f"{high:g} m",
            where=job.data,
            fix="look at the depth: `civil-rgbd validate`; or widen input.min_depth_m and "
            "input.max_depth_m",
        )


def _finish(
    loop: TrainingLoop, frames: TrainingFrames, job: TrainingJob, options: TrainingOptions
) -> None:
    """Write the model: averaged weights where there are, statistics estimated once more."""
    processes, count = loop.processes, job.recipe.run.norm_batches
    if loop.average is not None:
        loop.average.put_into(loop.model)
    if count:
        places = loop.order.batches(
            loop.steps, loop.steps + count, rank=processes.rank, processes=processes.count
        )
        batches = load_batches(frames, places, workers=options.workers)
        estimate_norms(loop.model, batches, loop.forward)
    if processes.is_first:
        save_model(loop.model, job.out / MODEL_FILE)
        with writing(job.out):
            (job.out / CHECKPOINT).unlink(missing_ok=True)
    processes.wait()


def _report(
    job: TrainingJob, order: TrainingOrder, *, found: int | None, seconds: float
) -> TrainingReport:
    records = read_steps(job.out)
    if not records:
        raise TrainingError(
            f"the run has a model and no {STEPS}",
            where=job.out,
            fix="give --overwrite to train it again",
        )
    last = records[-1]
    return TrainingReport(
        out=job.out,
        frames=order.frames,
        steps=last.step,
        steps_found=last.step if found is None else found,
        last_loss=last.loss,
        seconds=seconds,
    )
