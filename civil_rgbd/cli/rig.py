"""``civil-rgbd rig``: calibrations into rig files, and rig files against recordings."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

import click

from civil_rgbd.cli.beside import options_of_recording, read_beside

if TYPE_CHECKING:
    from civil_rgbd.domain.recording import Recording, RecordingOptions


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


@command.command("check")
@click.argument("source", metavar="RECORDING")
@options_of_recording
@click.option("--json", "as_json", is_flag=True, help="Print it for machines.")
@click.pass_context
def check(
    context: click.Context,
    /,
    source: str,
    *,
    rig_path: Path | None,
    as_json: bool,
    **recording_options: object,
) -> None:
    """Ask the images of RECORDING whether the camera's mounting is the right way round.

    A few scans are projected by the given mounting and by its inverse, and depth jumps are
    compared with the images' edges. Poses are not needed. Exit code 0: the given direction
    explains the images better, or the images do not tell; 1: its inverse does, or hardly any point
    is in view.
    """
    import json

    from civil_rgbd.domain.recording import RecordingOptions
    from civil_rgbd.domain.rig import RigFile
    from civil_rgbd.health.direction import compare_directions
    from civil_rgbd.trajectories.rig import read_rig

    rig = read_rig(rig_path) if rig_path else RigFile()
    options = RecordingOptions(rig=rig, **read_beside(recording_options))
    report = compare_directions(_opened(source, options))
    print(json.dumps(report.to_document(), indent=2) if as_json else report.to_text())
    context.exit(1 if report.verdict == "inverse" or report.misses else 0)


def _opened(source: str, options: RecordingOptions) -> Recording:
    """Open a recording by its own poses; where it has none, as if the LiDAR stood still."""
    from dataclasses import replace

    import numpy as np

    from civil_rgbd.converters import open_recording
    from civil_rgbd.errors import CivilRgbdError
    from civil_rgbd.geometry.trajectory import Trajectory

    try:
        return open_recording(source, options)
    except CivilRgbdError:
        # From 1938 to 2096, so that every clock lies within.
        stamps_ns = np.array([-(10**18), 4 * 10**18], dtype=np.int64)
        upright = np.tile([0.0, 0.0, 0.0, 1.0], (2, 1))
        still = Trajectory(stamps_ns, np.zeros((2, 3)), upright)
        options = replace(options, trajectory=still, pose_of="lidar", pose_topic=None)
        return open_recording(source, options)
