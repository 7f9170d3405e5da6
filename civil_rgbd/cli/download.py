"""``civil-rgbd download``: an accepted bridge from the registry into a dataset."""

from __future__ import annotations

from pathlib import Path

import click

from civil_rgbd.cli.places import dataset_option, refuse_remote


@click.command("download")
@click.argument("bridge_id", metavar="ID")
@dataset_option("The dataset folder; the bridge goes to bridges/ID in it.")
@click.option(
    "--registry",
    metavar="FILE|URL",
    help="Another list of bridges  [default: the one that ships with this release]",
)
@click.option("--overwrite", is_flag=True, help="Replace a bridge of that id.")
def command(bridge_id: str, *, dataset: Path, registry: str | None, overwrite: bool) -> None:
    """Fetch bridge ID, check it to the last pixel, and put it into a dataset.

    A download that broke off is gone on with by the same command. What is not what the registry
    says, byte by byte, does not get in.
    """
    from civil_rgbd.cli.progress import byte_bar
    from civil_rgbd.contribution.download import download_bridge

    refuse_remote(dataset, option="--out")
    with byte_bar(bridge_id) as on_progress:
        done = download_bridge(
            bridge_id, dataset, registry=registry, overwrite=overwrite, progress=on_progress
        )
    entry = done.entry
    print(f"{entry.id} {entry.version}: {done.report.frames} frames, {entry.licence}")
    print(f"  verified  {entry.sha256}")
    print(f"  lies in   {done.folder}")
