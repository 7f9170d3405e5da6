"""``civil-rgbd convert``: an already rendered set in, a bridge folder out."""

from __future__ import annotations

import json
from pathlib import Path

import click

from civil_rgbd.cli.bridge_info import options_of_bridge, read_bridge_info
from civil_rgbd.cli.places import refuse_remote


@click.command("convert")
@click.argument("source", type=click.Path(path_type=Path))
@click.option(
    "--from",
    "importer",
    required=True,
    metavar="NAME",
    help="bridge-rgbd, icl, kitti-depth, lab, redwood, scannet or tum.",
)
@click.option(
    "--bridge", "bridge_id", metavar="ID", help="The bridge's id  [default: the folder's name]"
)
@options_of_bridge
@click.option(
    "--depth-scale",
    type=click.FloatRange(min=0, min_open=True),
    metavar="UNITS",
    help="Stored depth units a metre  [default: what the poses prove, else the layout's]",
)
@click.option(
    "--depth-along",
    type=click.Choice(["z", "ray"]),
    default="z",
    show_default=True,
    help="The set's depth is along the optical axis, or along each pixel's ray.",
)
@click.option(
    "--poses",
    type=click.Path(path_type=Path, exists=True),
    metavar="FILE",
    help="The poses of the images, where they are not found.",
)
@click.option(
    "--direction",
    type=click.Choice(["camera-to-map", "map-to-camera"]),
    default="camera-to-map",
    show_default=True,
    help="What the poses do to a point.",
)
@click.option("--intrinsics", metavar="FILE|FX,FY,CX,CY", help="The camera, where it is not found.")
@click.option(
    "--stamps",
    type=click.Path(path_type=Path, exists=True),
    metavar="FILE",
    help="The images' time stamps, where they are not found.",
)
@click.option(
    "--lens",
    type=click.Choice(["undistort", "ignore"]),
    help="Take the lens distortion out of images and depth, or it is out already.",
)
@click.option(
    "--codec",
    type=click.Choice(["png", "jpeg"]),
    default="png",
    show_default=True,
    help="Of the stored images: png keeps their pixels, jpeg (quality 95) is smaller.",
)
@click.option("--overwrite", is_flag=True, help="Replace a bridge of the same id.")
@click.option("--json", "as_json", is_flag=True, help="Print the report as JSON.")
def command(
    source: Path,
    *,
    importer: str,
    bridge_id: str | None,
    dataset: Path,
    bridge_info: Path | None,
    licence: str | None,
    codec: str,
    overwrite: bool,
    as_json: bool,
    **import_options: object,
) -> None:
    """Take over SOURCE, a folder of images and depth that others rendered, as a bridge.

    The manifest says that the depth was imported. Scale and direction are checked by carrying the
    depth of one frame into others by the poses.
    """
    from civil_rgbd.builder.bridge import require_free_id
    from civil_rgbd.builder.provenance import software
    from civil_rgbd.cli.progress import frame_bar
    from civil_rgbd.domain.bridge import BridgeInfo
    from civil_rgbd.importers.convert import ConvertOptions, convert_set
    from civil_rgbd.importers.registry import open_rendered_set
    from civil_rgbd.importers.rendered_set import ImportOptions

    refuse_remote(dataset, option="--out")
    bridge_id = bridge_id or source.resolve().name
    require_free_id(dataset, bridge_id)
    info = read_bridge_info(bridge_info, licence=licence, otherwise=BridgeInfo(bridge_id))
    options = ImportOptions(**import_options)  # type: ignore[arg-type]  # click hands them over by name
    opened = open_rendered_set(source, importer, options)
    with frame_bar(bridge_id) as on_progress:
        report = convert_set(
            opened,
            dataset,
            info,
            options,
            ConvertOptions(
                software=software(), codec=codec, overwrite=overwrite, on_progress=on_progress
            ),
        )
    print(json.dumps(report.to_document(), indent=2) if as_json else report.to_text())
