"""A defect that somebody marked in a frame, and its size."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

OUTLINES: Final = ("points", "polyline", "polygon")
"""How the pixels of a defect belong together."""


@dataclass(frozen=True, slots=True)
class DefectMeasure:
    """One number about a defect.

    Attributes:
        name: what was measured: ``length``, ``width``, ``area``, ``depth``.
        value: in ``unit``.
        unit: ``mm`` or ``mm2``.
        sigma: standard deviation in ``unit``; None when it was not estimated.
    """

    name: str
    value: float
    unit: str
    sigma: float | None = None


@dataclass(frozen=True, slots=True)
class DefectRecord:
    """One defect in one frame.

    Attributes:
        defect_id: unique in the bridge.
        frame_id: the frame it was marked in.
        type: for example ``crack``, ``spalling``, ``delamination``.
        outline: one of :data:`OUTLINES`.
        uv_px: (column, row) of each point, pixel centres at whole numbers.
        measures: its size.
        severity: in the words of the guideline that was used.
        note: anything else.
    """

    defect_id: str
    frame_id: str
    type: str
    outline: str
    uv_px: tuple[tuple[float, float], ...]
    measures: tuple[DefectMeasure, ...] = ()
    severity: str | None = None
    note: str | None = None

    def __post_init__(self) -> None:
        if self.outline not in OUTLINES:
            raise ValueError(f"outline {self.outline!r} is none of {', '.join(OUTLINES)}")
        if not self.uv_px:
            raise ValueError(f"defect {self.defect_id!r} marks no pixel")
