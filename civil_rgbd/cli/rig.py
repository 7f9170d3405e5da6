"""``civil-rgbd rig``: calibrations into rig files, and rig files against recordings."""

from __future__ import annotations

import re
from pathlib import Path

import click


@click.group("rig")
def command() -> None:
    """Import a calibration as a rig file, or check one against a recording."""


@command.command("import")
@click.argument("files", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option(
    "--from",
    "format_name",
    metavar="FORMAT",
    help="r3live, fast-livo2, livox-camera-calib, kalibr, opencv, ros-camera-info, direct-visual "
    "or opencalib  [default: told by the content]",
)
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="The rig file to write  [default: print it]",
)
@click.option(
    "--onto",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="A rig file to add to: what the calibration says counts, the rest is kept.",
)
@click.option(
    "--image-size", metavar="WxH", help="Of the images, where the calibration does not say it."
)
@click.option("--camera", metavar="NAME", help="Which camera, where a calibration holds several.")
@click.option("--overwrite", is_flag=True, help="Replace a rig file that is there.")
def import_(
    files: tuple[Path, ...],
    *,
    format_name: str | None,
    out: Path | None,
    onto: Path | None,
    image_size: str | None,
    camera: str | None,
    overwrite: bool,
) -> None:
    """Read the calibration in FILES and write it as a rig file.

    The directions are said in words: read them. Several FILES are those that one program writes,
    such as FAST-LIVO2's configuration and its camera.
    """
    from civil_rgbd.errors import UsageError
    from civil_rgbd.format.atomic import whole_file
    from civil_rgbd.trajectories.rig import read_rig
    from civil_rgbd.trajectories.rig_importers.formats import import_rig, merged
    from civil_rgbd.trajectories.rig_importers.values import Request
    from civil_rgbd.trajectories.rig_text import rig_to_text

    request = Request(_size(image_size), camera)
    name, imported = import_rig(files, format_name, request)
    rig = imported.rig if onto is None else merged(read_rig(onto), imported.rig)
    sources = f"from {', '.join(file.name for file in files)} ({name})"
    if onto is not None:
        sources += f", onto {onto.name}"
    text = rig_to_text(rig, (sources, *imported.remarks))
    if out is None:
        print(text, end="")
        return
    if out.exists() and not overwrite:
        raise UsageError("the rig file is there already", where=out, fix="add --overwrite")
    with whole_file(out) as scratch:
        scratch.write_text(text, encoding="utf-8", newline="\n")
    print(f"{out}: {sources}")
    for remark in imported.remarks:
        print(f"  {remark}")


def _size(text: str | None) -> tuple[int, int] | None:
    from civil_rgbd.errors import UsageError

    if text is None:
        return None
    found = re.fullmatch(r"([1-9][0-9]{0,5})[xX]([1-9][0-9]{0,5})", text.strip())
    if found is None:
        raise UsageError(
            f"--image-size {text!r} is no size", where="--image-size", fix="for example 1280x720"
        )
    return int(found[1]), int(found[2])
