"""``civil-rgbd benchmark``: the paper's experiment, as a table and a page."""

from __future__ import annotations

from pathlib import Path

import click


@click.command("benchmark")
@click.option(
    "--data",
    required=True,
    type=click.Path(path_type=Path),
    metavar="FOLDER",
    help="A dataset of several bridges.",
)
@click.option("--test-bridge", required=True, metavar="ID", help="Leave it out of training.")
@click.option(
    "--models",
    required=True,
    metavar="A,B",
    help="Training recipes (bts, zoe, bts-small, zoe-small, FILE.toml), trained for each cell; "
    "anything else that load_model takes is scored as it is.",
)
@click.option("--shots", default="0,10,20,30", show_default=True, metavar="K,...")
@click.option("--seeds", type=int, default=3, show_default=True, help="How many, from 0.")
@click.option("--draw", type=int, metavar="N", help="As of `train`.")
@click.option(
    "--out",
    required=True,
    type=click.Path(path_type=Path),
    metavar="FOLDER",
    help="Give the command again to go on: finished cells are kept while data and model are "
    "the same.",
)
@click.option("--jobs", type=int, default=1, show_default=True, help="Runs at a time.")
@click.option("--set", "settings", multiple=True, metavar="STAGE.KEY=VALUE", help="As of `train`.")
@click.option("--min-depth", "min_depth_m", type=float, metavar="M", help="[default: 0.001]")
@click.option("--max-depth", "max_depth_m", type=float, metavar="M", help="[default: 80]")
@click.option("--flip", is_flag=True, help="Average with the prediction of the mirrored image.")
@click.option("--device", default="auto", show_default=True, help="cpu, cuda, mps.")
@click.option("--no-tensorboard", is_flag=True, help="Write steps.csv only.")
def command(
    data: Path,
    *,
    test_bridge: str,
    models: str,
    shots: str,
    seeds: int,
    draw: int | None,
    out: Path,
    jobs: int,
    settings: tuple[str, ...],
    min_depth_m: float | None,
    max_depth_m: float | None,
    flip: bool,
    device: str,
    no_tensorboard: bool,
) -> int:
    """Leave one bridge out, train with 0 and more of its frames, and tabulate the errors.

    Exit code 1 says that a cell could not be trained or scored: the table marks it with its cause,
    and the same command takes up only that.
    """
    from civil_rgbd.cli.progress import cell_bar
    from civil_rgbd.cli.scoring_rules import rules_from
    from civil_rgbd.cli.torch_needed import require_torch
    from civil_rgbd.errors import UsageError

    require_torch("benchmark")
    from civil_rgbd.benchmark.cells import CellFailure
    from civil_rgbd.benchmark.charts import require_matplotlib
    from civil_rgbd.benchmark.run import BenchmarkJob, BenchmarkOptions, run_benchmark
    from civil_rgbd.benchmark.table_files import table_markdown

    require_matplotlib()  # now, not after hours of training
    try:
        counts = tuple(int(word) for word in shots.split(","))
    except ValueError as error:
        raise UsageError(
            f"{shots!r} is not numbers with commas between",
            where="--shots",
            fix="for example --shots 0,10,20,30",
        ) from error
    job = BenchmarkJob(
        data=data,
        test_bridge=test_bridge,
        models=tuple(name for name in models.split(",") if name),
        out=out,
        shots=counts,
        seeds=seeds,
        draw=draw,
        settings=settings,
        rules=rules_from(min_depth_m, max_depth_m),
        flip=flip,
    )
    with cell_bar("benchmark") as on_cell:
        options = BenchmarkOptions(
            jobs=jobs,
            device=device,
            tensorboard=not no_tensorboard,
            on_cell=lambda cell, total: on_cell(
                f"{cell.model}, seed {cell.seed}, {cell.shots} shots"
                + ": failed" * isinstance(cell, CellFailure),
                total,
            ),
        )
        rows = run_benchmark(job, options)
    print(table_markdown(rows, test_bridge))
    print(f"{out}: index.html, table2.md, table2.csv, table2.tex, benchmark.json")
    return 1 if any(row.failed for row in rows) else 0
