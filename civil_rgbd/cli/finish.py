"""``civil-rgbd finish``: join what the jobs of an array have made."""

from __future__ import annotations

import json
from pathlib import Path

import click


@click.command("finish")
@click.argument("dataset", type=click.Path(path_type=Path))
@click.option(
    "--bridge",
    "bridge_ids",
    multiple=True,
    metavar="ID",
    help="Only this bridge; may be given again  [default: all that are begun]",
)
@click.option("--overwrite", is_flag=True, help="Replace a bridge that was made otherwise.")
@click.option("--json", "as_json", is_flag=True, help="Print the report as JSON.")
@click.pass_context
def command(
    context: click.Context,
    dataset: Path,
    *,
    bridge_ids: tuple[str, ...],
    overwrite: bool,
    as_json: bool,
) -> None:
    """Publish the bridges of DATASET whose parts were made by `civil-rgbd build --chunk I/N`.

    Every file is proved first. On a disk it is read back and compared with its hash; on object
    storage size and ETag of every object are compared with what its upload was answered with, and
    those that differ are read and hashed. No recording is needed. Exit code 1 when parts are
    missing or damaged: they are named, and nothing of their bridge appears. Killed or run twice, it
    finds what is whole already.
    """
    from civil_rgbd.builder.finish import finish_bridges

    report = finish_bridges(dataset, bridge_ids, overwrite=overwrite)
    print(json.dumps(report.to_document(), indent=2) if as_json else report.to_text())
    context.exit(1 if report.failed else 0)
