"""``civil-rgbd predict``: depth for photos."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from civil_rgbd.cli.model_options import model_options, parsed_options

if TYPE_CHECKING:
    from civil_rgbd.prediction import PhotoCamera


@click.command("predict")
@click.argument("photos", type=click.Path(path_type=Path))
@click.option(
    "--model",
    "location",
    required=True,
    metavar="RUN",
    help="A run folder, an installed model, or FILE.py:NAME.",
)
@click.option(
    "--out",
    required=True,
    type=click.Path(path_type=Path),
    metavar="FOLDER",
    help="What to make: depth/*.exr, colour/*.png, intrinsics/*.json.",
)
@click.option(
    "--intrinsics",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="intrinsics.json of the photos: a pinhole camera, no distortion.",
)
@click.option(
    "--rig",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Rig file with the photos' camera; its lens distortion is taken out.",
)
@click.option(
    "--focal-px",
    type=click.FloatRange(min=0, min_open=True),
    metavar="PX",
    help="Focal length in pixels of the photo, where no more is known.",
)
@model_options
@click.option("--device", default="auto", show_default=True, help="cpu, cuda, mps.")
@click.option("--json", "as_json", is_flag=True, help="Print the report as JSON.")
def command(
    photos: Path,
    *,
    location: str,
    out: Path,
    intrinsics: Path | None,
    rig: Path | None,
    focal_px: float | None,
    options: tuple[str, ...],
    device: str,
    as_json: bool,
) -> int:
    """Predict the depth of PHOTOS, a folder of images or one.

    The camera is given by one of --intrinsics, --rig and --focal-px. Exit code 1 says that a photo
    could not be predicted.
    """
    from civil_rgbd.baselines import DepthModel, load_model
    from civil_rgbd.baselines.devices import on_device
    from civil_rgbd.cli.progress import frame_bar
    from civil_rgbd.errors import UsageError
    from civil_rgbd.prediction import predict_photos

    camera = _camera(intrinsics=intrinsics, rig=rig, focal_px=focal_px)
    model = on_device(load_model(location, **parsed_options(options)), device)
    if not isinstance(model, DepthModel):
        raise UsageError(
            "the model knows frames that were predicted before, not photos",
            where=location,
            fix="give a run folder, or a model that predicts from an image",
        )
    if not getattr(model, "is_trained", True):
        click.echo(f"warning: {location} has random weights: its answers are noise", err=True)
    with frame_bar("predict") as on_progress:
        report = predict_photos(model, photos, camera, out, on_photo=on_progress)
    print(report.to_json() if as_json else report.to_text())
    return 1 if report.failed else 0


def _camera(*, intrinsics: Path | None, rig: Path | None, focal_px: float | None) -> PhotoCamera:
    from civil_rgbd.errors import UsageError
    from civil_rgbd.format.intrinsics import read_intrinsics
    from civil_rgbd.geometry.camera import LensCamera
    from civil_rgbd.prediction import PhotoCamera
    from civil_rgbd.trajectories.rig import read_rig

    given = [one for one in (intrinsics, rig, focal_px) if one is not None]
    if len(given) != 1:
        raise UsageError(
            "the camera is given twice" if given else "nothing is said of the camera",
            where="--intrinsics, --rig, --focal-px",
            fix="give one of them",
        )
    if intrinsics is not None:
        return PhotoCamera(calibrated=LensCamera(read_intrinsics(intrinsics)))
    if rig is None:
        return PhotoCamera(focal_px=focal_px)
    camera = read_rig(rig).camera
    if camera is None:
        raise UsageError(
            "the rig file says nothing of the camera", where=rig, fix="add its table [camera]"
        )
    return PhotoCamera(calibrated=camera)
