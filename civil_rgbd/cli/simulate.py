"""``civil-rgbd simulate``: a scan of a bridge whose truth is known, as raw MCAP."""

from __future__ import annotations

from pathlib import Path

import click


@click.command("simulate")
@click.argument("out", type=click.Path(path_type=Path), metavar="OUT.mcap")
@click.option("--bridge", metavar="NAME", help="The bridge to scan  [default: demo]")
@click.option("--seconds", metavar="S", help="Length of the walk  [default: 7]")
@click.option("--seed", metavar="N", help="Of everything random  [default: 0]")
@click.option("--image-rate-hz", metavar="HZ", help="Images a second  [default: 10]")
@click.option("--image-scale", metavar="SCALE", help="Image size / 1280x720  [default: 1]")
@click.option("--point-rate-hz", metavar="HZ", help="LiDAR points a second  [default: 240000]")
@click.option("--noise-m", "range_noise_m", metavar="M", help="Range noise, 1 sigma  [default: 0]")
@click.option(
    "--false-return-share",
    metavar="SHARE",
    help="Share of false returns, tagged as noise  [default: 0]",
)
@click.option(
    "--camera-time-offset-s",
    metavar="S",
    help="What must be added to image stamps to reach the LiDAR clock  [default: 0]",
)
@click.option("--speed-m-s", metavar="M/S", help="Walking speed at its fastest  [default: 1.3]")
@click.option("--truth", is_flag=True, help="Write the truth beside it, into OUT.truth/.")
@click.option(
    "--truth-depth-scale",
    type=click.FloatRange(min=0, min_open=True, max=2),
    metavar="SCALE",
    help="With the truth, write the depth of every image, undistorted at this scale.",
)
@click.option("--overwrite", is_flag=True, help="Replace a file that is there.")
def command(
    out: Path,
    *,
    truth: bool,
    truth_depth_scale: float | None,
    overwrite: bool,
    **settings: str | None,
) -> None:
    """Simulate a scan of a bridge and write it to OUT.mcap.

    An inspector walks past and under a girder bridge with a LiDAR like the Livox Avia and a camera
    like the RealSense D455. Equal options give equal bytes.
    """
    from civil_rgbd.cli.progress import frame_bar
    from civil_rgbd.errors import UsageError
    from civil_rgbd.simulator.camera import raw_camera
    from civil_rgbd.simulator.mcap_file import write_recording
    from civil_rgbd.simulator.spec import spec_from_settings
    from civil_rgbd.simulator.truth import remove_truth, write_truth

    here = "civil-rgbd simulate"
    given = {name: value for name, value in settings.items() if value is not None}
    spec = spec_from_settings(given, where=here)
    if out.suffix.lower() != ".mcap":
        fix = f"write to {out.with_suffix('.mcap').name!r}"
        raise UsageError(f"{out.name!r} does not end in .mcap", where=here, fix=fix)
    with frame_bar("simulate") as on_progress:
        write_recording(out, spec, overwrite=overwrite, progress=on_progress)
    remove_truth(out)  # of the file that was there before: it would now be a lie
    print(f"{out}: {spec.seconds:g} s of bridge {spec.bridge!r}, {out.stat().st_size / 1e6:.1f} MB")
    if truth or truth_depth_scale is not None:
        pinhole = raw_camera(spec.image_scale).pinhole
        camera = None if truth_depth_scale is None else pinhole.scaled(truth_depth_scale)
        print(f"{write_truth(out, spec, depth_camera=camera)}: the truth; no build reads it")
