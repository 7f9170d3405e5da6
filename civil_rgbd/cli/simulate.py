"""``civil-rgbd simulate``: a scan of a bridge whose truth is known, as raw MCAP or ROS 1 bag."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import click

from civil_rgbd.cli.places import refuse_remote

if TYPE_CHECKING:
    from civil_rgbd.simulator.spec import ScanSpec


@click.command("simulate")
@click.argument("out", type=click.Path(path_type=Path), metavar="OUT")
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
    out: Path,
    *,
    without: tuple[str, ...],
    truth: bool,
    truth_depth_scale: float | None,
    overwrite: bool,
    **settings: str | None,
) -> None:
    """Simulate a scan of a bridge and write it to OUT: .mcap (ROS 2) or .bag (ROS 1).

    An inspector walks past and under a girder bridge with a LiDAR like the Livox Avia and a camera
    like the RealSense D455. Equal options give equal bytes.
    """
    from civil_rgbd.cli.progress import frame_bar
    from civil_rgbd.simulator.camera import raw_camera
    from civil_rgbd.simulator.recorder import write_recording
    from civil_rgbd.simulator.spec import spec_from_settings
    from civil_rgbd.simulator.truth import remove_truth, write_truth

    refuse_remote(out, option="OUT")
    here = "civil-rgbd simulate"
    given = {name: value for name, value in settings.items() if value is not None}
    spec = spec_from_settings(given, where=here)
    beside = {name: (out.with_suffix(_BESIDE[name][0]), _BESIDE[name][1]) for name in without}
    if not overwrite:
        _refuse_to_overwrite([path for path, _ in beside.values()])
    with frame_bar("simulate") as on_progress:
        write_recording(out, spec, without=without, overwrite=overwrite, progress=on_progress)
    remove_truth(out)  # of the file that was there before: it would now be a lie
    print(f"{out}: {spec.seconds:g} s of bridge {spec.bridge!r}, {out.stat().st_size / 1e6:.1f} MB")
    for name, (path, text_of) in beside.items():
        print(f"{_write(path, text_of(spec))}: the {name}, which the recording lacks")
    if truth or truth_depth_scale is not None:
        pinhole = raw_camera(spec.image_scale).pinhole
        camera = None if truth_depth_scale is None else pinhole.scaled(truth_depth_scale)
        print(f"{write_truth(out, spec, depth_camera=camera)}: the truth; no build reads it")


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
