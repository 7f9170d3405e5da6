"""What an export wrote, and what the other layout has no place for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from civil_rgbd.exporters.selection import NO_SPLITS, Splits


@dataclass(frozen=True, slots=True)
class ExportOptions:
    """How to write out.

    Attributes:
        depth_scale: stored depth units a metre, for ``tum``; None takes 5000.
        voxel_m: edge of the cubes that keep one point each; None keeps every point.
        splits: of the dataset, for layouts with a list a split.
        on_frame: called once a frame is written.
    """

    depth_scale: float | None = None
    voxel_m: float | None = None
    splits: Splits = field(default_factory=lambda: NO_SPLITS)
    on_frame: Callable[[], object] = lambda: None


@dataclass(slots=True)
class Losses:
    """What is lost; exporters fill it as they write.

    Attributes:
        words: what the layout has no place for.
        beyond_pixels: depths beyond the layout's range, written as no depth.
        below_pixels: depths too small for the layout's step, written as no depth.
        kept_pixels: depths that were kept.
        largest_error_m: of the depths that were kept, by rounding.
    """

    words: list[str] = field(default_factory=list)
    beyond_pixels: int = 0
    below_pixels: int = 0
    kept_pixels: int = 0
    largest_error_m: float = 0.0

    def to_lines(self) -> list[str]:
        """Return it for people, one loss a line."""
        lines = list(self.words)
        if self.kept_pixels:
            lines.append(f"depth is rounded, by at most {1000 * self.largest_error_m:.2f} mm")
        if self.beyond_pixels:
            lines.append(
                f"{self.beyond_pixels} depths lie beyond the range and are written as none"
            )
        if self.below_pixels:
            lines.append(f"{self.below_pixels} depths round to 0 and are written as none")
        return lines


@dataclass(frozen=True, slots=True)
class ExportReport:
    """What was written.

    Attributes:
        exporter: the layout.
        folder: where it lies.
        frames: by bridge, how many.
        losses: what is lost, one a line.
    """

    exporter: str
    folder: Path
    frames: dict[str, int]
    losses: list[str]

    def to_document(self) -> dict[str, object]:
        """Return it for machines."""
        return {
            "exporter": self.exporter,
            "folder": str(self.folder),
            "frames": self.frames,
            "losses": self.losses,
        }

    def to_text(self) -> str:
        """Return it for people."""
        frames = ", ".join(f"{bridge} ({count} frames)" for bridge, count in self.frames.items())
        lines = [f"{self.folder}: {frames} as {self.exporter}"]
        return "\n".join([*lines, *(f"  lost      {loss}" for loss in self.losses)])
