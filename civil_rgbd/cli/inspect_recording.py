"""``civil-rgbd inspect-recording``: what a recording holds, and what it lacks for a build."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from civil_rgbd.cli.beside import options_of_recording, read_beside

if TYPE_CHECKING:
    from civil_rgbd.domain.inspection import RecordingSummary
    from civil_rgbd.domain.recording import RecordingOptions


@click.command("inspect-recording")
@click.argument("sources", metavar="SOURCE...", nargs=-1, required=True)
@options_of_recording
@click.option(
    "--topics",
    "only_topics",
    is_flag=True,
    help="Only list the topics: at once, from the recording's own index where it has one.",
)
@click.option("--json", "as_json", is_flag=True, help="Print everything, for machines.")
@click.pass_context
def command(
    context: click.Context,
    /,
    sources: tuple[str, ...],
    *,
    rig_path: Path | None,
    only_topics: bool,
    as_json: bool,
    **recording_options: object,
) -> None:
    """Say what SOURCE, a raw recording, holds: topics, rates, clocks, gaps, frames.

    The files of a recording that was split are given in order.

    What a build misses is listed with the option that supplies it; give that option here to see
    whether it is enough. Exit code 0: a build could start; 1: something is missing; 2: SOURCE
    cannot be read.
    """
    from civil_rgbd.domain.recording import RecordingOptions
    from civil_rgbd.domain.rig import RigFile
    from civil_rgbd.health.inspection import findings_of
    from civil_rgbd.health.inspection_report import InspectionReport
    from civil_rgbd.storage.places import place_of
    from civil_rgbd.trajectories.rig import read_rig

    rig = read_rig(rig_path) if rig_path else RigFile()
    options = RecordingOptions(rig=rig, **read_beside(recording_options))
    options = replace(options, more_files=tuple(map(place_of, sources[1:])))
    if only_topics:
        context.exit(_list_topics(sources[0], options, as_json=as_json))
    summary = _summary(sources[0], options)
    report = InspectionReport(summary, findings_of(summary, options), files=len(sources))
    print(json.dumps(report.to_document(), indent=2) if as_json else report.to_text())
    context.exit(1 if report.errors else 0)


def _list_topics(source: str, options: RecordingOptions, *, as_json: bool) -> int:
    from civil_rgbd.converters import list_topics
    from civil_rgbd.health.listing_report import listing_document, listing_text

    listing = list_topics(source, options)
    print(json.dumps(listing_document(listing), indent=2) if as_json else listing_text(listing))
    return 1 if listing.damage else 0


def _summary(source: str, options: RecordingOptions) -> RecordingSummary:
    from civil_rgbd.converters import can_inspect, inspect_recording, open_recording
    from civil_rgbd.health.opened import summarise_opened

    if can_inspect(source):
        return inspect_recording(source, options)
    return summarise_opened(lambda: open_recording(source, options), location=source)
