"""``civil-rgbd poses``: poses for a recording that has none."""

from __future__ import annotations

import signal
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from civil_rgbd.domain.motion import MotionRecording
    from civil_rgbd.odometry.engines import Engine
    from civil_rgbd.odometry.poses import JudgedPoses

_FILE = click.Path(path_type=Path)
_REDRAW_S = 0.2


@click.command("poses")
@click.argument("sources", metavar="SOURCE...", nargs=-1, required=True)
@click.option(
    "--engine",
    "engine_name",
    default="genz-lio",
    show_default=True,
    metavar="NAME",
    help="genz-lio or se3-lio for a hand-held Livox Avia, rko-lio for sensors that look all round.",
)
@click.option("--out", type=_FILE, default="poses.tum", show_default=True, metavar="FILE.tum")
@click.option(
    "--create-environment",
    is_flag=True,
    help="Install the engine, if it is missing, into a Python environment of its own.",
)
@click.option(
    "--environment",
    type=_FILE,
    metavar="FOLDER",
    help="The engine's Python environment  [default: in the user's cache]",
)
@click.option(
    "--rig",
    "rig_path",
    type=_FILE,
    metavar="FILE",
    help="TOML: T_imu_lidar, where the recording lacks it.",
)
@click.option("--lidar-topic", metavar="TOPIC", help="The point clouds, where several topics fit.")
@click.option("--imu-topic", metavar="TOPIC", help="The IMU, where several topics fit.")
@click.option(
    "--point-time",
    metavar="FIELD:UNIT:REFERENCE",
    help="Per-point time of an unusual point cloud, for example stamp:us:header.",
)
@click.option("--salvage", is_flag=True, help="Use what is readable of a damaged recording.")
@click.option(
    "--timeout-s",
    type=click.FloatRange(min=1),
    metavar="S",
    help="Stop the engine after this  [default: 10 min and 30 times the recording]",
)
@click.option(
    "--max-speed-m-s",
    type=click.FloatRange(min=0, min_open=True),
    default=4.0,
    show_default=True,
    metavar="M/S",
    help="Faster poses have quality 0.",
)
@click.option(
    "--keep", type=_FILE, metavar="FOLDER", help="Keep the engine's input, settings and answer."
)
@click.option("--overwrite", is_flag=True, help="Replace poses that are there.")
def command(
    sources: tuple[str, ...],
    *,
    engine_name: str,
    out: Path,
    create_environment: bool,
    environment: Path | None,
    timeout_s: float | None,
    max_speed_m_s: float,
    keep: Path | None,
    overwrite: bool,
    **options: Any,  # noqa: ANN401  # of the recording: click hands them over by name
) -> int:
    """Compute poses of SOURCE, a recording with LiDAR and IMU, by an odometry engine.

    The files of a recording that was split are given in order.

    The engine runs as a program of its own. FILE.tum gets the poses of the IMU, each at its own
    stamp; FILE.quality.csv beside it says how far each can be trusted. Exit code 1: some cannot.
    """
    from civil_rgbd.odometry.engines import engine_named
    from civil_rgbd.odometry.poses import judged_poses
    from civil_rgbd.odometry.quality import Limits

    engine = engine_named(engine_name)
    _refuse_to_overwrite(out, overwrite=overwrite)
    with _ends_when_told(), _bar() as on_step:
        program = _program(engine, environment, create=create_environment, on_step=on_step)
        recording = _opened(sources, options)
        with _scratch(keep, out) as scratch:
            found = judged_poses(
                recording,
                engine,
                program,
                scratch=scratch,
                timeout_s=timeout_s,
                limits=Limits(speed_m_s=max_speed_m_s),
                on_step=on_step,
            )
    _write(out, found)
    print(found.to_text(out.name))
    return 1 if found.weak else 0


def _opened(sources: tuple[str, ...], options: dict[str, Any]) -> MotionRecording:
    from civil_rgbd.converters import open_motion
    from civil_rgbd.domain.recording import RecordingOptions
    from civil_rgbd.domain.rig import RigFile
    from civil_rgbd.storage.places import place_of
    from civil_rgbd.trajectories.rig import read_rig

    rig_path = options.pop("rig_path")
    rig = read_rig(rig_path) if rig_path else RigFile()
    more = tuple(map(place_of, sources[1:]))
    return open_motion(sources[0], RecordingOptions(rig=rig, more_files=more, **options))


def _program(
    engine: Engine, folder: Path | None, *, create: bool, on_step: Callable[..., object]
) -> Path:
    from civil_rgbd.errors import MissingExtraError
    from civil_rgbd.odometry.environment import (
        create_environment,
        environment_folder,
        find_program,
    )
    from civil_rgbd.resources import cache_folder

    folder = (folder or environment_folder(cache_folder(), engine)).absolute()
    try:
        return find_program(engine, folder)
    except MissingExtraError:
        if not create:
            raise
    click.echo(f"installing {engine.name} {engine.version} into {folder}", err=True)
    what = f"installing {engine.name}"
    create_environment(engine, folder, on_tick=lambda seconds: on_step(what, seconds, 0))
    return find_program(engine, folder)


def _refuse_to_overwrite(out: Path, *, overwrite: bool) -> None:
    from civil_rgbd.errors import OutputError, UsageError
    from civil_rgbd.trajectories.quality import quality_path

    if out.suffix.lower() not in {".tum", ".txt"}:
        raise UsageError(
            f"--out {out.name!r} is no name for a TUM file",
            where="--out",
            fix=f"write to {out.with_suffix('.tum').name!r}",
        )
    there = [path for path in (out, quality_path(out)) if path.exists()]
    if there and not overwrite:
        raise OutputError(
            f"{there[0].name} is there already",
            where=there[0],
            fix="choose another name with --out, or give --overwrite",
        )


def _write(out: Path, found: JudgedPoses) -> None:
    from civil_rgbd.format.atomic import whole_file, writing
    from civil_rgbd.odometry.tum import tum_text
    from civil_rgbd.trajectories.quality import quality_path, quality_text

    judged = quality_path(out)
    with writing(out):
        out.parent.mkdir(parents=True, exist_ok=True)
        # Never new poses beside old quality: without the file they merely have none.
        judged.unlink(missing_ok=True)
    with whole_file(out) as scratch:
        scratch.write_text(tum_text(found.trajectory, found.header), encoding="utf-8")
    with whole_file(judged) as scratch:
        text = quality_text(found.trajectory, found.details())
        scratch.write_text(text, encoding="utf-8")


@contextmanager
def _scratch(keep: Path | None, out: Path) -> Iterator[Path]:
    from civil_rgbd.errors import OutputError
    from civil_rgbd.format.atomic import writing

    if keep is not None:
        if keep.exists() and any(keep.iterdir()):
            raise OutputError("the folder is not empty", where=keep, fix="name another with --keep")
        with writing(keep):
            keep.mkdir(parents=True, exist_ok=True)
        yield keep.absolute()
        return
    with writing(out):  # beside the output, which has room, rather than in a small /tmp
        out.parent.mkdir(parents=True, exist_ok=True)
        stack = ExitStack()
        prefix = f".{out.name}."
        scratch = stack.enter_context(tempfile.TemporaryDirectory(prefix=prefix, dir=out.parent))
    with stack:
        yield Path(scratch).absolute()


@contextmanager
def _ends_when_told() -> Iterator[None]:
    """Turn SIGTERM into an exit, so that the engine is stopped and the scratch folder removed."""

    def leave(number: int, _frame: object) -> None:
        raise SystemExit(128 + number)

    if threading.current_thread() is not threading.main_thread():
        yield  # only the main thread may listen
        return
    before = signal.signal(signal.SIGTERM, leave)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


@contextmanager
def _bar() -> Iterator[Callable[[str, float, float], object]]:
    """Show what is going on, and how far it is where somebody knows."""
    if not sys.stderr.isatty():
        yield lambda _what, _done, _total: None
        return
    last = -1.0

    def step(what: str, done: float, total: float) -> None:
        nonlocal last
        now = time.monotonic()
        if now - last > _REDRAW_S or done == total:
            last = now
            how_far = f"{done / total:.0%}" if total else f"{done:.0f} s"
            click.echo(f"\r\033[K{what}: {how_far}", err=True, nl=False)

    try:
        yield step
    finally:
        click.echo("\r\033[K", err=True, nl=False)
