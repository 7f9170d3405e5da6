"""``civil-rgbd build``: raw recordings in, bridge folders out."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from civil_rgbd.cli.beside import options_of_recording
from civil_rgbd.cli.bridge_info import options_of_bridge, read_bridge_info
from civil_rgbd.cli.execution import options_from, options_of_execution
from civil_rgbd.errors import UsageError

if TYPE_CHECKING:
    from civil_rgbd.domain.bridge import BridgeInfo
    from civil_rgbd.storage.places import Place


@click.command("build")
@click.argument("sources", nargs=-1, metavar="[SOURCE]...")
@click.option(
    "--recipe",
    "recipe_name",
    default="250k-clean",
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
    "--bridge",
    "bridge_id",
    metavar="ID",
    help="The bridge's id  [default: the file's stem]; of a survey, the only bridge to build",
)
@options_of_bridge
@options_of_execution
@click.option("--overwrite", is_flag=True, help="Replace a bridge that was made otherwise.")
@options_of_recording
@click.option(
    "--no-source-hash",
    is_flag=True,
    help="Take no SHA-256 of the sources, which means reading all of them: nothing will prove "
    "what the bridge was built from.",
)
@click.option("--json", "as_json", is_flag=True, help="Print the report as JSON.")
@click.pass_context
def command(  # the options of a build are many: most are handed on as they are
    context: click.Context,
    /,
    sources: tuple[str, ...],
    *,
    recipe_name: str,
    settings: tuple[str, ...],
    bridge_id: str | None,
    dataset: Path,
    bridge_info: Path | None,
    licence: str | None,
    workers: int | None,
    executor: str | None,
    scheduler: str | None,
    chunk: str | None,
    overwrite: bool,
    as_json: bool,
    rig_path: Path | None,
    no_source_hash: bool,
    **recording_options: object,
) -> None:
    """Build a bridge folder from SOURCE, a raw recording; or from its files, in order.

    SOURCE may be a survey, a .toml file that names many recordings: see docs/format.md. Without
    SOURCE a small simulated scan of a girder bridge is built. A build that was stopped is gone on
    with by the same command.
    """
    import json

    from civil_rgbd.builder.recipes import load_recipe, overrides_of
    from civil_rgbd.builder.run import build_bridges, only_report
    from civil_rgbd.cli.orders import (
        order_of,
        orders_of_survey,
        refuse_beside_survey,
        seen_from_elsewhere,
    )
    from civil_rgbd.cli.progress import frame_bar
    from civil_rgbd.storage.places import place_of

    recipe, folder = load_recipe(recipe_name, settings), place_of(dataset)
    options = options_from(workers=workers, executor=executor, scheduler=scheduler, chunk=chunk)
    options = replace(options, overwrite=overwrite, overrides=overrides_of(settings))
    elsewhere = options.executor == "dask"
    is_survey = _is_survey(sources)
    if is_survey:
        refuse_beside_survey(context, ["bridge_info", "licence", "rig_path", *recording_options])
        file = Path(sources[0])
        file = file.absolute() if elsewhere and file.exists() else file
        orders = orders_of_survey(file, only=bridge_id, hashed=not no_source_hash)
    else:
        info = _info(sources, bridge_id, folder, bridge_info=bridge_info, licence=licence)
        files = sources or (_demo_recording(),)
        reading = {**recording_options, "source_hash": not no_source_hash}
        if elsewhere:
            files, reading = seen_from_elsewhere(files, reading)
        orders = [order_of(files, info, rig_path=rig_path, reading=reading)]
    title = Path(sources[0]).stem if is_survey else orders[0].info.bridge_id
    with frame_bar(title) as on_progress, _saying_what_is_kept():
        report = build_bridges(orders, recipe, folder, replace(options, on_progress=on_progress))
    done = report if is_survey else only_report(report)
    print(json.dumps(done.to_document(), indent=2) if as_json else done.to_text())
    context.exit(1 if report.failed else 0)


def _is_survey(sources: tuple[str, ...]) -> bool:
    surveys = [source for source in sources if source.lower().endswith(".toml")]
    if surveys and len(sources) > 1:
        raise UsageError(
            "a survey stands alone: it names its recordings itself",
            where=surveys[0],
            fix="give the survey and nothing else, or recordings only",
        )
    return bool(surveys)


def _info(
    sources: tuple[str, ...],
    bridge_id: str | None,
    dataset: Place,
    *,
    bridge_info: Path | None,
    licence: str | None,
) -> BridgeInfo:
    """Gather what is said of the one bridge; its id comes from the file where nobody gave one."""
    from civil_rgbd.builder.bridge import require_free_id
    from civil_rgbd.domain.bridge import BridgeInfo
    from civil_rgbd.storage.places import place_of

    bridge_id = bridge_id or (place_of(sources[0]).stem if sources else "demo")
    require_free_id(dataset, bridge_id)
    unsaid = BridgeInfo(bridge_id)
    if not sources:
        unsaid = BridgeInfo(bridge_id, licence="CC0-1.0", name="Simulated girder bridge")
    return read_bridge_info(bridge_info, licence=licence, otherwise=unsaid)


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
