"""``civil-rgbd export-onnx``: a trained model as one file that runs without torch."""

from __future__ import annotations

from pathlib import Path

import click

from civil_rgbd.cli.model_options import model_options, parsed_options


@click.command("export-onnx")
@click.argument("location", metavar="RUN")
@click.argument("path", metavar="FILE.onnx", type=click.Path(path_type=Path))
@click.option(
    "--size",
    nargs=2,
    type=click.IntRange(min=1),
    default=(768, 432),
    show_default=True,
    metavar="WIDTH HEIGHT",
    help="Of the images that it will be given, pixels.",
)
@model_options
def command(location: str, path: Path, *, size: tuple[int, int], options: tuple[str, ...]) -> None:
    """Write the model of RUN as FILE.onnx, compared with torch.

    In go rgb (1, 3, HEIGHT, WIDTH) float32 from 0 to 1 and intrinsics (1, 3, 3) in pixels, where
    the model uses them; out comes depth_m (1, 1, HEIGHT, WIDTH) in metres.
    """
    from civil_rgbd.baselines import load_model
    from civil_rgbd.cli.torch_needed import require_torch
    from civil_rgbd.errors import UsageError

    require_torch("export-onnx", extra="onnx")
    from civil_rgbd.baselines.onnx_export import export_onnx
    from civil_rgbd.baselines.torch_model import TorchDepthModel

    model = load_model(location, **parsed_options(options))
    if not isinstance(model, TorchDepthModel):
        raise UsageError(
            f"a {type(model).__name__} is not made of torch",
            where=location,
            fix="give a run folder, or one of the built-in networks",
        )
    if not model.is_trained:
        click.echo(f"warning: {location} has random weights: its answers are noise", err=True)
    width_px, height_px = size
    done = export_onnx(model, path, height_px=height_px, width_px=width_px)
    print(
        f"{done.path}: {done.bytes / 1e6:.1f} MB; on a random picture onnxruntime and torch differ "
        f"by {done.usual_difference:.0e} of the depth in 99 of 100 pixels, at most by "
        f"{done.largest_difference:.0e}"
    )
