"""``civil-rgbd pack``: a bridge as one archive, with checksums and a report."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from civil_rgbd.validation.report import Report


@click.command("pack")
@click.argument("location", type=click.Path(path_type=Path))
@click.option("--bridge", "bridge_id", metavar="ID", help="Which bridge, where there are several.")
@click.option(
    "--out",
    "archive",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="The archive  [default: ID-VERSION.tar in the working folder]",
)
@click.pass_context
def command(
    context: click.Context, location: Path, *, bridge_id: str | None, archive: Path | None
) -> None:
    """Pack a bridge of LOCATION, a dataset folder or one bridge folder, for submission.

    Writes the archive, its checksums (FILE.sha256) and a report (FILE with .html). The same folder
    gives the same bytes. Exit code 1, and nothing written, when the folder breaks the format or the
    contribution profile is not met: the errors are listed.
    """
    from contextlib import redirect_stdout

    from civil_rgbd.cli.progress import frame_bar
    from civil_rgbd.contribution.pack import bridge_to_pack, default_archive, pack_bridge
    from civil_rgbd.contribution.registry import entry_text
    from civil_rgbd.validation import validate

    folder = bridge_to_pack(location, bridge_id)
    with redirect_stdout(sys.stderr), frame_bar("validate") as on_progress:
        report = validate(folder, profile="contribution", progress=on_progress)
    if report.errors:
        print(report.to_text())
        print(f"not packed: {_why_not(report)}")
        context.exit(1)
    packed = pack_bridge(folder, archive or default_archive(folder), report)
    print(report.to_text())
    print(f"archive   {packed.archive.path} ({packed.archive.size_bytes:,} bytes)")
    print(f"sums      {packed.sums}")
    print(f"report    {packed.page}")
    print("for the registry, once the archive has an address:")
    print(entry_text(packed.entry), end="")


def _why_not(report: Report) -> str:
    """Say whether the folder itself is at fault, or what people have to state of it."""
    codes = [finding.code for finding in report.findings if finding.level == "error"]
    broken = list(dict.fromkeys(code for code in codes if not code.startswith("contribution-")))
    why = ["the contribution profile is not met"] if len(broken) < len(set(codes)) else []
    if broken:
        why.insert(0, f"the folder is damaged or was changed by hand ({', '.join(broken)})")
    return "; ".join(why)
