"""``civil-rgbd simulate``: a scan of a bridge whose truth is known, as raw MCAP or ROS 1 bag."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import click

from civil_rgbd.cli.places import refuse_remote

if TYPE_CHECKING:
    from civil_rgbd.simulator.spec import ScanSpec


_HERE = "civil-rgbd simulate"


@click.command("simulate")
@click.argument("out", type=click.Path(path_type=Path), metavar="OUT", required=False)
@click.option(
    "--out", "named_out", type=click.Path(path_type=Path), metavar="OUT", help="The same as OUT."
)
@click.option("--bridge", metavar="NAME", help="demo, B1 to B5, or mesh  [default: demo]")
@click.option("--seconds", metavar="S", help="Length of the walk  [default: 7, of B1 to B5 30]")
@click.option("--seed", metavar="N", help="Of everything random  [default: 0]")
@click.option(
    "--image-rate-hz", metavar="HZ", help="Images a second  [default: 10, of B1 to B5 30]"
)
@click.option("--image-scale", metavar="SCALE", help="Image size / 1280x720  [default: 1]")
@click.option("--point-rate-hz", metavar="HZ", help="LiDAR points a second  [default: 240000]")
@click.option(
    "--noise-m",
    "range_noise_m",
    metavar="M",
    help="Range noise, 1 sigma  [default: 0, of B1 to B5 0.02]",
)
@click.option(
    "--false-return-share",
    metavar="SHARE",
    help="Share of false returns, tagged as noise  [default: 0, of B1 to B5 0.001]",
)
@click.option(
    "--camera-time-offset-s",
    metavar="S",
    help="What must be added to image stamps to reach the LiDAR clock  [default: 0]",
)
@click.option(
    "--extrinsic-error-deg",
    type=(float, float, float),
    metavar="X Y Z",
    help="How wrong the recording states the camera's rotation, about its axes  [default: 0 0 0]",
)
@click.option(
    "--extrinsic-error-m",
    type=(float, float, float),
    metavar="X Y Z",
    help="How wrong it states the camera's place, along its axes  [default: 0 0 0]",
)
@click.option(
    "--speed-m-s",
    metavar="M/S",
    help="Walking speed at its fastest  [default: 1.3, of B1 to B5 1]",
)
@click.option(
    "--set",
    "others",
    multiple=True,
    metavar="NAME=VALUE",
    help="Any other setting of the simulator, such as drift_m_per_root_s=0, moving=0 or "
    "exposure_settles_s=0.5; may be given again. docs/simulator.md lists them.",
)
@click.option(
    "--without",
    multiple=True,
    type=click.Choice(["poses", "extrinsics"]),
    help="Leave this out of the recording, as many rigs do, and write it into a file beside it; "
    "may be given again.",
)
@click.option("--truth", is_flag=True, help="Write the truth beside it, into OUT.truth/.")
@click.option(
    "--truth-depth-scale",
    type=click.FloatRange(min=0, min_open=True, max=2),
    metavar="SCALE",
    help="With the truth, write the depth of every image, undistorted at this scale.",
)
@click.option("--overwrite", is_flag=True, help="Replace files that are there.")
def command(
    out: Path | None,
    *,
    named_out: Path | None,
    extrinsic_error_deg: tuple[float, float, float] | None,
    extrinsic_error_m: tuple[float, float, float] | None,
    others: tuple[str, ...],
    without: tuple[str, ...],
    truth: bool,
    truth_depth_scale: float | None,
    overwrite: bool,
    **settings: str | None,
) -> None:
    """Simulate a scan of a bridge and write it to OUT: .mcap (ROS 2) or .bag (ROS 1).

    An inspector walks past and under a bridge with a LiDAR like the Livox Avia and a camera like
    the RealSense D455. The demo's sensors are exact; those of the others err as real ones do, and
    their poses drift. Equal options give equal bytes.

    A bridge of your own is read from OBJ files, in metres, z up: --bridge mesh --set mesh=PATH,
    PATH being one file, or a folder with one file a part.
    """
    from civil_rgbd.cli.progress import frame_bar
    from civil_rgbd.simulator.camera import raw_camera
    from civil_rgbd.simulator.recorder import write_recording
    from civil_rgbd.simulator.truth import (
        remove_truth,
        require_free_truth,
        truth_folder,
        write_truth,
    )

    out = _only(out, named_out)
    refuse_remote(out, option="OUT")
    errors = {"extrinsic_error_deg": extrinsic_error_deg, "extrinsic_error_m": extrinsic_error_m}
    spec = _spec(settings, others, {k: v for k, v in errors.items() if v is not None})
    beside = {name: (out.with_suffix(_BESIDE[name][0]), _BESIDE[name][1]) for name in without}
    require_free_truth(out, overwrite=overwrite)
    if not overwrite:
        _refuse_to_overwrite([path for path, _ in beside.values()])
    with frame_bar("simulate") as on_progress:
        write_recording(out, spec, without=without, overwrite=overwrite, progress=on_progress)
    truth_removed = remove_truth(out)  # of the file that was there: it would now be a lie
    truth = truth or truth_depth_scale is not None
    print(f"{out}: {spec.seconds:g} s of bridge {spec.bridge!r}, {out.stat().st_size / 1e6:.1f} MB")
    for name, (path, text_of) in beside.items():
        print(f"{_write(path, text_of(spec))}: the {name}, which the recording lacks")
    if truth_removed and not truth:
        print(f"{truth_folder(out)}: removed, for it was of the recording that was replaced")
    if truth:
        pinhole = raw_camera(spec.image_scale).pinhole
        camera = None if truth_depth_scale is None else pinhole.scaled(truth_depth_scale)
        print(f"{write_truth(out, spec, depth_camera=camera)}: the truth; no build reads it")


def _only(out: Path | None, named_out: Path | None) -> Path:
    from civil_rgbd.errors import UsageError

    one, other = (out, named_out) if named_out is None else (named_out, out)
    if one is None or other is not None:
        raise UsageError(
            "no file to write to" if one is None else f"two files to write to: {one}, {other}",
            where=_HERE,
            fix="name one: `civil-rgbd simulate raw.mcap`",
        )
    return one


def _spec(
    settings: dict[str, str | None],
    others: tuple[str, ...],
    errors: dict[str, tuple[float, float, float]],
) -> ScanSpec:
    from dataclasses import replace

    from civil_rgbd.errors import UsageError
    from civil_rgbd.simulator.spec import spec_from_settings

    given: dict[str, str | float] = {k: v for k, v in settings.items() if v is not None}
    for text in others:
        name, equals, value = text.partition("=")
        if not equals or name in given:
            what = "is given twice" if equals else "is not of the form NAME=VALUE"
            raise UsageError(
                f"--set {text!r} {what}", where=_HERE, fix="for example `--set sway=1.5`, once"
            )
        given[name] = value
    spec = spec_from_settings(given, where=_HERE)
    try:
        return replace(spec, **errors)  # type: ignore[arg-type]  # by name
    except ValueError as error:
        raise UsageError(str(error), where=_HERE, fix="give three numbers") from error


def _rig_text(spec: ScanSpec) -> str:
    from civil_rgbd.domain.rig import RigFile
    from civil_rgbd.simulator.recording import SimulatedRecording
    from civil_rgbd.simulator.walk import T_IMU_LIDAR, stated_T_lidar_camera
    from civil_rgbd.trajectories.rig_text import rig_to_text

    stated = SimulatedRecording(spec).rig
    extrinsics = {("lidar", "camera"): stated_T_lidar_camera(spec), ("imu", "lidar"): T_IMU_LIDAR}
    rig = RigFile(
        extrinsics=extrinsics,
        camera_time_offset_s=spec.camera_time_offset_s or None,
        camera_name=stated.camera_name,
        lidar_name=stated.lidar_name,
    )
    return rig_to_text(rig, ("The simulated rig, as a calibration would give it.",))


def _poses_text(spec: ScanSpec) -> str:
    from civil_rgbd.odometry.tum import tum_text
    from civil_rgbd.simulator.recording import SimulatedRecording

    remarks = ("The simulated walk: poses of the IMU in its map (T_map_imu).",)
    return tum_text(SimulatedRecording(spec).trajectory, remarks)


_BESIDE: dict[str, tuple[str, Callable[[ScanSpec], str]]] = {
    "extrinsics": (".rig.toml", _rig_text),
    "poses": (".poses.tum", _poses_text),
}


def _refuse_to_overwrite(paths: list[Path]) -> None:
    from civil_rgbd.errors import OutputError

    for path in paths:
        if path.exists():
            raise OutputError(
                f"{path.name} is there already",
                where=path,
                fix="choose another name, or give --overwrite",
            )


def _write(path: Path, text: str) -> Path:
    from civil_rgbd.format.atomic import whole_file

    with whole_file(path) as scratch:
        scratch.write_text(text, encoding="utf-8")
    return path
