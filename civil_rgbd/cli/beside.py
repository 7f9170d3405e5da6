"""Options for what lies beside a recording: poses, images, time lists."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import click

_FILE: Final = click.Path(path_type=Path)
_OPTIONS: Final = (
    click.option(
        "--trajectory",
        type=_FILE,
        metavar="FILE",
        help="Poses, where the recording has none: TUM, KITTI, the lab's poses.csv, R3LIVE's "
        "lic_lio.log, EuRoC CSV, COLMAP images.txt. Say whose with --pose-of, where it does not.",
    ),
    click.option(
        "--trajectory-format",
        metavar="NAME",
        help="tum, kitti, lab, r3live, euroc or colmap  [default: told by the content]",
    ),
    click.option(
        "--trajectory-times",
        type=_FILE,
        metavar="FILE",
        help="Stamps of poses without any (KITTI, lab, COLMAP), one a line or NAME,SECONDS.",
    ),
    click.option(
        "--trajectory-offset",
        metavar="SECONDS",
        help="Added to the stamps of --trajectory, or of the recording's own poses, to reach the "
        "LiDAR's clock.",
    ),
    click.option(
        "--metric-scale",
        type=float,
        metavar="METRES",
        help="Metres in one unit of --trajectory, for poses from images alone.",
    ),
    click.option(
        "--images", type=_FILE, metavar="FOLDER", help="Images, where the recording has none."
    ),
    click.option(
        "--image-times",
        type=_FILE,
        metavar="FILE",
        help="Stamps of --images, in order or NAME,SECONDS  [default: timestamps.txt in it]",
    ),
    click.option(
        "--scan-times",
        type=_FILE,
        metavar="FILE",
        help="Stamps of a folder of scans, likewise  [default: timestamps.txt in it]",
    ),
    click.option(
        "--scans-in",
        type=click.Choice(["map", "lidar"]),
        help="The frame of scans that do not say it themselves.",
    ),
)
_OF_TRAJECTORY_ALONE: Final = ("--metric-scale", "--trajectory-format", "--trajectory-times")
_OF_TRAJECTORY: Final = ("trajectory_format", "trajectory_times", "trajectory_offset")


_OF_RECORDING: Final = (
    click.option(
        "--lidar-topic", metavar="TOPIC", help="The point clouds, where several topics fit."
    ),
    click.option("--image-topic", metavar="TOPIC", help="The images, where several topics fit."),
    click.option(
        "--camera-info-topic", metavar="TOPIC", help="The camera model, where several topics fit."
    ),
    click.option("--pose-topic", metavar="TOPIC", help="The poses, where several topics fit."),
    click.option(
        "--pose-of",
        type=click.Choice(["camera", "lidar", "imu"]),
        help="What poses are poses of: PoseStamped, Path, and most trajectory files do not say it.",
    ),
    *_OPTIONS,
    click.option(
        "--rig",
        "rig_path",
        type=click.Path(path_type=Path),
        metavar="FILE",
        help="TOML: camera, extrinsics and time offset, where the recording lacks them.",
    ),
    click.option(
        "--point-time",
        metavar="FIELD:UNIT:REFERENCE",
        help="Per-point time of an unusual point cloud, for example stamp:us:header.",
    ),
    click.option(
        "--rectified", is_flag=True, help="The images are rectified: take P, no distortion."
    ),
    click.option(
        "--salvage", is_flag=True, help="Go on with what is readable of a damaged recording."
    ),
)


def options_of_recording(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command the options that say of a recording what it does not say itself.

    :func:`read_beside` turns what those of the trajectory give into nouns.
    """
    for option in reversed(_OF_RECORDING):
        command = option(command)
    return command


def read_beside(given: dict[str, Any]) -> dict[str, Any]:
    """Read the trajectory file that the options name.

    Args:
        given: values of the recording's options by name; those of the trajectory are among them.

    Returns:
        keyword arguments of :class:`civil_rgbd.domain.recording.RecordingOptions`.

    Raises:
        UsageError: options contradict each other, or a file needs another beside it.
        RecordingError: a file cannot be read or breaks its format.
    """
    from civil_rgbd.trajectories.files import read_trajectory_file

    options = dict(given)
    path, metric_scale = options.pop("trajectory"), options.pop("metric_scale")
    format_, times, offset = (options.pop(name) for name in _OF_TRAJECTORY)
    if path is None:
        given_alone = (metric_scale, format_, times)
        _refuse_alone(dict(zip(_OF_TRAJECTORY_ALONE, given_alone, strict=True)))
        return options | {"pose_offset_ns": _offset_ns(offset)}
    read = read_trajectory_file(
        path,
        format=format_,
        times_path=times,
        image_times=options["image_times"],
        metric_scale=metric_scale,
        time_offset_ns=_offset_ns(offset),
        images=options["images"],
    )
    pose_of = _body(options["pose_of"], read.body, f"{path.name} ({read.format})")
    return options | {
        "trajectory": read.trajectory,
        "trajectory_sources": read.sources,
        "trajectory_note": read.note,
        "pose_of": pose_of,
    }


def _refuse_alone(values: dict[str, object]) -> None:
    from civil_rgbd.errors import UsageError

    given = [option for option, value in values.items() if value is not None]
    if given:
        speaks = "speaks" if len(given) == 1 else "speak"
        raise UsageError(
            f"{' and '.join(given)} {speaks} of a trajectory file, but none is given",
            where=", ".join(given),
            fix=f"give it: --trajectory FILE; or leave {' and '.join(given)} out",
        )


def _offset_ns(text: str | None) -> int:
    from civil_rgbd.domain.stamps import ns_from_seconds
    from civil_rgbd.errors import UsageError

    try:
        return ns_from_seconds(text) if text is not None else 0
    except ValueError as error:
        raise UsageError(
            f"--trajectory-offset is no time: {error}",
            where="--trajectory-offset",
            fix="give seconds, for example 0.1 or 1700000000.25",
        ) from error


def _body(said: str | None, known: str | None, file: str) -> str | None:
    from civil_rgbd.errors import UsageError

    if said is not None and known is not None and said != known:
        raise UsageError(
            f"--pose-of says {said}, but {file} says of its poses that they are those of the "
            f"{known}",
            where="--pose-of",
            fix="leave --pose-of out; or give another file, if the poses are others",
        )
    return said or known
