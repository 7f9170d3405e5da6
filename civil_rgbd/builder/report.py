"""What a build says when it is done: outside the bridge folder, for it knows time and place."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from civil_rgbd.domain.bridge import OLD_POINTS_S, Counts
from civil_rgbd.domain.recording import RecordingNotes
from civil_rgbd.errors import CivilRgbdError
from civil_rgbd.storage.places import Place


@dataclass(frozen=True, slots=True)
class BuildReport:
    """One built bridge.

    Attributes:
        bridge_id: which.
        folder: where it is.
        recipe: name of the recipe.
        counts: what was seen, kept and dropped.
        notes: what the recording said.
        licence: SPDX expression in the manifest.
        seconds: wall time; 0 when it was whole already.
        frames_found: frames that an earlier, stopped build had finished.
        already_whole: nothing had to be done.
    """

    bridge_id: str
    folder: Place
    recipe: str
    counts: Counts
    notes: RecordingNotes
    licence: str
    seconds: float
    frames_found: int
    already_whole: bool

    def to_document(self) -> dict[str, object]:
        """Return all of it for machines."""
        document = dataclasses.asdict(self)
        document["folder"] = str(self.folder)
        return document

    def to_text(self) -> str:
        """Return it for people."""
        counts = self.counts
        lines = [
            (
                f"{self.bridge_id}: {counts.frames_kept} frames of {counts.images_seen} images, "
                f"recipe {self.recipe}"
            ),
            *_listed("images dropped", counts.dropped),
            *_listed("points dropped", counts.points_dropped, total=counts.points_read),
            *_listed("messages skipped", counts.skipped),
            f"  depth in      {_percent(counts.mean_valid_share)} of the pixels on average",
            (
                f"  points        {counts.mean_points_in_view or 0:,.0f} of a frame's in view, "
                f"{counts.mean_age_span_s or 0:.2f} s from oldest to newest"
            ),
            *_ages(counts),
        ]
        if counts.pixels_without_source:
            lines.append(f"  no source for {counts.pixels_without_source} pixels of every image")
        if counts.pixels_removed_by_visibility is not None:
            each = counts.pixels_removed_by_visibility / max(counts.frames_kept, 1)
            lines.append(f"  hidden        {each:,.0f} pixels of a frame removed by visibility")
        if self.notes.salvage:
            lines.append(f"  salvaged      {self.notes.salvage}")
        lines += [f"  note          {warning}" for warning in self.notes.warnings]
        if self.frames_found:
            lines.append(f"  found         {self.frames_found} frames of a stopped build")
        lines.append(
            "  was whole already, nothing done"
            if self.already_whole
            else f"  took          {self.seconds:.1f} s"
        )
        lines.append(f"  lies in       {self.folder}")
        return "\n".join(lines)


@dataclass(frozen=True, slots=True)
class ShareReport:
    """One part of a bridge, made by one of many jobs; nothing is published yet.

    Attributes:
        bridge_id: which.
        share: ``i/N``.
        frames: of the plan that belong to this part; all of them are made now.
        frames_found: of those, how many an earlier run had made.
        frames_planned: of the whole bridge.
        seconds: wall time.
    """

    bridge_id: str
    share: str
    frames: int
    frames_found: int
    frames_planned: int
    seconds: float

    def to_document(self) -> dict[str, object]:
        """Return all of it for machines."""
        return dataclasses.asdict(self)

    def to_text(self) -> str:
        """Return it for people."""
        found = f", {self.frames_found} of them found" if self.frames_found else ""
        return (
            f"{self.bridge_id}: part {self.share} is made: {self.frames} of "
            f"{self.frames_planned} frames{found}; took {self.seconds:.1f} s"
        )


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """What became of one bridge of many.

    Attributes:
        bridge_id: which.
        report: what was done; None when it failed.
        error: why it failed; None when it did not.
    """

    bridge_id: str
    report: BuildReport | ShareReport | None = None
    error: Exception | None = None

    def to_document(self) -> dict[str, object]:
        """Return all of it for machines."""
        if self.report is not None:
            return self.report.to_document()
        return {"bridge_id": self.bridge_id, "failed": _error_document(self.error)}


@dataclass(frozen=True, slots=True, eq=False)
class SurveyReport:
    """What became of many bridges.

    Attributes:
        outcomes: one a bridge, in the order of the survey.
        seconds: wall time of all.
    """

    outcomes: tuple[Outcome, ...]
    seconds: float

    @property
    def failed(self) -> tuple[Outcome, ...]:
        """Those that did not come out."""
        return tuple(outcome for outcome in self.outcomes if outcome.report is None)

    def to_document(self) -> dict[str, object]:
        """Return all of it for machines."""
        return {
            "bridges": [outcome.to_document() for outcome in self.outcomes],
            "failed": [outcome.bridge_id for outcome in self.failed],
            "seconds": self.seconds,
        }

    def to_text(self) -> str:
        """Return it for people: one line a bridge, then what failed and why."""
        lines = [f"{'bridge':<24} {'frames':>7} {'images':>7} {'depth in':>9} {'seconds':>8}"]
        lines += [f"{one.bridge_id:<24} {_row(one.report)}" for one in self.outcomes]
        lines += [f"\n{one.bridge_id} failed: {one.error}" for one in self.failed]
        made = len(self.outcomes) - len(self.failed)
        lines.append(f"\n{made} of {len(self.outcomes)} bridges; took {self.seconds:.1f} s")
        return "\n".join(lines)


def _row(report: BuildReport | ShareReport | None) -> str:
    match report:
        case None:
            return "failed"
        case ShareReport():
            return f"part {report.share}: {report.frames} of {report.frames_planned} frames made"
        case _:
            counts, share = report.counts, report.counts.mean_valid_share
            depth = "none" if share is None else f"{100 * share:.1f} %"
            took = "found" if report.already_whole else f"{report.seconds:.1f}"
            return f"{counts.frames_kept:>7} {counts.images_seen:>7} {depth:>9} {took:>8}"


def _error_document(error: Exception | None) -> dict[str, str]:
    if isinstance(error, CivilRgbdError):
        return {"what": error.what, "where": error.where, "fix": error.fix}
    return {"what": f"{type(error).__name__}: {error}", "where": "", "fix": ""}


def _listed(title: str, counts: Mapping[str, int], *, total: int | None = None) -> list[str]:
    entries = [f"{reason} {count:,}" for reason, count in counts.items() if count]
    if not entries:
        return []
    of_all = f" of {total:,}" if total is not None else ""
    return [f"  {title}{of_all}: {', '.join(entries)}"]


def _ages(counts: Counts) -> Iterator[str]:
    """Say how old the points of a frame are when its image is taken, and when that is too much."""
    if counts.mean_newest_age_s is None:
        return
    yield (
        f"  newest point  {counts.mean_newest_age_s:.3f} s from its frame's image on average, "
        f"{counts.max_newest_age_s or 0:.3f} s at most"
    )
    if counts.frames_with_old_points:
        yield (
            f"  warning       {counts.frames_with_old_points} of {counts.frames_kept} frames have "
            f"no point within {OLD_POINTS_S} s of their image: the LiDAR was silent or had ended, "
            "and sees what it saw before; accumulate.max_age_s leaves such points out"
        )


def _percent(share: float | None) -> str:
    return "no depth" if share is None else f"{100 * share:.1f} %"
