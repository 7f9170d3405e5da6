"""``civil-rgbd validate``: check a dataset or a bridge against the format."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import click


@click.command(name="validate")
@click.argument("location", type=click.Path(path_type=Path))
@click.option(
    "--profile",
    type=click.Choice(["format", "contribution"]),
    default="format",
    show_default=True,
    help="What to ask for: `contribution` is all that a submission needs.",
)
@click.option("--json", "as_json", is_flag=True, help="Print every finding, for machines.")
@click.pass_context
def command(context: click.Context, location: Path, *, profile: str, as_json: bool) -> None:
    """Check LOCATION, a dataset folder or one bridge folder, against the format.

    Exit code 1 when a finding is an error; warnings alone leave it 0.
    """
    from contextlib import redirect_stdout

    from civil_rgbd.cli.progress import frame_bar
    from civil_rgbd.validation import validate

    # OpenEXR prints its own complaints about damaged files, and would print into the JSON.
    with redirect_stdout(sys.stderr), frame_bar("validate") as on_progress:
        report = validate(location, profile=profile, progress=on_progress)
    print(json.dumps(report.to_document(), indent=2) if as_json else report.to_text())
    context.exit(1 if report.errors else 0)
