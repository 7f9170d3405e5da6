"""What a build says when it is done: outside the bridge folder, for it knows time and place."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from civil_rgbd.domain.bridge import Counts
from civil_rgbd.domain.recording import RecordingNotes


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
    folder: Path
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
        ]
        if counts.pixels_without_source:
            lines.append(f"  no source for {counts.pixels_without_source} pixels of every image")
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


def _listed(title: str, counts: Mapping[str, int], *, total: int | None = None) -> list[str]:
    entries = [f"{reason} {count:,}" for reason, count in counts.items() if count]
    if not entries:
        return []
    of_all = f" of {total:,}" if total is not None else ""
    return [f"  {title}{of_all}: {', '.join(entries)}"]


def _percent(share: float | None) -> str:
    return "no depth" if share is None else f"{100 * share:.1f} %"
