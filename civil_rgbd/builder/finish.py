"""Join what the jobs of an array have made: ``civil-rgbd finish``."""

from __future__ import annotations

import time
from collections.abc import Sequence

from civil_rgbd.builder.bridge import (
    IDENTITY,
    find_whole,
    remove_if_empty,
    remove_left_over,
    remove_partial,
)
from civil_rgbd.builder.chunks import finished_chunks
from civil_rgbd.builder.facts import Facts, read_facts
from civil_rgbd.builder.publish import missing_frames, publish
from civil_rgbd.builder.report import BuildReport, Outcome, SurveyReport
from civil_rgbd.builder.shares import BEGIN_WAIT_S, Share, gate_of, read_divisions
from civil_rgbd.domain.bridge import Manifest
from civil_rgbd.domain.recording import RecordingNotes
from civil_rgbd.errors import BridgeFailedError, CivilRgbdError, UsageError
from civil_rgbd.format.atomic import folder_lock, recover_folder
from civil_rgbd.format.datasets import refresh_dataset
from civil_rgbd.format.layout import BRIDGES, MANIFEST, PARTIAL, dataset_bridges
from civil_rgbd.format.manifest import read_manifest
from civil_rgbd.storage.places import Place, place_of

_SHOWN: int = 20


def unfinished(dataset: Place) -> tuple[str, ...]:
    """Return the ids of the bridges that are begun and not published, sorted."""
    partial = dataset / PARTIAL
    if not partial.is_dir():
        return ()
    return tuple(sorted(e.name for e in partial.iterdir() if (e / IDENTITY).is_file()))


def finish_bridges(
    dataset: str | Place, bridge_ids: Sequence[str] = (), *, overwrite: bool = False
) -> SurveyReport:
    """Publish the bridges whose parts are all made. No recording is needed: parts left the plan.

    Bridges that are whole are found: it may run again, however far it came before.

    Args:
        dataset: the dataset folder.
        bridge_ids: which bridges; () for all that are begun, or for all if none is.
        overwrite: replace a bridge that was made otherwise.

    Returns:
        what became of each: one with missing parts failed.

    Raises:
        UsageError: no bridge is begun or whole, or one of those named is neither.
    """
    started = time.monotonic()
    dataset = place_of(dataset)
    begun, whole = unfinished(dataset), tuple(dataset_bridges(dataset))
    for bridge_id in bridge_ids:
        if bridge_id not in begun + whole:
            raise UsageError(
                f"no unfinished bridge {bridge_id!r} lies here",
                where=dataset,
                fix=f"begun and not published: {', '.join(begun) or 'none'}",
            )
    wanted = tuple(bridge_ids) or begun or whole
    if not wanted:
        raise UsageError(
            "no unfinished bridge lies here",
            where=dataset,
            fix="make the parts first: civil-rgbd build --chunk 1/8 ..., then --chunk 2/8, ...",
        )
    outcomes = []
    for bridge_id in wanted:
        try:
            report = (
                _finish(dataset, bridge_id, overwrite=overwrite)
                if bridge_id in begun
                else _find(dataset, bridge_id)
            )
            outcomes.append(Outcome(bridge_id, report=report))
        except CivilRgbdError as error:
            outcomes.append(Outcome(bridge_id, error=error))
    remove_if_empty(dataset / PARTIAL)
    return SurveyReport(tuple(outcomes), time.monotonic() - started)


def _finish(dataset: Place, bridge_id: str, *, overwrite: bool) -> BuildReport:
    started = time.monotonic()
    partial, folder = dataset / PARTIAL / bridge_id, dataset / BRIDGES / bridge_id
    # A part that begins meanwhile would bring back the unfinished build of a bridge that is there.
    with folder_lock(gate_of(partial), wait_s=BEGIN_WAIT_S), folder_lock(partial):
        recover_folder(folder)
        facts = read_facts(partial)
        whole = find_whole(folder, facts.manifest, overwrite=overwrite)
        if whole is not None:
            remove_partial(partial)  # a kill came after the bridge had appeared
        else:
            records = finished_chunks(partial)
            missing = missing_frames(facts, records)
            if missing:
                _refuse_missing(partial, facts, missing)
        manifest = whole or publish(partial, folder, facts, records)
        refresh_dataset(dataset)
    return _report(manifest, folder, time.monotonic() - started, found=whole is not None)


def _find(dataset: Place, bridge_id: str) -> BuildReport:
    """Do what a kill after the bridge had appeared may have left undone."""
    partial, folder = dataset / PARTIAL / bridge_id, dataset / BRIDGES / bridge_id
    manifest = read_manifest(folder / MANIFEST)
    with folder_lock(gate_of(partial), wait_s=BEGIN_WAIT_S), folder_lock(partial):
        remove_left_over(partial, {})
        refresh_dataset(dataset)
    return _report(manifest, folder, 0.0, found=True)


def _report(manifest: Manifest, folder: Place, seconds: float, *, found: bool) -> BuildReport:
    return BuildReport(
        bridge_id=folder.name,
        folder=folder,
        recipe=manifest.recipe.name if manifest.recipe else "none",
        counts=manifest.counts,
        notes=RecordingNotes(salvage=manifest.salvage, warnings=manifest.warnings),
        licence=manifest.info.licence,
        seconds=seconds,
        frames_found=manifest.counts.frames_kept,
        already_whole=found,
    )


def _refuse_missing(partial: Place, facts: Facts, missing: Sequence[int]) -> None:
    parts = _missing_parts(partial, facts, missing)
    frames = _some(_runs(missing, facts.planned))
    named = f"parts {_some(parts)} are missing or damaged: " if parts else ""
    raise BridgeFailedError(
        f"{named}{len(missing)} of {len(facts.planned)} frames are not whole: {frames}",
        where=partial,
        fix="run these parts again, each with the command that it had: "
        + _some([f"--chunk {part}" for part in parts], joint=" ")
        if parts
        else "run the build again: it makes what is missing",
    )


def _some(words: Sequence[str], *, joint: str = ", ") -> str:
    """Join the first of many words, and say how many more there are.

    >>> _some(["a", "b"]), _some(["a"] * 22)[-16:]
    ('a, b', 'a, a, and 2 more')
    """
    more = len(words) - _SHOWN
    return joint.join([*words[:_SHOWN], *([f"and {more} more"] if more > 0 else [])])


def _missing_parts(partial: Place, facts: Facts, missing: Sequence[int]) -> list[str]:
    """Name the parts that would make the missing frames, for the division that was used."""
    places = {index: place for place, index in enumerate(facts.planned)}
    wanted = {places[index] for index in missing}
    parts: list[str] = []
    for division in read_divisions(partial)[-1:]:
        for number in range(1, division.of + 1):
            share = Share(number, division.of)
            first, stop = share.frames_of(
                len(facts.planned), bridge=division.bridge, bridges=division.bridges
            )
            if any(place in wanted for place in range(first, stop)):
                parts.append(str(share))
    return parts


def _runs(missing: Sequence[int], planned: Sequence[int]) -> list[str]:
    """Say frames in words, neighbours of the plan together."""
    absent, runs, first, last = set(missing), [], None, 0
    for index in [*planned, None]:
        if index is not None and index in absent:
            first, last = (index if first is None else first), index
        elif first is not None:
            runs.append(f"{first:06d}" if first == last else f"{first:06d} to {last:06d}")
            first = None
    return runs
