"""``civil-rgbd check``: is this recording fit? Asked before leaving the site."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from civil_rgbd.cli.beside import options_of_recording, read_beside

if TYPE_CHECKING:
    from civil_rgbd.domain.recording import Recording, RecordingOptions
    from civil_rgbd.health.check import CheckInput
    from civil_rgbd.health.findings import Finding


@click.command("check")
@click.argument("sources", metavar="SOURCE...", nargs=-1, required=True)
@options_of_recording
@click.option(
    "--recipe",
    "recipe_name",
    default="250k",
    show_default=True,
    metavar="NAME|FILE",
    help="The recipe whose coverage is expected.",
)
@click.option("--json", "as_json", is_flag=True, help="Print everything, for machines.")
@click.pass_context
def command(
    context: click.Context,
    /,
    sources: tuple[str, ...],
    *,
    rig_path: Path | None,
    recipe_name: str,
    as_json: bool,
    **recording_options: object,
) -> None:
    """Say whether SOURCE, a raw recording, is fit, before you leave the site.

    Rates and gaps, over-exposed and blurred images, drifting clocks, the camera's time offset and
    mounting, jumps and drift of the poses, and the coverage to expect: each with a figure, its
    limit, and what to do beyond it. The files of a recording that was split are given in order.

    What the recording does not show is said to be not observable. Exit code 0: fit; 1: there are
    findings; 2: SOURCE cannot be read.
    """
    from civil_rgbd.builder.recipes import load_recipe
    from civil_rgbd.domain.recording import RecordingOptions
    from civil_rgbd.domain.rig import RigFile
    from civil_rgbd.health.check import check_recording
    from civil_rgbd.health.check_report import CheckReport
    from civil_rgbd.trajectories.rig import read_rig

    recipe = load_recipe(recipe_name)
    rig = read_rig(rig_path) if rig_path else RigFile()
    options = RecordingOptions(rig=rig, source_hash=False, **read_beside(recording_options))
    given, said = gather(sources, options)
    figures = check_recording(given, recipe)
    report = CheckReport(
        given.recording.name,
        _seconds(given.recording),
        figures,
        lacks=tuple(finding for finding in said if finding.level == "error"),
        remarks=tuple(finding for finding in said if finding.level != "error"),
    )
    print(json.dumps(report.to_document(), indent=2) if as_json else report.to_text())
    context.exit(0 if report.fit else 1)


def gather(
    sources: tuple[str, ...], options: RecordingOptions
) -> tuple[CheckInput, tuple[Finding, ...]]:
    """Open a recording and everything that is known of it.

    Args:
        sources: the recording, or its files in order.
        options: what the user says about it.

    Returns:
        what is checked; and what an inspection says of it.

    Raises:
        CivilRgbdError: it cannot be read, or lacks more than poses.
    """
    from concurrent.futures import ThreadPoolExecutor

    from civil_rgbd.converters import can_inspect, inspect_recording, open_recording
    from civil_rgbd.errors import CivilRgbdError
    from civil_rgbd.health.check import CheckInput
    from civil_rgbd.health.inspection import findings_of
    from civil_rgbd.storage.places import place_of

    source, options = sources[0], replace(options, more_files=tuple(map(place_of, sources[1:])))
    # Both walk the whole file, and let go of the interpreter while they unpack it.
    with ThreadPoolExecutor(1) as second:
        inspected = (
            second.submit(inspect_recording, source, options) if can_inspect(source) else None
        )
        refused: str | None = None
        try:
            recording = open_recording(source, options)
        except CivilRgbdError as error:
            try:
                recording = open_recording(source, _standing_still(options))
                refused = error.what
            except CivilRgbdError:
                raise error from None  # what is missing beside poses is said first
        summary = inspected.result() if inspected is not None else None
    said = findings_of(summary, options) if summary is not None else ()
    given = CheckInput(recording, refused is None, summary, options)
    if refused is not None and not any(finding.code == "no-poses" for finding in said):
        given = replace(given, why_not_posed=refused)  # there are poses, but none to be used
    return given, _not_said_twice(said)


def _standing_still(options: RecordingOptions) -> RecordingOptions:
    import numpy as np

    from civil_rgbd.geometry.trajectory import Trajectory

    # From 1938 to 2096, so that every clock lies within.
    stamps_ns = np.array([-(10**18), 4 * 10**18], dtype=np.int64)
    still = Trajectory(stamps_ns, np.zeros((2, 3)), np.tile([0.0, 0.0, 0.0, 1.0], (2, 1)))
    return replace(options, trajectory=still, pose_of="lidar", pose_topic=None)


def _not_said_twice(said: tuple[Finding, ...]) -> tuple[Finding, ...]:
    """Leave out the gaps that have a figure of their own."""
    figures = ("gap of more than", "gaps of more than")
    return tuple(
        finding for finding in said if not any(words in finding.message for words in figures)
    )


def _seconds(recording: Recording) -> float:
    stamps_ns = recording.scan_stamps_ns
    return float(stamps_ns.max() - stamps_ns.min()) / 1e9 if len(stamps_ns) else 0.0
