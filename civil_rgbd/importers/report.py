"""What a conversion tells at its end."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from civil_rgbd.domain.bridge import UNSTATED_LICENCE, Counts


@dataclass(frozen=True, slots=True)
class ConvertReport:
    """What was taken over.

    Attributes:
        bridge_id: the bridge.
        folder: where it lies.
        importer: who understood the set.
        counts: what was seen, kept and left out.
        depth_scale: stored units a metre.
        evidence: what the poses say about that, in words.
        warnings: what a reader must know; the manifest has them too.
        licence: SPDX expression.
        seconds: how long it took.
    """

    bridge_id: str
    folder: Path
    importer: str
    counts: Counts
    depth_scale: float
    evidence: str
    warnings: tuple[str, ...]
    licence: str
    seconds: float

    def to_document(self) -> dict[str, object]:
        """Return it for machines."""
        return {
            "bridge_id": self.bridge_id,
            "folder": str(self.folder),
            "importer": self.importer,
            "images_seen": self.counts.images_seen,
            "frames_kept": self.counts.frames_kept,
            "dropped": dict(self.counts.dropped),
            "skipped": dict(self.counts.skipped),
            "mean_valid_share": self.counts.mean_valid_share,
            "depth_scale": self.depth_scale,
            "evidence": self.evidence,
            "warnings": list(self.warnings),
            "licence": self.licence,
            "seconds": self.seconds,
        }

    def to_text(self) -> str:
        """Return it for people."""
        counts, share = self.counts, self.counts.mean_valid_share or 0.0
        lines = [
            f"{self.bridge_id}: {counts.frames_kept} frames of {counts.images_seen} images",
            f"  from      {self.importer}, in {self.seconds:.1f} s",
            f"  folder    {self.folder}",
            f"  depth     stored as x {self.depth_scale:g}, in {share:.1%} of the pixels",
            f"  scale     {self.evidence}",
        ]
        left_out = {**counts.dropped, **counts.skipped}
        lines += [f"  left out  {count} {reason}" for reason, count in left_out.items()]
        lines += [f"  note      {warning}" for warning in self.warnings]
        if self.licence == UNSTATED_LICENCE:
            lines.append("  licence   unstated: give --licence SPDX")
        return "\n".join(lines)
