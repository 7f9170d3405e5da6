"""From finished chunks to a bridge folder: count, write the documents, let it appear."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace

from civil_rgbd.builder.bridge import remove_partial
from civil_rgbd.builder.chunks import BRIDGE, ChunkRecord, FrameRecord
from civil_rgbd.builder.facts import Facts
from civil_rgbd.builder.plan import in_words
from civil_rgbd.builder.salvage import salvage_after
from civil_rgbd.constants import NS_PER_S
from civil_rgbd.domain.bridge import OLD_POINTS_S, Counts, Manifest
from civil_rgbd.errors import BridgeFailedError
from civil_rgbd.format.writer import finish_bridge
from civil_rgbd.pipeline.prepare import PointCounts, total_points
from civil_rgbd.storage.places import Place


def publish(
    partial: Place, folder: Place, facts: Facts, records: Sequence[ChunkRecord]
) -> Manifest:
    """Make the bridge of an unfinished build whole, and let it appear by one rename.

    Args:
        partial: the folder of the unfinished build; it is taken away.
        folder: where the bridge belongs; one that is there is replaced.
        facts: of the build.
        records: of all chunks, in any order.

    Returns:
        the manifest, counts included.

    Raises:
        BridgeFailedError: no frame came out, or some of the plan are missing.
        OutputError: something cannot be written.
    """
    frames = _in_order(records)
    if [frame.source_index for frame in frames] != list(facts.planned):
        raise BridgeFailedError(
            f"{len(facts.planned)} frames were planned, {len(frames)} of them are on disk",
            where=partial,
            fix="run the same command again: it makes those that are missing",
        )
    manifest = with_counts(facts, records)
    rows = [frame.row for frame in frames if frame.row is not None]
    if not rows:
        remove_partial(partial)
        raise BridgeFailedError(
            f"no frame came out of {facts.images_seen} images: {in_words(manifest.counts.dropped)}",
            where=folder.name,
            fix="look at the images of the recording: none that was chosen could be decoded",
        )
    finish_bridge(
        partial / BRIDGE,
        folder,
        manifest=manifest,
        camera=facts.camera,
        rows=rows,
        replace=folder.exists(),
    )
    remove_partial(partial)
    return manifest


def missing_frames(facts: Facts, records: Iterable[ChunkRecord]) -> list[int]:
    """Return the source indices of planned frames that no chunk has made."""
    made = {frame.source_index for record in records for frame in record.frames}
    return [index for index in facts.planned if index not in made]


def with_counts(facts: Facts, records: Sequence[ChunkRecord]) -> Manifest:
    """Fill in what was seen, kept and dropped: the same whoever made which chunk."""
    frames = _in_order(records)
    dropped = dict(facts.images_dropped)
    for frame in frames:
        if frame.dropped:
            dropped[frame.dropped] = dropped.get(frame.dropped, 0) + 1
    kept = [frame for frame in frames if frame.row is not None]
    ages_s = [frame.nearest_ns / NS_PER_S for frame in kept]
    points: dict[int, PointCounts] = {}  # neighbouring chunks read some scans twice
    for record in records:
        points |= record.point_counts
    totals = total_points(points.values())
    points_read = totals.pop("read")
    skipped = dict(facts.skipped)
    if unreadable := totals.pop("messages_unreadable"):
        skipped["scan-undecodable"] = unreadable
    return replace(
        facts.manifest,
        salvage=salvage_after(facts.manifest.salvage, unreadable=unreadable, read=len(points)),
        counts=Counts(
            images_seen=facts.images_seen,
            frames_kept=len(kept),
            dropped=dropped,
            scans_seen=facts.scans_seen,
            scans_read=len(points),
            points_read=points_read,
            points_dropped=totals,
            skipped=skipped,
            mean_points_in_view=_mean([frame.points_in_view for frame in kept]),
            mean_age_span_s=_mean([frame.span_ns / NS_PER_S for frame in kept]),
            mean_newest_age_s=_mean(ages_s),
            max_newest_age_s=max(ages_s, default=None),
            frames_with_old_points=sum(age_s > OLD_POINTS_S for age_s in ages_s),
            mean_valid_share=_mean([frame.row.valid_share for frame in kept if frame.row]),
            pixels_without_source=facts.pixels_without_source,
            pixels_removed_by_visibility=_removed(facts, kept),
        ),
    )


def _removed(facts: Facts, kept: Sequence[FrameRecord]) -> int | None:
    recipe = facts.manifest.recipe
    if recipe is None or "visibility" not in recipe.parameters:
        return None
    return sum(frame.pixels_removed for frame in kept)


def _in_order(records: Iterable[ChunkRecord]) -> list[FrameRecord]:
    # By index: a chunk that was taken for lost may have been made twice, with the same bytes.
    frames = {frame.source_index: frame for record in records for frame in record.frames}
    return [frames[index] for index in sorted(frames)]


def _mean(values: list[int] | list[float]) -> float | None:
    return math.fsum(values) / len(values) if values else None
