"""``civil-rgbd verify``: are the files what the index says, and do the recordings prove them?"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from civil_rgbd.cli.beside import options_of_recording
from civil_rgbd.errors import CivilRgbdError, UsageError

if TYPE_CHECKING:
    from civil_rgbd.builder.bridge_build import Order
    from civil_rgbd.builder.verify import Rebuilt
    from civil_rgbd.validation import Report


@click.command("verify")
@click.argument("location")
@click.option(
    "--rebuild",
    "frames",
    type=click.IntRange(min=0),
    default=0,
    metavar="N",
    help="Render N random frames again from the raw recordings, and compare their pixels.",
)
@click.option("--seed", type=int, default=0, show_default=True, help="Draws the frames.")
@click.option(
    "--source",
    "sources",
    multiple=True,
    metavar="FILE",
    help="A raw recording, for --rebuild; may be given again. Its bridge is found by its sha256; "
    "where there is none, by name, size and ETag.",
)
@click.option(
    "--survey",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="The survey that the dataset was built from: it names sources and how they are read.",
)
@options_of_recording
@click.option("--json", "as_json", is_flag=True, help="Print every finding, for machines.")
@click.pass_context
def command(
    context: click.Context,
    /,
    location: str,
    *,
    frames: int,
    seed: int,
    sources: tuple[str, ...],
    survey: Path | None,
    as_json: bool,
    **reading: Any,  # noqa: ANN401  # click's values
) -> None:
    """Check LOCATION, a dataset folder or one bridge folder, against its own hashes.

    With --rebuild it is proved from the raw recordings: give them with --source or --survey, and
    what the build was told of them by the same options. Exit code 1 when anything differs.
    """
    from contextlib import redirect_stdout

    from civil_rgbd.cli.progress import frame_bar
    from civil_rgbd.validation import validate

    if not frames and (sources or survey):
        raise UsageError(
            "sources are given, but no frame is to be rendered again",
            where="--source, --survey",
            fix="say how many: --rebuild 20",
        )
    orders = _orders(location, sources, survey, reading, context) if frames else {}
    # OpenEXR prints its own complaints about damaged files, and would print into the JSON.
    with redirect_stdout(sys.stderr), frame_bar("hashes") as on_progress:
        report = validate(location, progress=on_progress)
    rebuilt = _rebuild(location, orders, frames, seed) if frames and not report.errors else []
    unproved = _not_proved(location)
    if as_json:
        print(_as_json(report, rebuilt, unproved))
    else:
        print(_as_text(report, rebuilt, unproved, frames))
    context.exit(1 if report.errors or any(one.differences for one in rebuilt) else 0)


def _orders(
    location: str,
    sources: Sequence[str],
    survey: Path | None,
    reading: dict[str, Any],
    context: click.Context,
) -> dict[str, Order]:
    """Find the recording of every bridge; refuse what cannot be rendered again."""
    from civil_rgbd.builder.verify import refuse_imported
    from civil_rgbd.cli.orders import order_of, orders_of_survey, refuse_beside_survey
    from civil_rgbd.cli.whose_source import sources_of
    from civil_rgbd.domain.bridge import BridgeInfo
    from civil_rgbd.format.layout import MANIFEST, bridge_folders
    from civil_rgbd.format.manifest import read_manifest

    manifests = {
        name: read_manifest(folder / MANIFEST) for name, folder in bridge_folders(location).items()
    }
    for manifest in manifests.values():
        refuse_imported(manifest)
    if survey is not None:
        refuse_beside_survey(context, ["sources", *reading])
        orders = {o.info.bridge_id: o for o in orders_of_survey(survey, only=None)}
    else:
        rig_path = reading.pop("rig_path")
        orders = {
            name: order_of(files, BridgeInfo(name), rig_path=rig_path, reading=reading)
            for name, files in sources_of(manifests, sources).items()
        }
    for name, manifest in manifests.items():
        if name not in orders:
            wanted = ", ".join(f"{s.name} (sha256 {s.sha256})" for s in manifest.sources)
            raise UsageError(
                f"the raw recording of bridge {name!r} is not given: {wanted or 'it has no file'}",
                where="--source" if survey is None else survey,
                fix="give it: --source FILE, or --survey FILE; or verify one bridge: "
                f"civil-rgbd verify DATASET/bridges/{next(iter(orders), name)}",
            )
    return {name: orders[name] for name in manifests}


def _not_proved(location: str) -> list[str]:
    """Name the bridges whose manifest has no hash of a source."""
    from civil_rgbd.format.layout import MANIFEST, bridge_folders
    from civil_rgbd.format.manifest import read_manifest

    names = []
    for name, folder in bridge_folders(location).items():
        with suppress(CivilRgbdError):  # the report says what is wrong with it
            manifest = read_manifest(folder / MANIFEST)
            if not all(source.sha256 for source in manifest.sources):
                names.append(name)
    return names


def _rebuild(location: str, orders: Mapping[str, Order], frames: int, seed: int) -> list[Rebuilt]:
    from civil_rgbd.builder.verify import choose_frames, rebuild_frames
    from civil_rgbd.cli.progress import frame_bar
    from civil_rgbd.format.layout import bridge_folders
    from civil_rgbd.format.reader import read_bridge

    bridges = {name: read_bridge(folder) for name, folder in bridge_folders(location).items()}
    chosen = choose_frames({name: b.rows for name, b in bridges.items()}, frames, seed=seed)
    total = sum(map(len, chosen.values()))
    with frame_bar("rebuild") as on_progress:
        return [
            rebuild_frames(
                bridges[name], orders[name].open(), rows, on_frame=lambda: on_progress(1, total)
            )
            for name, rows in chosen.items()
        ]


def _as_json(report: Report, rebuilt: Sequence[Rebuilt], unproved: Sequence[str]) -> str:
    document = report.to_document() | {
        "rebuilt": [one.to_document() for one in rebuilt],
        "sources_not_proved": list(unproved),
    }
    return json.dumps(document, indent=2)


def _as_text(
    report: Report, rebuilt: Sequence[Rebuilt], unproved: Sequence[str], frames: int
) -> str:
    lines = [report.to_text()]
    if frames and report.errors:
        lines.append("nothing was rendered again: the files themselves are not what they should be")
    for one in rebuilt:
        same = one.frames - len({d.frame_id for d in one.differences})
        lines.append(f"{one.bridge_id}: {same} of {one.frames} frames came out the same")
        lines += [f"  {d.frame_id} {d.of:<6} {d.what}" for d in one.differences]
        if one.versions and one.differences:
            lines.append(f"  other versions: {'; '.join(one.versions)}")
    lines += [f"{name}: source not proved: the manifest has no hash of it" for name in unproved]
    return "\n".join(lines)
