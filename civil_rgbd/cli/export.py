"""``civil-rgbd export``: bridges out, in the layouts that other programs read."""

from __future__ import annotations

import json
from pathlib import Path

import click

from civil_rgbd.cli.places import refuse_remote


@click.command("export")
@click.argument("location", type=click.Path(path_type=Path))
@click.option(
    "--to",
    "exporter",
    required=True,
    metavar="NAME",
    help="colmap, kitti, las, nerfstudio, ply or tum.",
)
@click.option(
    "--out",
    "folder",
    required=True,
    type=click.Path(path_type=Path),
    metavar="FOLDER",
    help="What to make; it appears when it is whole.",
)
@click.option(
    "--bridge",
    "bridges",
    multiple=True,
    metavar="ID",
    help="Only this bridge; may be given again.",
)
@click.option("--split", metavar="NAME", help="Only the frames of this split.")
@click.option(
    "--depth-scale",
    type=click.FloatRange(min=0, min_open=True),
    metavar="UNITS",
    help="Stored depth units a metre, for tum  [default: 5000, up to 13.1 m]",
)
@click.option(
    "--voxel-m",
    type=click.FloatRange(min=0, min_open=True),
    metavar="METRES",
    help="For ply, las, colmap: one point for each cube of this edge.",
)
@click.option("--overwrite", is_flag=True, help="Replace an older export.")
@click.option("--json", "as_json", is_flag=True, help="Print the report as JSON.")
def command(
    location: Path,
    *,
    exporter: str,
    folder: Path,
    bridges: tuple[str, ...],
    split: str | None,
    depth_scale: float | None,
    voxel_m: float | None,
    overwrite: bool,
    as_json: bool,
) -> None:
    """Write the bridges of LOCATION, a dataset or one bridge, in another layout.

    What the other layout has no place for is printed.
    """
    from civil_rgbd.cli.progress import frame_bar
    from civil_rgbd.exporters.registry import export, require_exporter
    from civil_rgbd.exporters.report import ExportOptions
    from civil_rgbd.exporters.selection import choose

    require_exporter(exporter)
    refuse_remote(folder, option="--out")
    chosen, splits = choose(location, bridges=bridges, split=split)
    total = sum(len(one.rows) for one in chosen)
    with frame_bar(exporter) as on_progress:
        options = ExportOptions(
            depth_scale=depth_scale,
            voxel_m=voxel_m,
            splits=splits,
            on_frame=lambda: on_progress(1, total),
        )
        report = export(chosen, exporter, folder, options, overwrite=overwrite)
    print(json.dumps(report.to_document(), indent=2) if as_json else report.to_text())
