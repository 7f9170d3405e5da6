"""``civil-rgbd build``: a raw recording in, a bridge folder out."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import click

from civil_rgbd.cli.beside import options_of_recording, read_beside
from civil_rgbd.cli.bridge_info import options_of_bridge, read_bridge_info


@click.command("build")
@click.argument("sources", nargs=-1, metavar="[SOURCE]...")
@click.option(
    "--recipe",
    "recipe_name",
    default="250k",
    show_default=True,
    metavar="NAME|FILE",
    help="A recipe that ships (see `civil-rgbd recipes`), or a TOML file.",
)
@click.option(
    "--set",
    "settings",
    multiple=True,
    metavar="STAGE.KEY=VALUE",
    help="Change one key of the recipe; may be given again.",
)
@click.option(
    "--bridge", "bridge_id", metavar="ID", help="The bridge's id  [default: the file's stem]"
)
@options_of_bridge
@click.option(
    "--workers",
    type=click.IntRange(min=1),
    metavar="N",
    help="Processes  [default: one a processor]",
)
@click.option("--overwrite", is_flag=True, help="Replace a bridge that was made otherwise.")
@options_of_recording
@click.option("--json", "as_json", is_flag=True, help="Print the report as JSON.")
def command(
    sources: tuple[str, ...],
    *,
    recipe_name: str,
    settings: tuple[str, ...],
    bridge_id: str | None,
    dataset: Path,
    bridge_info: Path | None,
    licence: str | None,
    workers: int | None,
    overwrite: bool,
    as_json: bool,
    rig_path: Path | None,
    **recording_options: object,
) -> None:
    """Build a bridge folder from SOURCE, a raw recording; or from its files, in order.

    Without SOURCE a small simulated scan of a girder bridge is built. A build that was stopped is
    gone on with by the same command.
    """
    import json

    from civil_rgbd.builder.bridge import require_free_id
    from civil_rgbd.builder.recipes import load_recipe, overrides_of
    from civil_rgbd.builder.run import BuildOptions, build_bridge
    from civil_rgbd.cli.progress import frame_bar
    from civil_rgbd.converters import open_recording
    from civil_rgbd.domain.bridge import BridgeInfo
    from civil_rgbd.domain.recording import RecordingOptions
    from civil_rgbd.domain.rig import RigFile
    from civil_rgbd.trajectories.rig import read_rig

    recipe = load_recipe(recipe_name, settings)
    location = sources[0] if sources else _demo_recording()
    bridge_id = bridge_id or (Path(sources[0]).stem if sources else "demo")
    require_free_id(dataset, bridge_id)
    unsaid = BridgeInfo(bridge_id)
    if not sources:
        unsaid = BridgeInfo(bridge_id, licence="CC0-1.0", name="Simulated girder bridge")
    info = read_bridge_info(bridge_info, licence=licence, otherwise=unsaid)
    rig = read_rig(rig_path) if rig_path else RigFile()
    options = RecordingOptions(rig=rig, **read_beside(recording_options))
    options = replace(options, more_files=tuple(map(Path, sources[1:])))
    recording = open_recording(location, options)
    with frame_bar(info.bridge_id) as on_progress, _saying_what_is_kept():
        report = build_bridge(
            recording,
            recipe,
            dataset,
            info,
            BuildOptions(
                workers=workers or _processors(),
                overwrite=overwrite,
                overrides=overrides_of(settings),
                on_progress=on_progress,
            ),
        )
    print(json.dumps(report.to_document(), indent=2) if as_json else report.to_text())


@contextmanager
def _saying_what_is_kept() -> Iterator[None]:
    try:
        yield
    except KeyboardInterrupt:
        click.echo("finished frames are kept: the same command goes on with them", err=True)
        raise


def _demo_recording() -> str:
    from civil_rgbd.simulator import cached_demo_recording

    click.echo("no source given: building the simulated demo bridge", err=True)
    return str(cached_demo_recording())


def _processors() -> int:
    # The processors that this process may use: a job on a cluster has fewer than the machine.
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
