"""``civil-rgbd evaluate``: score a trained model, or predictions on disk."""

from __future__ import annotations

from pathlib import Path

import click


@click.command("evaluate")
@click.argument("model", metavar="RUN_OR_PREDICTIONS")
@click.option(
    "--data",
    required=True,
    type=click.Path(path_type=Path),
    metavar="FOLDER",
    help="A dataset, or one bridge.",
)
@click.option(
    "--split",
    "split_file",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Score the test frames of this split  [default: those of the run, else all frames]",
)
@click.option("--bridge", "bridges", multiple=True, metavar="ID", help="All frames of this bridge.")
@click.option("--min-depth", "min_depth_m", type=float, metavar="M", help="[default: 0.001]")
@click.option("--max-depth", "max_depth_m", type=float, metavar="M", help="[default: 80]")
@click.option("--flip", is_flag=True, help="Average with the prediction of the mirrored image.")
@click.option(
    "--median-scaling",
    is_flag=True,
    help="Scale predictions by the truth's median; the metrics' names say so.",
)
@click.option("--device", default="auto", show_default=True, help="cpu, cuda, mps.")
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    metavar="FOLDER",
    help="Where results go  [default: RUN/results, else ./results]",
)
def command(
    model: str,
    *,
    data: Path,
    split_file: Path | None,
    bridges: tuple[str, ...],
    min_depth_m: float | None,
    max_depth_m: float | None,
    flip: bool,
    median_scaling: bool,
    device: str,
    out: Path | None,
) -> None:
    """Score a model on measured depth, and write results as JSON, CSV and Markdown.

    RUN_OR_PREDICTIONS is a run folder of `train` (or its model.pt), a folder of predictions
    (BRIDGE/FRAME.exr, or 16-bit .png), or any model that `load_model` takes.
    """
    from civil_rgbd.baselines.devices import on_device
    from civil_rgbd.baselines.identity import model_sha256, run_folder_of
    from civil_rgbd.baselines.model import MODEL_FILE
    from civil_rgbd.cli.progress import frame_bar
    from civil_rgbd.cli.scoring_rules import rules_from
    from civil_rgbd.evaluation.choice import choose_model, choose_split
    from civil_rgbd.evaluation.frames import open_bridges
    from civil_rgbd.evaluation.results import Scored, results_markdown, write_results
    from civil_rgbd.evaluation.run import EvaluationOptions, evaluate
    from civil_rgbd.format.content import frames_sha256

    rules = rules_from(min_depth_m, max_depth_m, median_scaling=median_scaling)
    chosen = on_device(choose_model(model), device)
    if not getattr(chosen, "is_trained", True):
        click.echo(f"warning: {model} has random weights: its scores say nothing", err=True)
    split = choose_split(model, data, split_file=split_file, bridges=bridges)
    with frame_bar("evaluate") as on_progress:
        options = EvaluationOptions(rules=rules, flip=flip, on_progress=on_progress)
        evaluation = evaluate(chosen, data, split, options)
    run = run_folder_of(model)
    is_run = run is not None and (run / MODEL_FILE).is_file()
    folder = out or (run / "results" if run is not None and is_run else Path("results"))
    scored = Scored(
        model=run.resolve().name if run is not None and is_run else Path(model).name,
        data=data.resolve().name,
        model_sha256=model_sha256(chosen, model),
        data_sha256=frames_sha256(open_bridges(data, split.scored()), split.scored()),
        location=model,
    )
    document = write_results(folder, evaluation, scored)
    print(results_markdown(document))
    print(f"{folder}: results.json, results.csv, results.md, frames.csv")
