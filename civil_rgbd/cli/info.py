"""``civil-rgbd info``: what a dataset or a bridge holds."""

from __future__ import annotations

import json
from pathlib import Path

import click


@click.command(name="info")
@click.argument("location", type=click.Path(path_type=Path))
@click.option("--json", "as_json", is_flag=True, help="Print it for machines.")
def command(location: Path, *, as_json: bool) -> None:
    """Say what LOCATION holds: bridges, frames, size, recipe, licence, coverage.

    LOCATION is a dataset folder or one bridge folder. No image is opened: `civil-rgbd validate`
    looks into them.
    """
    from civil_rgbd.format.summary import summarise

    summary = summarise(location)
    print(json.dumps(summary.to_document(), indent=2) if as_json else summary.to_text())
