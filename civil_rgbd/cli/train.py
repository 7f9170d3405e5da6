"""``civil-rgbd train``: a depth model, on all bridges but one, with some frames of that one."""

from __future__ import annotations

import os
from pathlib import Path

import click


@click.command("train")
@click.argument("recipe")
@click.option(
    "--data",
    required=True,
    type=click.Path(path_type=Path),
    metavar="FOLDER",
    help="A dataset of several bridges.",
)
@click.option("--test-bridge", metavar="ID", help="Leave this bridge out of training.")
@click.option("--shots", type=int, metavar="K", help="Frames of it that train.  [default: 0]")
@click.option(
    "--draw",
    type=int,
    metavar="N",
    help="Frames of it that may be shots; the others are scored whatever --shots is  "
    "[default: 30, at least --shots]",
)
@click.option(
    "--split",
    "split_file",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Train with the frames of this split instead of drawing one.",
)
@click.option("--seed", type=int, default=0, show_default=True, help="Of everything random.")
@click.option(
    "--out",
    required=True,
    type=click.Path(path_type=Path),
    metavar="RUN",
    help="The run's folder; a run that was stopped is gone on with.",
)
@click.option(
    "--set", "settings", multiple=True, metavar="STAGE.KEY=VALUE", help="Change a number."
)
@click.option("--from", "weights", type=click.Path(path_type=Path), help="Start with its weights.")
@click.option("--imagenet", type=click.Path(path_type=Path), help="File of ImageNet weights.")
@click.option("--device", default="auto", show_default=True, help="cpu, cuda, mps.")
@click.option("--workers", type=int, default=0, show_default=True, help="Processes that decode.")
@click.option("--threads", type=int, help="Of PyTorch.")
@click.option("--no-tensorboard", is_flag=True, help="Write steps.csv only.")
@click.option("--overwrite", is_flag=True, help="Delete the run in the same folder first.")
def command(
    recipe: str,
    *,
    data: Path,
    test_bridge: str | None,
    shots: int | None,
    draw: int | None,
    split_file: Path | None,
    seed: int,
    out: Path,
    settings: tuple[str, ...],
    weights: Path | None,
    imagenet: Path | None,
    device: str,
    workers: int,
    threads: int | None,
    no_tensorboard: bool,
    overwrite: bool,
) -> None:
    """Train a depth model by RECIPE: bts, bts-small, zoe, zoe-small, or a TOML file.

    For several processes: torchrun --nproc-per-node 4 -m civil_rgbd train RECIPE ...
    """
    from civil_rgbd.benchmark.protocol import DRAW, ShotRequest, split_for
    from civil_rgbd.cli.progress import step_bar
    from civil_rgbd.cli.torch_needed import require_torch
    from civil_rgbd.errors import UsageError

    require_torch("train")
    import torch

    from civil_rgbd.training.job import TrainingJob, TrainingOptions
    from civil_rgbd.training.recipe_files import load_training_recipe
    from civil_rgbd.training.run import train

    if split_file is not None and (shots is not None or draw is not None):
        raise UsageError(
            "a split is given, which says the frames, and a number of them as well",
            where="--split, --shots, --draw",
            fix="leave --shots and --draw out, or give --test-bridge instead of --split",
        )
    wanted = load_training_recipe(recipe, settings)
    request = (
        None
        if test_bridge is None
        else ShotRequest(
            test_bridge, shots or 0, seed, max(DRAW, shots or 0) if draw is None else draw
        )
    )
    split = split_for(data, request, split_file=split_file)
    if threads is not None:
        torch.set_num_threads(threads)
    job = TrainingJob(data, split, wanted, out, seed=seed, weights=weights)
    with step_bar(f"train {wanted.name}") as on_step:
        options = TrainingOptions(
            device=device,
            workers=workers,
            imagenet=imagenet,
            tensorboard=not no_tensorboard,
            overwrite=overwrite,
            on_step=lambda record, steps: on_step(record.step, steps, record.loss),
        )
        report = train(job, options)
    if os.environ.get("RANK", "0") != "0":
        return  # the first process of torchrun speaks for all
    found = f", of which {report.steps_found} were found done" if report.steps_found else ""
    print(
        f"{report.out}: {report.steps} steps{found}, {report.frames} frames, "
        f"last loss {report.last_loss:.3f}, {report.seconds:.0f} s; "
        f"split {split.sha256()[:12]}. Score it: civil-rgbd evaluate {report.out} --data {data}"
    )
